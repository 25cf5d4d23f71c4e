"""Compiles the kernels and computes the converged references of many cases in several processes, before the first is
measured.

Kernels are cached on disk by their content (model/base/kernel_cache.py), references beside the store, so that the
process that measures only loads them. Done serially, this is most of a first `softlab lab --quick`.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.partition import Alone, use_partition
from softlab.bench.measure.progress import progress_bar
from softlab.bench.store.schema import Description
from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.errors import SoftlabError
from softlab.model.base.files import replacing
from softlab.model.base.kernel_cache import folder
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

FEWEST = 4  # jobs: fewer are done before a process has started
MAX_WORKERS = 12
MAX_PARTICLES = 300_000  # of a case that is opened only to compile it
KNOWN = "ahead.json"  # beside the machine code: keys of the jobs that were done
Kind = tuple[str, ...]
_gathered: list[list[Job]] = []  # jobs of the `gathering` under way


@dataclass(frozen=True)
class Job:
    """Work whose result `run`, in any process, leaves on disk. Jobs of one `kind` leave the same."""

    kind: Kind
    run: Callable[[], object]

    @property
    def key(self) -> str:
        """24 hexadecimal digits of the kind."""
        return hashlib.blake2b(repr(self.kind).encode(), digest_size=12).hexdigest()


class _Nothing(Alone):
    """Partition of a process that plans experiments and measures none of them."""

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        yield False


@contextmanager
def gathering(progress: bool) -> Iterator[None]:
    """Let experiments inside this context measure nothing; at its end one pool of processes makes what they lack.

    A pool for each experiment would import numba and CUDA again in every process, and wait for its slowest kernel.
    """
    _gathered.append([])
    try:
        with use_partition(_Nothing()):
            yield
    finally:
        jobs = _gathered.pop()
    do_ahead(jobs, progress)


@runtime_checkable
class Openable(Protocol):
    """A case whose simulation can be opened: its kernels are compiled ahead."""

    @property
    def scene(self) -> Scene: ...
    @property
    def backend(self) -> str: ...
    @property
    def description(self) -> Description: ...
    @property
    def sources(self) -> str: ...
    def open(self) -> Simulation: ...


def kind_of(case: Openable) -> Kind:
    """Key of the kernels of a case: parts of its scene, words of its method, its size, backend and options."""
    scene, method = case.scene, case.scene.method
    words = sorted(f"{name}={value}" for name, value in method.model_dump().items() if isinstance(value, str))
    parts = sorted(f"{kind}:{name}" for name, kind in scene.kinds.items())
    threads = str(case.description.get("threads"))
    return (
        case.backend, case.description["precision"], case.description["math"], threads, str(scene.grid.rows),
        str(scene.grid.columns), case.sources, *words, *parts,
    )  # fmt: skip


def compile_case(case: Openable) -> None:
    """Open a case and compile its step; errors are reported where the case is measured."""
    with suppress(SoftlabError, MemoryError), case.open() as simulation:
        simulation.warm_up()


def compilations(cases: Iterable[object]) -> Iterator[Job]:
    """Yield the compilation of each case; not for cases that are too large to be opened only for this."""
    for case in cases:
        ours = getattr(case, "peer", None) is None
        if ours and isinstance(case, Openable) and case.scene.grid.particle_count <= MAX_PARTICLES:
            yield Job(kind_of(case), partial(compile_case, case))


def do_ahead(jobs: Iterable[Job], progress: bool, workers: int | None = None) -> int:
    """Do one job of each kind that this machine has not done yet. Returns their number: 0 where that would not pay (one
    core, few jobs, no place for machine code, the CUDA simulator)."""
    if _gathered:
        _gathered[-1].extend(jobs)
        return 0
    place, workers = folder(), min(core_count(), MAX_WORKERS) if workers is None else workers
    if place is None or workers < 2 or gpu_simulated():
        return 0
    known = _known(place)
    kinds: dict[Kind, Job] = {}
    for job in jobs:
        kinds.setdefault(job.kind, job)
    missing = {job.key: job for job in kinds.values() if job.key not in known}
    if len(missing) < FEWEST:
        return 0
    done = _done(missing, min(workers, len(missing)), progress)
    with suppress(OSError), replacing(place / KNOWN) as file:
        file.write_text(json.dumps(sorted(known | set(done))), encoding="utf-8")
    return len(done)


def _done(missing: Mapping[str, Job], workers: int, progress: bool) -> Sequence[str]:
    """Return the keys of the jobs that processes have done. Ctrl-C ends the processes and is raised."""
    context = multiprocessing.get_context("spawn")  # a fork would share a CUDA context, which none survives
    done: list[str] = []
    pool = ProcessPoolExecutor(workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))
    try:
        futures: dict[Future[object], str] = {pool.submit(job.run): key for key, job in missing.items()}
        with progress_bar(progress) as bar:
            task = bar.add_task(f"preparing on {workers} processes", total=len(missing))
            for future in as_completed(futures):
                if future.exception() is None:
                    done.append(futures[future])
                bar.update(task, advance=1)
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
    return done


def _known(place: Path) -> set[str]:
    with suppress(OSError, ValueError, TypeError):
        return set(json.loads((place / KNOWN).read_text(encoding="utf-8")))
    return set()
