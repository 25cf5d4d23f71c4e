"""Distance of a position-based run from its own scheme with converged iterations: the solver's error.

The error against Newton's law (bench/experiments/accuracy/judgement.py) is that of the scheme, implicit Euler, plus the
error of unfinished iterations. The second part alone is the distance to the same scheme, step size and ordering with so
many iterations that twice as many change less than `CHANGE_FRACTION` of it, in float64 and exact math on the CPU.
Orderings converge to slightly different states, because a projection goes along the constraint's direction in that
iterate (Macklin et al., XPBD, 2016, section 4). For the same reason the balance below does not vanish with the
iterations.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.judgement import BALANCE, CONSTRAINT, SOLVER, Numbers
from softlab.bench.experiments.accuracy.methods import why_unknown
from softlab.bench.measure.experiment import source_hash
from softlab.bench.reference import cache, xpbd
from softlab.bench.reference.steps import masses
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

CHANGE_FRACTION = 1e-3  # fraction of the solver's error that doubling the iterations may still change
FLOOR = 1e-9  # spacings: below the resolution of the references, above the rounding of float64 in thousands of steps
MAX_ITERATIONS = 5120
ORDERINGS = {"jacobi": "weighted-jacobi"}  # the name of this ordering in bench/reference/xpbd.py


def _end(scene: Scene, steps: int) -> np.ndarray:
    with open_simulation(  # on one thread: more would only wait for each other
        scene, "cpu", threads=1, precision="float64", math="exact", allow_unstable=True
    ) as simulation:
        simulation.advance(steps)
        return simulation.state().position


class Iterated:
    """End states by their number of iterations, stored in `folder` like references (None: in memory only)."""

    def __init__(self, folder: Path | None):
        self.folder = folder
        self._ends: dict[str, np.ndarray] = {}

    def end(self, scene: Scene, steps: int) -> np.ndarray:
        """Return the positions after `steps` steps in exact math on the CPU: (particles, dimensions) float64 [m]."""
        text = f"{scene.canonical()} {steps} {source_hash('cpu')}"
        key = hashlib.sha256(text.encode()).hexdigest()[:16]
        if key not in self._ends:
            file = self.folder / f"iterated-{key}.npz" if self.folder else None
            shapes = {"position": (scene.grid.particle_count, scene.dimensions)}
            self._ends[key] = cache.cached_arrays(file, shapes, lambda: {"position": _end(scene, steps)})["position"]
        return self._ends[key]

    def converged(self, scene: Scene, steps: int, free: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Return (positions [m] of the scheme with converged iterations, the last change [spacings], iterations)."""
        iterations, spacing = scene.method.iterations, scene.grid.spacing
        judged = before = self.end(scene, steps)
        while True:
            iterations *= 2
            after = self.end(scene.replace({"method.iterations": iterations}), steps)
            change, error = (distance(one, after, free, spacing)[0] for one in (before, judged))
            if change <= max(CHANGE_FRACTION * error, FLOOR) or iterations >= MAX_ITERATIONS:
                return after, change, iterations
            before = after


def iterate(cases: Sequence[tuple[Scene, int]], folder: Path) -> None:
    """Store in `folder` the end states with more and more iterations to which `solver_numbers` compares runs of these
    scenes, which differ in their iterations only, after so many steps."""
    iterated = Iterated(folder)
    for scene, steps in cases:
        iterated.converged(scene, steps, build(scene).inverse_mass > 0)


def solver_numbers(
    scene: Scene, state: State, steps: int, iterated: Iterated, rest: np.ndarray | None = None
) -> Numbers:
    """Return the measures of a position-based run that ended in `state` after `steps` steps.

    `SOLVER` [spacings]: root mean square over the free masses. Of one further step, by NumPy, the largest `CONSTRAINT`
    |C + a~ lambda| [m] and the largest `BALANCE` |M (x - x~) - grad C' lambda| [kg m] (XPBD 2016, eq. 9 and 8). `rest`
    (particles, dimensions) [m]: the rest state, if the motion is at rest by then; the converged scheme ends there too,
    at any step size.
    """
    free = state.inverse_mass > 0
    if not free.any():
        return {SOLVER: (0.0, "spacing", "nothing is free")}
    if rest is None:
        right, change, iterations = iterated.converged(scene, steps, free)
        against = f"{iterations} iterations; half of them change {change:.1e} spacings"
    else:
        right, against = rest, "rest, where the converged scheme is"
    error = distance(state.position, right, free, scene.grid.spacing)[0]
    numbers: Numbers = {SOLVER: (error, "spacing", f"against {against}")}
    if why_unknown(scene) is None:
        constraint, balance = next_residuals(scene, state)
        numbers[CONSTRAINT] = (constraint, "m", "largest, of the next substep")
        numbers[BALANCE] = (balance, "kg m", "largest, of the next substep")
    return numbers


def next_residuals(scene: Scene, state: State) -> tuple[float, float]:
    """Return bench.reference.xpbd.residuals of the substep after `state`, where the motion is known (`why_unknown`)."""
    method = scene.method
    h, inverse_mass = method.dt / method.substeps, state.inverse_mass.astype(np.float64)
    p, v = state.position.astype(np.float64), state.velocity.astype(np.float64)
    mass = np.broadcast_to(masses(scene), (scene.grid.rows, scene.grid.columns, 1)).ravel()
    a = xpbd.accelerations(scene, p, v, state.time, state.step, None, mass)
    drag = (scene.damping.coefficient if scene.damping else 0.0) / mass[:, None]
    constraints = xpbd.of_scene(scene)
    ordering = ORDERINGS.get(method.ordering, method.ordering)
    stepped = xpbd.substep(constraints, p, v, a, inverse_mass, h, method.iterations, ordering, drag)
    return xpbd.residuals(constraints, stepped, p, inverse_mass, h)
