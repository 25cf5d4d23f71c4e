"""References of grids that NumPy would take minutes for: the lab's own RK4, in float64 and exact math, on the CPU.

Not independent of what it judges, as bench/reference/ is; but the tests hold that very configuration against bench/reference/
to rounding, and Richardson's estimate is its own. Whoever uses it says so.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from app.driver import open_simulation
from bench.experiments.accuracy.judge import evaluation_seconds, fastest_rate
from bench.measure.growth import LOOKS, Growth, growth_along, kept_growth
from bench.reference import cache
from bench.reference.mass_spring import smooth, start
from bench.reference.richardson import refine
from model.core.build import build
from model.core.simulation import Simulation, State
from model.scene.scene import Scene

OWN_SECONDS = 6e-9  # s a mass and force evaluation, rounded up
MAX_NUMPY_SECONDS = 20.0
MAX_HALVINGS = 5


def _evaluations(scene: Scene, time: float) -> float:
    """Force evaluations of reference and twins, roughly: RK4 at h, h/2 and h/4, and twice at h."""
    return 9 * 4 * 4 * time * fastest_rate(scene)


def numpy_seconds(scene: Scene, time: float) -> float:
    """What reference and twins of a scene take in NumPy, roughly."""
    return _evaluations(scene, time) * evaluation_seconds(scene)


def own_seconds(scene: Scene, time: float) -> float:
    """What they take here, roughly."""
    return _evaluations(scene, time) * (scene.grid.particle_count * OWN_SECONDS + 2e-5)


def by_numpy(scene: Scene, time: float) -> bool:
    """Whether the independent reference is affordable."""
    return numpy_seconds(scene, time) <= MAX_NUMPY_SECONDS


def growth_of(scene: Scene, time: float, folder: Path | None) -> Growth:
    """The growth of a disturbance, from NumPy (kept in `folder`) where that is affordable, else by the lab's own RK4."""
    return kept_growth(scene, time, folder) if by_numpy(scene, time) else own_growth(scene, time)


def converged_of(scene: Scene, time: float, folder: Path | None) -> cache.Converged:
    """The converged reference, from NumPy (kept in `folder`) where that is affordable, else by the lab's own RK4."""
    return cache.kept(scene, time, folder) if by_numpy(scene, time) else own_converged(scene, time)


def _opened(scene: Scene, dt: float) -> Simulation:
    stepped = scene.replace({"method.integrator": "rk4", "method.dt": dt})
    return open_simulation(stepped, "cpu", precision="float64", math="exact", allow_unstable=True)


def own_converged(scene: Scene, time: float, tolerance: float = cache.TOLERANCE) -> cache.Converged:
    """RK4 at h and h/2 with Richardson, as bench.reference.mass_spring.converged does it. Raises Diverged."""

    def solve(count: int) -> tuple[np.ndarray, np.ndarray]:
        with _opened(scene, time / count) as simulation:
            simulation.advance(count)
            state = simulation.state()
            return state.position, state.velocity

    steps = max(8, ceil(4 * time * fastest_rate(scene)))
    most = steps * 2**MAX_HALVINGS
    return cache.Converged(*refine(solve, steps, tolerance * scene.grid.spacing, most, smooth(scene)))


def own_growth(scene: Scene, time: float) -> Growth:
    """As bench.measure.growth.measure_growth, by the lab's own solver."""
    velocity, inverse_mass = start(scene)[1], build(scene).inverse_mass

    def path(position: np.ndarray, count: int) -> list[np.ndarray]:
        with _opened(scene, time / count) as simulation:
            simulation.load(State(position, velocity, inverse_mass, 0.0, 0))
            passed = []
            for _ in range(LOOKS):
                simulation.advance(count // LOOKS)
                passed.append(simulation.state().position)
            return passed

    return growth_along(scene, time, path)
