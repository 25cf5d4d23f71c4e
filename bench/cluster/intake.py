"""Workers' results on their way into the sweep's store."""

from __future__ import annotations

import shutil
from pathlib import Path

from bench.cluster.folder import Folder
from bench.store.database import Store
from bench.store.transfer import merge
from model.core.errors import InputError


class Intake:
    """Merges what workers hand out or leave in a folder. `kept`: why a file could not be merged, which then stays."""

    def __init__(self, store: Store, folder: Folder):
        self.store, self.folder = store, folder
        self.kept: list[str] = []

    def take(self, file: Path) -> bool:
        """Whether a worker's results are in the store now; doing it twice adds nothing."""
        if not file.exists():
            return True
        try:
            merge(self.store, file)
        except InputError as error:
            if str(error) not in self.kept:
                self.kept.append(str(error))
            return False
        return True

    def take_outs(self) -> None:
        """The groups that were finished since the last time."""
        for file in self.folder.outs():
            if self.take(file):
                file.unlink(missing_ok=True)

    def take_all(self) -> bool:
        """Whether everything that any worker measured is in the store now."""
        self.take_outs()
        taken = [self.take(file) for file in self.folder.stores()]
        return all(taken) and not self.folder.outs()

    def clear(self) -> None:
        """Remove the folder, whose results are in the store."""
        shutil.rmtree(self.folder.path, ignore_errors=True)
