"""`softlab sweep --kernels`: every kernel of each backend, forced, at every size, to find the fastest at each size.

Timed like the ordinary sweep (bench/experiments/sweep.py): checked, sampled in turn per size, resumable. A kernel that
cannot run at a size, or fails there for any reason, is skipped with the reason, and the others continue. The
configuration contains the kernel's name; ordinary timings, whose kernel the backend chose, have `auto`. Whether the
backend would choose the kernel is stored with each (`default`: 1 or 0). In the first requested precision the energy [J]
is measured too, where the machine has a counter (bench/measure/energy.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

from softlab.bench.experiments.kernel_runner import NO_JOULES, KernelRunner
from softlab.bench.experiments.sweep import Asked, Sweep
from softlab.bench.measure.cases import Case, SweepSummary
from softlab.bench.measure.energy import LOOP_SECONDS, STAGE, energy_counter
from softlab.bench.measure.experiment import Report, backends_here, ending_cleanly, host_of, source_hash
from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.limits import enter_limits
from softlab.bench.measure.partition import current_partition
from softlab.bench.measure.starts import measure_starts
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene

SQUARES = tuple(16 << k for k in range(10))  # 16 ... 8192
QUICK_SQUARES = (32, 64, 128, 256)
SLOW = ("launch", "stages")  # kernels for which three samples are enough
SLOW_REPEATS = 3
MAX_CROWDED = 128 * 128  # largest number of masses at which more threads than cores are timed: there they matter
# the other kernels of a size are compared with the first of these that it has
PLAIN = ("fused", "launch", "graph", "stages")


def kernels_of(backend: str) -> tuple[str, ...]:
    """Return the names of a backend's kernels, from the module that chooses among them."""
    for module in ("choice", "solver"):
        names = getattr(import_module(f"softlab.{backend}_backend.mass_spring.grid.{module}"), "KERNELS", None)
        if names:
            return tuple(names)
    raise LookupError(f"the {backend} backend has no list of kernels")


def kernel_cases(
    scene: Scene, backends: Sequence[str], precisions: Sequence[str], energy: bool, kernels: Sequence[str] | None = None
) -> list[Case]:
    """Return the configurations of one grid, plainest kernel first; `kernels`: only these of them."""
    cases = []
    for precision in precisions:
        for backend in backends:
            crowded = precision == precisions[0] and scene.grid.particle_count <= MAX_CROWDED
            here = kernels_of(backend)
            names = [name for name in kernels if name.partition(":")[0] in here] if kernels else here
            for kernel in sorted(names, key=lambda name: PLAIN.index(name) if name in PLAIN else len(PLAIN)):
                words = (
                    (None,) if backend == "gpu" else ("1x", "2x", "4x") if crowded and kernel not in SLOW else ("1x",)
                )
                for word in words:
                    host = host_of(backend, word or "1x")
                    description = configuration(scene, backend=backend, kernel=kernel, precision=precision, **host)
                    cases.append(
                        Case(
                            scene, backend, word, host.get("threads"), precision, False, description,
                            source_hash(backend), kernel, SLOW_REPEATS if kernel in SLOW else None,
                            energy and precision == precisions[0] and word in (None, "1x"),
                        )
                    )  # fmt: skip
    return cases


def run_kernel_sweep(
    store: Store, *, kernels: Sequence[str] | None = None, energy: bool = True, starts: bool = True, **how: Any
) -> SweepSummary:
    """Measure the kernels that the store lacks, and return a summary.

    `how`: fields of `Asked` of bench/experiments/sweep.py. `kernels`: only these. `energy`: joules too, one second per
    configuration, where the machine has a counter. `starts`: also the time of `softlab run` to its first step, cold and
    warm. The machine's limits (bench/measure/limits.py) are measured where its record lacks them. Ctrl-C ends cleanly.

    Raises SceneError (an impossible choice), InputError (the store), BackendUnavailable (a requested backend).
    """
    asked = Asked(**{"command": "softlab sweep --kernels"} | how)
    effort, here = asked.effort(), backends_here(asked.backends)
    known = [name for backend in here for name in kernels_of(backend)]
    for name in kernels or ():
        if name.partition(":")[0] not in known:  # `resident:64x8x8h4` contains a tile too
            raise SceneError("--kernel", name, f"must be one of {', '.join(dict.fromkeys(known))}")
    scenes = asked.grids(QUICK_SQUARES if asked.quick else SQUARES)
    summary = SweepSummary.begun(store, "sweep")
    counters = {name: energy_counter(name) for name in here if energy and not (name == "gpu" and gpu_simulated())}
    if any(counters.values()):
        effort = replace(effort, energy_seconds=LOOP_SECONDS)
    sweep = _KernelSweep(KernelRunner(store, effort, summary, here, {}))
    if starts and not gpu_simulated() and isinstance(asked.scene, str):
        sweep.starting = [(load_scene(asked.scene), name) for name in here]
    grids = [
        [c for name in here for c in kernel_cases(scene, [name], asked.precisions, bool(counters.get(name)), kernels)]
        for scene in scenes
    ]
    with ending_cleanly(summary):
        enter_limits(store, summary.machine)
        sweep.run(grids, asked.progress, asked.command)
    return summary


class _KernelSweep(Sweep):
    """Sweep in which a configuration without its joules is incomplete too.

    `starting`: (scene, backend) pairs that are started in processes of their own, before the first grid.
    """

    starting: Sequence[tuple[Scene, str]] = ()

    def _measure(self, cases: Sequence[Case], report: Report) -> None:
        for scene, backend in self.starting:
            with current_partition().take(f"starts {backend}") as taken:
                if taken:
                    run, machine = self.summary.run, self.summary.machine
                    measure_starts(self.store, run, machine, scene, backend, source_hash(backend))
        self.starting = ()
        super()._measure(cases, report)

    def _missing(self, case: Case) -> int:
        missing = super()._missing(case)
        key = case.description, self.summary.machine, case.sources
        lacks_energy = case.energy and not (
            self.store.sample_count(*key, STAGE) or self.store.has_measure(*key, NO_JOULES)
        )
        return max(missing, 1) if lacks_energy else missing
