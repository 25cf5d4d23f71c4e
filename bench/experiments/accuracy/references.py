"""Converged references of runs, and the growth of a disturbance of their motion, for every kind of scene.

Accuracy scenes. Grids, and the cloth without contacts: RK4 and Richardson in NumPy (bench/reference/). A cloth with
contacts: semi-implicit Euler of this lab at tiny steps. A contact is a jump, after which RK4 has no order to
extrapolate by (bench/reference/richardson.py), and NumPy would take minutes for the steps that first order needs. A
loaded rope: RK4 in NumPy, with steps short enough to be stable at its fastest vibrations, which hardly move. Runs that
end at rest: the closed form of the rest state, with disturbed runs by implicit Euler.

Any grid: NumPy where it is affordable, else the RK4 of this lab. A random force: the draws of one step size, each
constant over its step. At another step size the force is another one, so halving the step of a run converges to
nothing. Between two draws the force is constant: with the draws of the scene's own step size the motion is an ordinary
one, which RK4 solves with whole fractions of that step, in NumPy float64, with the force of bench/reference/.

References by solvers of this lab use float64 and exact math on the CPU. They are not independent of the solvers that
they judge; tests compare those very configurations with bench/reference/ to rounding. Callers state which reference
they use.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.judge import SECONDS_PER_EVALUATION, evaluation_seconds, fastest_rate
from softlab.bench.experiments.accuracy.methods import newton, why_unknown
from softlab.bench.experiments.accuracy.points import AT_REST
from softlab.bench.experiments.growth import CHECKPOINTS, Growth, cached_growth, growth_along
from softlab.bench.measure.experiment import source_hash
from softlab.bench.reference import cache, rope
from softlab.bench.reference.mass_spring import simulate, smooth, start
from softlab.bench.reference.richardson import refine
from softlab.bench.store.database import Store
from softlab.model.core.build import build
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import damping_rate, frequency_bound
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

HALF_ACCELERATION = 2.0  # inertia factor of the equation that the hand-out's step converges to
CLOTH_TOLERANCE = 2e-7  # spacings; RK4 at dt 0.0005 on S4 has an error of 3e-6, which shall be resolved tenfold
ROPE_TOLERANCE = 2e-6
ROPE_STEPS_PER_RADIAN = 0.4  # RK4 is stable from 0.36 on
STILL_STEPS_PER_RADIAN = 0.002  # implicit Euler is stable at any step; the rope's end swings at 1.75 rad/s
LEFT = 1e-8  # m: what is left of the swing at the time of S6-still
FINER = 512  # steps of the contact reference to one step at the stability limit
LAB_SECONDS = 6e-9  # s per mass and force evaluation, rounded up
MAX_NUMPY_SECONDS = 20.0
MAX_HALVINGS = 5
SECONDS_PER_STEP = 1e-3  # s: overhead of the NumPy calls under a random force, rounded up


def references(store: Store) -> Path | None:
    """Return the folder of the converged references that belong to a store; None for a store in memory."""
    return None if store.path == ":memory:" else Path(store.path).absolute().parent / "references"


# ---------------------------------------------------------------------- references of the accuracy scenes


def motion_of(scene: Scene) -> Scene:
    """Return the scene that references are made of: for the solver mass-spring, unless it does not support the loads."""
    return scene if scene.loads and why_unknown(scene) is None else newton(scene)


def converged_for(label: str, scene: Scene, end: float, folder: Path | None) -> cache.Converged:
    """Return the state of an accuracy scene's motion (`motion_of`) at `end` [s], stored in `folder` (None: not stored)."""
    if label in AT_REST:
        position = rope.hanging(scene)
        return cache.Converged(position, np.zeros_like(position), LEFT)
    if scene.loads:
        return cache.cached_reference(scene, end, folder, tolerance=ROPE_TOLERANCE, per_radian=ROPE_STEPS_PER_RADIAN)
    if scene.colliders:
        return contact_converged(scene, end, folder)
    if scene.cloth:
        return cache.cached_reference(scene, end, folder, tolerance=CLOTH_TOLERANCE)
    return cache.cached_reference(scene, end, folder)


def references_for(
    label: str, motion: Scene, end: float, folder: Path | None
) -> tuple[cache.Converged, cache.Converged | None, Growth]:
    """Return the converged state of an accuracy scene's `motion_of` at `end` [s], that of half the acceleration (None for
    cloths) and the growth of a disturbance, stored in `folder` (None: not stored)."""
    right, half = converged_for(label, motion, end, folder), None
    if not motion.cloth:
        half = cache.cached_reference(motion, end, folder, inertia=HALF_ACCELERATION)
    return right, half, growth_for(label, motion, end, folder)


def growth_for(label: str, scene: Scene, end: float, folder: Path | None) -> Growth:
    """Return the growth of a disturbance of that motion up to `end` [s]."""
    if label in AT_REST:
        return cached_growth(scene, end, folder, "implicit-euler", STILL_STEPS_PER_RADIAN)
    if scene.loads:
        return cached_growth(scene, end, folder, per_radian=ROPE_STEPS_PER_RADIAN)
    return cached_growth(scene, end, folder)


def contact_converged(scene: Scene, time: float, folder: Path | None) -> cache.Converged:
    """Return the end state at `time` [s] with steps of half of limit / `FINER`, stored in `folder` (None: not stored).

    The estimate [m] is the largest difference to the state with twice that step, which for a first-order method is the
    error of the finer one.
    """

    def make() -> cache.Converged:
        stepped = scene.replace({"method.integrator": "semi-implicit-euler"})
        steps = ceil(FINER * time / stability_limit(stepped))
        (coarse, _), (position, velocity) = (_end(stepped, time, count) for count in (steps, 2 * steps))
        return cache.Converged(position, velocity, float(np.linalg.norm(position - coarse, axis=1).max()))

    key = f"{cache.key(scene, time, 1.0, 1 / FINER)}-{source_hash('cpu')}"
    return cache.cached_state(folder / f"contact-{key}.npz" if folder else None, scene, make)


def _end(scene: Scene, time: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    fine = scene.replace({"method.dt": time / steps})
    with open_simulation(fine, "cpu", precision="float64", math="exact") as simulation:
        simulation.advance(steps)
        state = simulation.state()
    return state.position, state.velocity


# ---------------------------------------------------------------------- references of any grid


def _evaluations(scene: Scene, time: float) -> float:
    """Return the rough number of force evaluations of reference and disturbed runs: RK4 at h, h/2 and h/4, and twice at
    h.
    """
    return 9 * 4 * 4 * time * fastest_rate(scene)


def numpy_seconds(scene: Scene, time: float) -> float:
    """Rough time [s] of the reference and the disturbed runs of a scene in NumPy."""
    return _evaluations(scene, time) * evaluation_seconds(scene)


def lab_seconds(scene: Scene, time: float) -> float:
    """Rough time [s] of the reference and the disturbed runs of a scene by the RK4 of this lab."""
    return _evaluations(scene, time) * (scene.grid.particle_count * LAB_SECONDS + 2e-5)


def by_numpy(scene: Scene, time: float) -> bool:
    """True if the independent reference, by NumPy, is affordable."""
    return numpy_seconds(scene, time) <= MAX_NUMPY_SECONDS


def growth_of(scene: Scene, time: float, folder: Path | None) -> Growth:
    """Return the growth of a disturbance, from NumPy (stored in `folder`) if affordable, else by the RK4 of this lab."""
    return cached_growth(scene, time, folder) if by_numpy(scene, time) else lab_growth(scene, time)


def converged_of(scene: Scene, time: float, folder: Path | None) -> cache.Converged:
    """Return the converged reference, from NumPy (stored in `folder`) if affordable, else by the RK4 of this lab."""
    return cache.cached_reference(scene, time, folder) if by_numpy(scene, time) else lab_converged(scene, time)


def _opened(scene: Scene, dt: float) -> Simulation:
    stepped = scene.replace({"method.integrator": "rk4", "method.dt": dt})
    return open_simulation(stepped, "cpu", precision="float64", math="exact", allow_unstable=True)


def lab_converged(scene: Scene, time: float, tolerance: float = cache.TOLERANCE) -> cache.Converged:
    """Return the state by RK4 at h and h/2 with Richardson, as bench.reference.mass_spring.converged. Raises Diverged."""

    def solve(count: int) -> tuple[np.ndarray, np.ndarray]:
        with _opened(scene, time / count) as simulation:
            simulation.advance(count)
            state = simulation.state()
            return state.position, state.velocity

    steps = max(8, ceil(4 * time * fastest_rate(scene)))
    most = steps * 2**MAX_HALVINGS
    return cache.Converged(*refine(solve, steps, tolerance * scene.grid.spacing, most, smooth(scene)))


def lab_growth(scene: Scene, time: float) -> Growth:
    """Return the growth like bench.experiments.growth.measure_growth, by this lab's own solver."""
    velocity, inverse_mass = start(scene)[1], build(scene).inverse_mass

    def path(position: np.ndarray, count: int) -> list[np.ndarray]:
        with _opened(scene, time / count) as simulation:
            simulation.load(State(position, velocity, inverse_mass, 0.0, 0))
            passed = []
            for _ in range(CHECKPOINTS):
                simulation.advance(count // CHECKPOINTS)
                passed.append(simulation.state().position)
            return passed

    return growth_along(scene, time, path)


# ---------------------------------------------------------------------- references under a random force


def _first_fractions(scene: Scene) -> int:
    """Return the first number of fractions of a step: h w = 1/4, as for all references."""
    return max(1, ceil(4 * scene.method.dt * (frequency_bound(scene) + damping_rate(scene))))


def stepped_force_seconds(scene: Scene, steps: int) -> float:
    """Rough time [s] of the reference, at h, h/2 and h/4."""
    each = 4 * scene.grid.particle_count * SECONDS_PER_EVALUATION + SECONDS_PER_STEP
    return 7 * steps * _first_fractions(scene) * each


def stepped_force_converged(scene: Scene, steps: int, folder: Path | None) -> cache.Converged:
    """Return the converged motion after `steps` steps of `method.dt` under the draws of exactly those steps.

    It is by RK4 and Richardson. The result is that of bench.reference.mass_spring.converged, from `folder` if it is
    stored there (None: not stored).
    """
    dt = scene.method.dt

    def solve(fractions: int) -> tuple[np.ndarray, np.ndarray]:
        finer = scene.replace({"method.dt": dt / fractions, "method.integrator": "rk4"})
        state = start(scene)
        for step in range(steps):
            for _ in range(fractions):
                state = simulate(finer, 1, *state, step)  # `step` is the number of the draw
        return state

    def make() -> cache.Converged:
        first = _first_fractions(scene)
        most = first * 2**MAX_HALVINGS
        return cache.Converged(*refine(solve, first, cache.TOLERANCE * scene.grid.spacing, most, smooth=True))

    key = cache.key(scene, steps * dt, 1.0, cache.TOLERANCE)
    return cache.cached_state(folder / f"held-{key}-{steps}.npz" if folder else None, scene, make)
