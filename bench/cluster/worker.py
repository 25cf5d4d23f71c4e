"""A worker: one process that measures the groups of an experiment that it takes, into its own store.

It plans the whole experiment, as a process alone would, and before each group asks whether somebody has it (a claim in the
folder). So what is measured depends on the machine that measures it (cores, GPU), and workers on machines alike share one
plan. A finished group is handed out as a file, which the sweep merges.
"""

from __future__ import annotations

import _thread
import os
import shutil
import signal
import threading
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from bench.cluster.folder import BROKEN, DONE, REFUSED, STOPPED, Folder, Order, Status
from bench.cluster.turns import Turn, host_name
from bench.measure.share import sharing
from bench.store.database import Store
from bench.store.transfer import export, last_run, merge
from bench.store.versions import BACKENDS, digest_of
from model.core.errors import BackendUnavailable, SoftlabError

COUNTS = ("measured", "held", "samples", "suspect", "compile_seconds")  # of a summary, as far as it has them


def code_digests() -> tuple[str, ...]:
    """What the sources are, of both backends: a sweep and its workers must have the same."""
    return tuple(digest_of(name) for name in BACKENDS)


class Life:
    """A worker's signs of life, and its ends: told to stop, or left by the process that started it, or by the sweep. The main
    thread hears of it as a KeyboardInterrupt, once, so that what is being tidied up then is left to."""

    def __init__(self, folder: Folder, order: Order, status: Status):
        self.folder, self.order, self.status = folder, order, status
        self.stopped_by = ""
        self._reason = ""
        self._over = threading.Event()
        self._writing = threading.Lock()
        self._parent = os.getppid()
        self._thread = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> Life:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._interrupted)
        self.tell()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self.tell()

    def _interrupted(self, number: int, frame: Any) -> None:
        if not self.stopped_by:
            self.stopped_by = self._reason or f"stopped by {signal.Signals(number).name}"
            raise KeyboardInterrupt

    def tell(self, doing: str | None = None) -> None:
        """Write the status, `doing` in it."""
        with self._writing, suppress(OSError):  # a folder that is gone is noticed by the thread
            self.status.doing = self.status.doing if doing is None else doing
            self.folder.write_status(self.status)

    def _beat(self) -> None:
        seen, still = "", 0
        while not self._over.wait(self.order.beat):
            self.status.beat += 1
            self.tell()
            alive = self.folder.alive()
            seen, still = alive, (still + 1 if alive == seen else 0)
            if self.folder.stopped():
                self._stop("the sweep was stopped")
            elif os.getppid() != self._parent:
                self._stop("the process that started it is gone")
            elif still >= self.order.patience or not self.folder.path.exists():
                self._stop("the sweep is gone")

    def _stop(self, reason: str) -> None:
        if not self._reason:
            self._reason = reason
            _thread.interrupt_main()


class Claims:
    """A worker's share of an experiment: the groups that it takes. Claims are known by machine, so that workers on machines
    of another kind have a plan of their own."""

    def __init__(self, folder: Folder, life: Life, turn: Turn):
        self.folder, self.life, self.status, self.turn = folder, life, life.status, turn
        self._part = 0
        self._after = 0  # the seed's last run
        self._handed = 0
        self._taken_over: set[str] = set()
        self._words: dict[str, str] = {}  # of each claim, for a reader
        self._store: Store | None = None

    def open_store(self) -> Store:
        """The worker's own store, which begins as what the sweep's held. Raises InputError."""
        file = self.folder.store_of(self.status.name)
        part = file.with_suffix(".part")
        shutil.copyfile(self.folder.seed, part)
        os.replace(part, file)
        store = Store(file, journal="DELETE")
        self._after = last_run(store)
        self._store = store
        return store

    def planned(self, store: Store, machine: str, groups: Mapping[str, tuple[float, str]]) -> None:
        self._part += 1
        labels = store.query("SELECT label FROM machine WHERE key = ?", (machine,))
        self.status.machine, self.status.label = machine, str(labels[0][0])
        self._words |= {self._claim(name): words for name, (_, words) in groups.items()}
        self.folder.write_plan(machine, self._part, {self._claim(name): what for name, what in groups.items()})
        self.life.tell()

    def _claim(self, name: str) -> str:
        return f"{self.status.machine}.{self._part}.{name}".replace(os.sep, "-")

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        claim = self._claim(name)
        if self.folder.claimed(claim):
            yield False
            return
        self.turn.begin()  # first: who waits for its machine keeps no group from others
        if not self.folder.claim(claim, self.status.name):
            yield False
            return
        self.status.holding.append(claim)
        self.life.tell(self._words.get(claim, name))
        self._take_over()
        yield True
        self._hand_out()
        self.status.holding.remove(claim)
        self.status.done.append(claim)
        self.life.tell("looking for work")
        if not self.status.holding:
            self.turn.end()

    def _take_over(self) -> None:
        """What workers that are gone had measured: nothing of it is measured again."""
        assert self._store is not None
        for name in self.folder.lost():
            if name not in self._taken_over:
                self._taken_over.add(name)
                merge(self._store, self.folder.store_of(name))

    def _hand_out(self) -> None:
        """What this worker has measured since the last time, in a file of its own."""
        assert self._store is not None
        self._handed += 1
        export(self._store, self.folder.out_of(self.status.name, self._handed), after=self._after)


def _backends(order: Order) -> Sequence[str]:
    """What is timed here, with the machine to itself."""
    if order.backends is not None and not order.backends:
        return ()
    from bench.measure.experiment import backends_here

    return backends_here(order.backends)


def _device(backends: Sequence[str]) -> str | None:
    """The GPU's own name, where it alone is timed."""
    if list(backends) != ["gpu"]:
        return None
    from bench.measure.gpu import gpu_simulated

    if gpu_simulated():
        return "simulated"
    from numba import cuda

    return str(cuda.get_current_device().uuid)


def _measure(folder: Folder, order: Order, life: Life) -> None:
    """Run the experiment as far as its groups are this worker's, and tell in the status what it did."""
    if code_digests() != order.version:
        raise BackendUnavailable(
            f"host {life.status.host} has other sources of the lab than the sweep",
            "install the same version on every host",
        )
    backends = _backends(order)
    turn = Turn(backends, _device(backends), lambda: life.tell("waiting for its turn on this host"))
    claims = Claims(folder, life, turn)
    try:
        turn.begin()  # before the machine's own limits are measured
        with claims.open_store() as store, sharing(claims):
            summary = order.run(store, progress=False, command=_command(order, life.status), **order.how)
    finally:
        turn.end()
    status = life.status
    status.counts = {name: getattr(summary, name) for name in COUNTS if hasattr(summary, name)}
    status.skipped, status.wrong = ([tuple(one) for one in getattr(summary, n, ())] for n in ("skipped", "wrong"))
    status.ended = STOPPED if summary.interrupted else DONE


def _command(order: Order, status: Status) -> str:
    """What a run says of its command; the comment tells hosts apart that are one machine to the store."""
    return f"{order.command}  # worker {status.name} on host {status.host}"


def main(path: str, name: str) -> int:
    """One worker, from its start to its end; the exit status, 0 wherever its status file tells how it ended."""
    folder = Folder(Path(path))
    order, status = folder.order(), Status(name, os.getpid(), host_name())
    with Life(folder, order, status) as life:
        try:
            _measure(folder, order, life)
        except KeyboardInterrupt:
            status.ended = STOPPED
        except SoftlabError as error:
            status.ended = BROKEN if status.holding else REFUSED
            status.reason, status.exit_status = str(error), error.exit_status
        except Exception as error:
            traceback.print_exc()
            status.ended, status.reason = BROKEN, f"{type(error).__name__}: {error}"
        if status.ended == STOPPED:
            status.reason = life.stopped_by
    return 0
