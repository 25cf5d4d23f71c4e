"""Merging of workers' results into the sweep's store."""

from __future__ import annotations

import shutil
from pathlib import Path

from softlab.bench.cluster.folder import Folder
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import merge
from softlab.model.base.errors import InputError


class Intake:
    """Merges what workers export or leave in a folder; `unmerged`: reasons of files that could not be merged, which stay."""

    def __init__(self, store: Store, folder: Folder):
        self.store, self.folder = store, folder
        self.unmerged: list[str] = []

    def take(self, file: Path) -> bool:
        """Merge a worker's results and return True if they are in the store now; merging twice adds nothing."""
        if not file.exists():
            return True
        try:
            merge(self.store, file)
        except InputError as error:
            if str(error) not in self.unmerged:
                self.unmerged.append(str(error))
            return False
        return True

    def take_outs(self) -> None:
        """Merge the groups that were finished since the last call."""
        for file in self.folder.outs():
            if self.take(file):
                file.unlink(missing_ok=True)

    def take_all(self) -> bool:
        """Merge everything that any worker measured; return False if something could not be merged."""
        self.take_outs()
        taken = [self.take(file) for file in self.folder.stores()]
        return all(taken) and not self.folder.outs()

    def clear(self) -> None:
        """Remove the folder, whose results are in the store."""
        shutil.rmtree(self.folder.path, ignore_errors=True)
