"""Compiling the kernels of many cases before the first is measured, on several processes at once.

Kernels are kept on disk by their content (model/base/kernel_cache.py), so that the process that measures only loads what
others compiled. One after another, compiling is most of a first `softlab lab --quick`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.partition import Alone, use_partition
from softlab.bench.measure.processes import run_in_processes
from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.errors import SoftlabError
from softlab.model.base.files import replacing
from softlab.model.base.kernel_cache import folder

FEWEST = 4  # kinds of simulations: fewer are compiled before a process has started
MAX_WORKERS = 12
MAX_PARTICLES = 300_000  # of a case that is opened only to compile it
KNOWN = "ahead.json"  # beside the machine code: the kinds that were compiled
Kind = tuple[str, ...]
_gathered: list[list[Any]] = []  # cases of the `gathering` under way


class _Nothing(Alone):
    """Partition of a process that plans experiments and measures none of them."""

    @contextmanager
    def take(self, name: str) -> Iterator[bool]:
        yield False


@contextmanager
def gathering(progress: bool) -> Iterator[None]:
    """Let experiments inside this context measure nothing; at its end one pool of processes compiles the kernels they lack.

    A pool for each experiment would import numba and CUDA anew in every process, and wait for its slowest kernel.
    """
    _gathered.append([])
    try:
        with use_partition(_Nothing()):
            yield
    finally:
        cases = _gathered.pop()
    compile_ahead(cases, progress)


def kind_of(case: Any) -> Kind:
    """Key of the kernels of a case: parts of its scene, words of its method, its size, backend and options."""
    scene, method = case.scene, case.scene.method
    words = sorted(f"{name}={value}" for name, value in method.model_dump().items() if isinstance(value, str))
    parts = sorted(f"{kind}:{name}" for name, kind in scene.kinds.items())
    threads = str(case.description.get("threads"))
    return (
        case.backend, case.description["precision"], case.description["math"], threads, str(scene.grid.rows),
        str(scene.grid.columns), case.sources, *words, *parts,
    )  # fmt: skip


def compile_case(case: Any) -> None:
    """Open a case and compile its step; errors are reported where the case is measured."""
    with suppress(SoftlabError, MemoryError), case.open() as simulation:
        simulation.warm_up()


def compile_ahead(cases: Iterable[Any], progress: bool, workers: int | None = None) -> int:
    """Compile one case of each kind that this machine has not compiled yet. Returns the number of kinds compiled: 0 where
    that would not pay (one core, few kinds, no place for machine code, the CUDA simulator)."""
    if _gathered:
        _gathered[-1].extend(cases)
        return 0
    place, workers = folder(), min(core_count(), MAX_WORKERS) if workers is None else workers
    if place is None or workers < 2 or gpu_simulated():
        return 0
    known = _known(place)
    kinds: dict[str, Any] = {}
    for case in cases:
        if not hasattr(case, "open") or case.scene.grid.particle_count > MAX_PARTICLES:
            continue
        kinds.setdefault(hashlib.blake2b(repr(kind_of(case)).encode(), digest_size=12).hexdigest(), case)
    missing = {key: case for key, case in kinds.items() if key not in known}
    if len(missing) < FEWEST:
        return 0
    done = run_in_processes(
        {key: partial(compile_case, case) for key, case in missing.items()}, workers, progress, "compiling"
    )
    with suppress(OSError), replacing(place / KNOWN) as file:
        file.write_text(json.dumps(sorted(known | set(done))), encoding="utf-8")
    return len(done)


def _known(place: Path) -> set[str]:
    with suppress(OSError, ValueError, TypeError):
        return set(json.loads((place / KNOWN).read_text(encoding="utf-8")))
    return set()
