"""Convergence of the orderings of a position-based solver, by iterations and by time.

One step of a cloth that hangs by two corners, stretched by STRETCH along its height, rippled by RIPPLE, and released
without gravity. Structural and shear springs are inextensible (compliance 0). The error after n iterations is then the
stretch itself, which the positions determine on any backend: RESIDUAL, the root mean square of |C| over the rest
length, XPBD's own residual (2016, eq. 9) for compliance 0. All of it is present before the step, at all wavelengths;
step size and masses do not matter.

Orderings are compared at equal residuals, not at equal iterations, because an iteration over a dozen colours differs
from one over all constraints at once. One number is not enough either: a sweep of Gauss-Seidel makes the constraints of
its last colours exact and moves their stretch into the others (half of them are stretched twice as much: sqrt 2 times
the root mean square). From a smooth state its residual therefore first grows, then falls faster. Orderings with the
same number of iterations are timed in turn, on the same steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from itertools import product

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.methods import XPBD, changes
from softlab.bench.measure.costs_timing import FULL, QUICK, Effort, Measures, Record, in_turn
from softlab.bench.measure.declaration import WITH_FINDINGS
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Group, Items, cost_sources
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.reference.mass_spring import start
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description
from softlab.model.core.build import build
from softlab.model.core.energy import spring_strain
from softlab.model.core.simulation import State
from softlab.model.position_based.plan import colour_order, xpbd_parts
from softlab.model.scene.scene import Scene, load_scene

CONVERGENCE = "convergence"  # value of `finding`
RESIDUAL, BEFORE = "convergence_residual", "convergence_residual_before"  # over the rest length; BEFORE: at the start
SIZES = (64, 128, 256, 512)  # masses per side
ITERATIONS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
STRETCH = 0.01  # fraction of the height
RIPPLE = 0.001  # m
FRAME = 1 / 60  # s
RIGID = ("structural", "shear")
PRECISION = "float32"


def sheet(n: int, name: str, iterations: int) -> Scene:
    """Return the cloth of n x n masses under an ordering."""
    solved = changes(name, iterations) | {
        "method.dt": FRAME,
        "gravity.enabled": False,
        "perturbation.amplitude": RIPPLE,
    }
    rigid = {f"{kind}.compliance": 0.0 for kind in RIGID}
    return load_scene("cloth-hanging").replace({"cloth.rows": n, "cloth.columns": n} | solved | rigid)


def colours() -> int:
    """Return the number of colours of an iteration of Gauss-Seidel."""
    return len(colour_order(xpbd_parts(sheet(SIZES[0], XPBD[0], 1))))


def drawn_out(scene: Scene) -> State:
    """Return the start: its height, from the pinned row down, stretched by STRETCH; at rest."""
    position, _ = start(scene)
    top = position[0, 1]
    position[:, 1] = top + (1 + STRETCH) * (position[:, 1] - top)
    return State(position, np.zeros_like(position), build(scene).inverse_mass, 0.0, 0)


def residual(scene: Scene, position: np.ndarray) -> float:
    """Root mean square of the strain over the inextensible constraints."""
    strains = np.concatenate([spring_strain(scene, position, kind) for kind in RIGID])
    return float(np.sqrt(np.mean(strains**2)))


def groups(store: Store, backends: Sequence[str], quick: bool) -> list[Group]:
    """Return the groups timed in turn: the orderings at one size and number of iterations, Gauss-Seidel first.

    `quick`: the smallest size only, fewer and shorter samples.
    """
    effort, sizes = (QUICK, SIZES[:1]) if quick else (FULL, SIZES)
    all_groups = []
    for backend in backends:
        sources = cost_sources(backend, [__file__])
        for n, iterations in product(sizes, ITERATIONS):
            scenes = tuple(sheet(n, name, iterations) for name in XPBD)
            descriptions = tuple(described(scene, backend, CONVERGENCE, precision=PRECISION) for scene in scenes)
            measure = partial(_orderings, scenes, descriptions, effort)
            name = f"{CONVERGENCE} {n} x {n} x {iterations} {backend}"
            all_groups.append(Group(name, descriptions, sources, measure))
    return all_groups


class Convergence(Items):
    """Measure how the orderings of a position-based solver converge, by iterations and by time."""

    name, command, doing = CONVERGENCE, "accuracy", f"{CONVERGENCE}: "
    in_lab, on_workers, extra = True, True, WITH_FINDINGS
    items = staticmethod(groups)


def _orderings(
    scenes: Sequence[Scene], descriptions: Sequence[Description], effort: Effort, record: Record
) -> list[Measures]:
    with ExitStack() as stack:
        subjects, left = [], []
        for scene, description in zip(scenes, descriptions, strict=True):
            simulation = stack.enter_context(open_simulation(scene, description["backend"], precision=PRECISION))
            begin = drawn_out(scene)
            simulation.load(begin)
            simulation.advance(1)
            after = residual(scene, simulation.state().position)
            before: Measures = {BEFORE: (residual(scene, begin.position), "", None), RESIDUAL: (after, "", "one step")}
            left.append(before)
            subjects.append(prepare(Subject(simulation, description), effort.seconds, effort.most))
        timed = in_turn(record, subjects, effort.repeats)
    return [before | numbers for before, numbers in zip(left, timed, strict=True)]
