"""Folder beside a store through which a sweep and its workers communicate, on a file system that all of them see.

 order.pickle             the experiment to run (written once)
 seed.sqlite              contents of the store at the beginning of the sweep
 status/NAME.json         status of a worker, rewritten every second or so
 claims/MACHINE.GROUP     owner of that group; made by a link, which only one worker can make
 plans/MACHINE.PART.json  groups to measure on such a machine, and their weights
 stores/NAME.sqlite       a worker's own store; its finished groups are exported as out/NAME.NUMBER.sqlite
 lost/NAME                made when the store of a lost worker has been merged: others may continue from it
 alive, stop              the sweep is alive; the sweep requests its workers to end

Only its worker opens a store before the worker is gone: a database that two hosts open is safe on few file systems.
"""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from softlab.model.base.errors import InputError
from softlab.model.base.files import why

SUBFOLDERS = ("status", "claims", "plans", "stores", "out", "lost", "logs")
ABANDONED = "given up"  # owner of a group that must not be taken any more
DONE, STOPPED, REFUSED, BROKEN = "done", "stopped", "refused", "broken"  # how a worker reports its end


@dataclass(frozen=True)
class Order:
    """Work of every worker: `run(store, command=..., progress=False, **how)`.

    In it `resume` of bench/measure/experiment.py requests groups. `backends`: what is timed with the machine reserved
    (empty: nothing; None: all that the worker's machine has). `version`: digests of the sources to be measured. `beat`:
    seconds between signs of life; a sweep without any for `patience` of them is gone.
    """

    run: Callable[..., Any]
    how: dict[str, object]
    command: str
    backends: tuple[str, ...] | None
    version: tuple[str, ...]
    beat: float = 1.0
    patience: int = 120


@dataclass
class Status:
    """Status of a worker.

    `host` (a hash), `machine` (key and `label` of the store), `doing` in words, the claims that it is `holding` and has
    `done`, `ended` and the reason; and its results, as in an experiment's summary.
    """

    name: str
    pid: int
    host: str
    beat: int = 0
    machine: str = ""
    label: str = ""
    doing: str = "starting"
    holding: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)
    ended: str = ""
    reason: str = ""
    exit_status: int = 0
    counts: dict[str, float] = field(default_factory=dict)
    skipped: list[tuple[str, str]] = field(default_factory=list)
    wrong: list[tuple[str, str]] = field(default_factory=list)


class Folder:
    """Folder of one sweep; `make`: create it. Raises InputError if it cannot be created or written."""

    def __init__(self, path: Path, make: bool = False):
        self.path = path
        if make:
            try:
                for subfolder in SUBFOLDERS:
                    (path / subfolder).mkdir(parents=True, exist_ok=True)
                self._write("alive", "0")
            except OSError as error:
                raise InputError(
                    f"{error.filename or path}: workers' stores cannot be kept there ({why(error)}); make the store's folder "
                    "writable, or give another --store"
                ) from None
        elif not (path / "status").is_dir():
            raise InputError(f"{path}: not seen by this worker; the store must lie where all hosts see it")

    def _write(self, name: str, text: str) -> None:
        """Write a file atomically: a reader finds the old text or the new one."""
        file = self.path / name
        part = file.with_name(f".{file.name}.{os.getpid()}")
        part.write_text(text, encoding="utf-8")
        os.replace(part, file)

    def _names(self, subfolder: str) -> list[str]:
        return sorted(entry.name for entry in (self.path / subfolder).iterdir() if not entry.name.startswith("."))

    # ------------------------------------------------------------------ the order, and signs of life

    def write_order(self, order: Order) -> None:
        part = self.path / ".order"
        part.write_bytes(pickle.dumps(order))
        os.replace(part, self.path / "order.pickle")

    def order(self) -> Order:
        return pickle.loads((self.path / "order.pickle").read_bytes())

    @property
    def seed(self) -> Path:
        return self.path / "seed.sqlite"

    def stop(self) -> None:
        self._write("stop", "")

    def stopped(self) -> bool:
        return (self.path / "stop").exists()

    def live(self, count: int) -> None:
        """Write the sweep's sign of life."""
        self._write("alive", str(count))

    def alive(self) -> str:
        """Return a text that changes while the sweep lives."""
        try:
            return (self.path / "alive").read_text(encoding="utf-8")
        except OSError:
            return ""

    # ------------------------------------------------------------------ workers

    def write_status(self, status: Status) -> None:
        self._write(f"status/{status.name}.json", json.dumps(asdict(status)))

    def status(self, name: str) -> Status | None:
        with suppress(OSError, ValueError, TypeError):
            return Status(**json.loads((self.path / "status" / f"{name}.json").read_text(encoding="utf-8")))
        return None

    def workers(self) -> list[str]:
        """Return the names of all workers that ever wrote a status."""
        return [name.removesuffix(".json") for name in self._names("status")]

    def store_of(self, name: str) -> Path:
        return self.path / "stores" / f"{name}.sqlite"

    def stores(self) -> list[Path]:
        return [self.path / "stores" / name for name in self._names("stores") if name.endswith(".sqlite")]

    def out_of(self, name: str, number: int) -> Path:
        return self.path / "out" / f"{name}.{number:06d}.sqlite"

    def outs(self) -> list[Path]:
        """Return the files to be merged, oldest of each worker first."""
        return [self.path / "out" / name for name in self._names("out") if name.endswith(".sqlite")]

    def lose(self, name: str) -> None:
        self._write(f"lost/{name}", "")

    def lost(self) -> list[str]:
        return self._names("lost")

    # ------------------------------------------------------------------ groups

    def claim(self, claim: str, name: str) -> bool:
        """Claim a group for this worker; return False if another one has it.

        Atomic, and with the worker's name in it: a file of another name is linked.
        """
        target = self.path / "claims" / claim
        part = self.path / "claims" / f".{name}"
        part.write_text(name, encoding="utf-8")
        try:
            os.link(part, target)
        except FileExistsError:
            return False
        except OSError as error:
            raise InputError(
                f"{target.parent}: a file system without hard links ({why(error)}); give another --store"
            ) from None
        finally:
            part.unlink(missing_ok=True)
        return True

    def claimed(self, claim: str) -> bool:
        """Return True if any worker has the claim."""
        return (self.path / "claims" / claim).exists()

    def claims(self) -> dict[str, str]:
        """Return claim -> owner."""
        owners = {}
        for claim in self._names("claims"):
            with suppress(OSError):
                owners[claim] = (self.path / "claims" / claim).read_text(encoding="utf-8")
        return owners

    def release(self, claim: str) -> None:
        (self.path / "claims" / claim).unlink(missing_ok=True)

    def abandon(self, claim: str) -> None:
        self._write(f"claims/{claim}", ABANDONED)

    def write_plan(self, machine: str, part: int, groups: Mapping[str, tuple[float, str]]) -> None:
        """Write the groups to measure on such a machine, unless another worker of its kind did: claim -> (weight,
        words).
        """
        if not (self.path / "plans" / f"{machine}.{part}.json").exists():
            self._write(f"plans/{machine}.{part}.json", json.dumps(dict(groups)))

    def _plans(self) -> dict[str, tuple[float, str]]:
        plans: dict[str, tuple[float, str]] = {}
        for name in self._names("plans"):
            with suppress(OSError, ValueError):
                plans |= json.loads((self.path / "plans" / name).read_text(encoding="utf-8"))
        return plans

    def plan(self) -> dict[str, float]:
        """Return all possible claims and their weights."""
        return {claim: worth for claim, (worth, _) in self._plans().items()}

    def words(self) -> dict[str, str]:
        """Return a description of each claim."""
        return {claim: words for claim, (_, words) in self._plans().items()}
