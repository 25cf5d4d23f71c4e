"""Cases of the accuracy runs: scenes x methods x step sizes x iterations x precisions x backends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.methods import (
    OF_CLOTHS,
    QUICK_FLOAT32,
    WRONG,
    XPBD,
    changes,
    fits,
    position_based,
)
from softlab.bench.experiments.accuracy.points import CLOTHS, SCENES, SIZES, end_of
from softlab.bench.measure import case_timing
from softlab.bench.measure.experiment import host_of, source_hash
from softlab.bench.reference import cache
from softlab.bench.store.results import configuration
from softlab.model.base.digest import source_digest
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import PRECISIONS, Simulation
from softlab.model.scene.scene import Scene, load_scene

# Step sizes [s], in steps of at most a factor of 2: a method's largest step within an error is known that well. Quick runs
# and float64 of position-based methods, whose errors rounding does not limit, take every second one.
STEP_SIZES = (0.02, 0.015, 0.01, 0.0075, 0.005, 0.00375, 0.0025)
CLOTH_STEP_SIZES = (0.005, 0.004, 0.0025, 0.002, 0.00125, 0.001, 0.0005)
IMPLICIT_STEP_SIZES = (0.02, 0.01, 0.005, 0.004, 0.002, 0.001)  # implicit Euler has no stability limit
XPBD_STEP_SIZES = (0.01, 0.005, 0.0025, 0.00125, 0.000625)
ROPE_STEP_SIZES = {  # an iteration passes a correction on by one link of the rope, so ropes need many substeps
    "S6": (0.0025, 0.00125, 0.000625, 0.0003125, 0.00015625, 0.000078125, 0.0000390625),
    "S6-still": (0.0025, 0.00125, 0.000625, 0.0003125, 0.00015625),
}
ITERATIONS = (1, 4, 20)
# left out: four iterations leave less than 1e-8 spacings there
SPARED = {(label, 20, 0.000625) for label in ("S4", "S5")}
QUICK_XPBD, QUICK_ITERATIONS = XPBD[:1], ITERATIONS[:2]
# run in `exact` math and other sizes too: findings that hold at these step sizes
WIDE = ("semi-implicit-euler", "velocity-verlet", "rk4")


class Case(case_timing.Case):
    """One configuration whose error is computed; `label`: the label of its scene."""

    worth = 2  # on the bar: judged, then timed

    @property
    def steps(self) -> int:
        return round(end_of(self.label) / self.scene.method.dt)

    def __str__(self) -> str:
        method = self.scene.method
        effort = f" x {method.iterations}" if method.position_based else ""
        return f"{self.label} {method.name}{effort} dt {method.dt:g} {self.precision} {self.math} {self.backend}"

    def open(self) -> Simulation:
        return open_simulation(self.scene, self.backend, precision=self.precision, math=self.math, allow_unstable=True)


def cases(
    scenes: Sequence[str],
    backends: Sequence[str],
    wide: bool = False,
    methods: Sequence[str] | None = None,
    precisions: Sequence[str] | None = None,
) -> list[Case]:
    """Return each scene x backend x precision x method x step size (x iterations), in the order of measurement.

    `wide` adds `exact` math and other grid sizes (`SIZES`) for S1 and the integrators `WIDE`, and, if no methods are
    named, all orderings of xpbd and all `ITERATIONS`. Without `wide`, and if neither methods nor precisions are named,
    the set has no more kernels than the sentences of the lab book need. `methods` and `precisions`: None for all.
    Methods that do not support a scene's sheet are left out for that scene, and so are, for cloths in float32, methods
    that converge to something else (`WRONG`).
    """
    selected = []
    every = methods or (*INTEGRATORS, *OF_CLOTHS, *(XPBD if wide else QUICK_XPBD))
    iterations = ITERATIONS if wide or methods else QUICK_ITERATIONS
    few = tuple(name for name in WIDE if methods is None or name in methods)
    for label in scenes:
        base = load_scene((SCENES | CLOTHS)[label])
        names = [name for name in every if fits(base, name)]
        kinds: list[tuple[str, Scene, Sequence[str], str]] = [(label, base, names, "fast")]
        if wide and label == "S1":
            kinds.append((label, base, few, "exact"))
            for name, (_, n) in SIZES.items():
                kinds.append((name, base.replace({"grid.rows": n, "grid.columns": n}), few, "fast"))
        selected += [
            make_case(name, sized.replace(change), backend, precision, math)
            for name, sized, used, math in kinds
            for backend in backends
            for precision in precisions or PRECISIONS
            for method in used
            if not (label in CLOTHS and method in WRONG and precision == "float32")
            if wide or methods or precisions or _quick(label, method, precision)
            for change in _variants(label, method, iterations, _stride(wide or methods, method, precision))
        ]
    return selected


def _quick(label: str, method: str, precision: str) -> bool:
    """True if a quick run has this case: all integrators in float64, few in float32, position-based methods on S1 only."""
    if position_based(method):
        return label == "S1" and precision == "float64"
    return precision == "float64" or method in QUICK_FLOAT32


def _stride(wide: object, method: str, precision: str) -> int:
    """Return 2 for cases that take every second step size only, else 1."""
    return 2 if not wide or (position_based(method) and precision == "float64") else 1


def _variants(label: str, method: str, iterations: Sequence[int], stride: int) -> list[dict[str, object]]:
    """Return the changes of a scene's fields for each step size and number of iterations of a method."""
    if position_based(method):
        sizes = ROPE_STEP_SIZES.get(label, XPBD_STEP_SIZES)[::stride]
        pairs = [(n, dt) for n in iterations for dt in sizes if (label, n, dt) not in SPARED]
        return [changes(method, n) | {"method.dt": dt} for n, dt in pairs]
    if method in OF_CLOTHS:
        return [changes(method) | {"method.dt": dt} for dt in IMPLICIT_STEP_SIZES[::stride]]
    sizes = CLOTH_STEP_SIZES if label in CLOTHS else STEP_SIZES
    return [changes(method) | {"method.dt": dt} for dt in sizes[::stride]]


def make_case(label: str, scene: Scene, backend: str, precision: str, math: str = "fast") -> Case:
    """Return one configuration with its description as the store has it."""
    description = configuration(scene, backend=backend, precision=precision, math=math, **host_of(backend))
    return Case(scene, backend, description, judged_sources(backend), label)


def judged_sources(backend: str) -> str:
    """Return the hash of everything that an error depends on: the sources of the backend and of the reference."""
    return f"{source_hash(backend)}-{source_digest(Path(cache.__file__).parent)}"
