"""Worker: one process that measures the groups of an experiment that it claims, into its own store.

It plans the whole experiment, as a single process would, and claims each group in the folder before it measures it.
What is measured depends on the machine (cores, GPU), and workers on equal machines share one plan. A finished group is
exported as a file, which the sweep merges.
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
from types import FrameType

from softlab.bench.cluster.folder import BROKEN, DONE, REFUSED, STOPPED, Folder, Order, Status
from softlab.bench.cluster.turns import Turn, host_name
from softlab.bench.measure.partition import use_partition
from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export, last_run, merge
from softlab.bench.store.versions import BACKENDS, digest_of
from softlab.model.base.errors import BackendUnavailable, SoftlabError, on_command_line

COUNTS = ("measured", "stored", "samples", "suspect", "compile_seconds")  # fields of a summary, as far as it has them


def code_digests() -> tuple[str, ...]:
    """Return the digests of the sources of both backends, which must be equal for a sweep and its workers."""
    return tuple(digest_of(name) for name in BACKENDS)


class Life:
    """Signs of life of a worker, and its ends: requested to stop, or abandoned by its parent process or by the sweep.

    The main thread gets a KeyboardInterrupt, once, so that its cleanup is not interrupted.
    """

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
        self.report()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self.report()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if not self.stopped_by:
            self.stopped_by = self._reason or f"stopped by {signal.Signals(number).name}"
            raise KeyboardInterrupt

    def report(self, doing: str | None = None) -> None:
        """Write the status of this worker. `doing`: what it does now, None: the same as before."""
        with self._writing, suppress(OSError):  # the thread notices if the folder is gone
            self.status.doing = self.status.doing if doing is None else doing
            self.folder.write_status(self.status)

    def _beat(self) -> None:
        seen, still = "", 0
        while not self._over.wait(self.order.beat):
            self.status.beat += 1
            self.report()
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
    """Groups of an experiment that a worker takes.

    Claims contain the machine, so that workers on machines of another kind have a plan of their own.
    """

    def __init__(self, folder: Folder, life: Life, turn: Turn):
        self.folder, self.life, self.status, self.turn = folder, life, life.status, turn
        self._part = 0
        self._after = 0  # number of the last run in the seed
        self._handed = 0
        self._taken_over: set[str] = set()
        self._words: dict[str, str] = {}  # description of each claim
        self._store: Store | None = None

    def open_store(self) -> Store:
        """Return the worker's own store, which begins as a copy of the sweep's. Raises InputError."""
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
        self.life.report()

    def _claim(self, name: str) -> str:
        return f"{self.status.machine}.{self._part}.{name}".replace(os.sep, "-")

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        claim = self._claim(name)
        if self.folder.claimed(claim):
            yield False
            return
        self.turn.begin()  # first, so that a worker that waits for its machine does not block a group
        if not self.folder.claim(claim, self.status.name):
            yield False
            return
        self.status.holding.append(claim)
        self.life.report(self._words.get(claim, name))
        self._take_over()
        yield True
        self._hand_out()
        self.status.holding.remove(claim)
        self.status.done.append(claim)
        self.life.report("looking for work")
        if not self.status.holding:
            self.turn.end()

    def _take_over(self) -> None:
        """Merge the measurements of lost workers, so that they are not repeated."""
        assert self._store is not None
        for name in self.folder.lost():
            if name not in self._taken_over:
                self._taken_over.add(name)
                merge(self._store, self.folder.store_of(name))

    def _hand_out(self) -> None:
        """Export what this worker has measured since the last time, to a separate file."""
        assert self._store is not None
        self._handed += 1
        export(self._store, self.folder.out_of(self.status.name, self._handed), after=self._after)


def _backends(order: Order) -> Sequence[str]:
    """Return the backends that are timed here, with the machine reserved."""
    if order.backends is not None and not order.backends:
        return ()
    from softlab.bench.measure.experiment import backends_here

    return backends_here(order.backends)


def _device(backends: Sequence[str]) -> str | None:
    """Return the identifier of the GPU, if it is the only thing that is timed."""
    if list(backends) != ["gpu"]:
        return None
    from softlab.bench.measure.gpu import gpu_simulated

    if gpu_simulated():
        return "simulated"
    from numba import cuda

    return str(cuda.get_current_device().uuid)


def _measure(folder: Folder, order: Order, life: Life) -> None:
    """Run the experiment with the groups of this worker, and report the results in the status."""
    if code_digests() != order.version:
        raise BackendUnavailable(
            f"host {life.status.host} has another version of softlab than the sweep",
            "install the same version on every host",
        )
    backends = _backends(order)
    turn = Turn(backends, _device(backends), lambda: life.report("waiting for its turn on this host"))
    claims = Claims(folder, life, turn)
    try:
        turn.begin()  # before the machine's own limits are measured
        with claims.open_store() as store, use_partition(claims):
            summary = order.run(store, progress=False, command=_command(order, life.status), **order.how)
    finally:
        turn.end()
    status = life.status
    status.counts = {name: getattr(summary, name) for name in COUNTS if hasattr(summary, name)}
    status.skipped, status.wrong = ([tuple(one) for one in getattr(summary, n, ())] for n in ("skipped", "wrong"))
    status.ended = STOPPED if summary.interrupted else DONE


def _command(order: Order, status: Status) -> str:
    """Return the command of a run; the comment distinguishes hosts that are one machine to the store."""
    return f"{order.command}  # worker {status.name} on host {status.host}"


@on_command_line()
def main(path: str, name: str) -> int:
    """Run one worker; return the exit status, 0 whenever its status file says how it ended."""
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
