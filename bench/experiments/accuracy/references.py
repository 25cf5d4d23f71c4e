"""What runs are held against, and how much a disturbance of their motion grows: a reference for every kind of scene.

Of the accuracy scenes: grids, and the cloth that touches nothing: RK4 and Richardson in NumPy (bench/reference/). A cloth
that touches something: the lab's own semi-implicit Euler at tiny steps, since a contact is a jump, after which RK4 has no
order to extrapolate by (bench/reference/richardson.py), and NumPy would take minutes for the steps that first order needs. A
loaded rope: RK4 in NumPy, too, whose steps are short enough to be stable on its fastest vibrations; they hardly move. Runs
judged at rest: the closed form of that, with twins by implicit Euler.

Of any grid: NumPy's where that is affordable, else the lab's own RK4. Of a random force: for the draws of one step size, each
held over its step. At another step size the force is another one, so that halving the step of a run converges to nothing;
but between two draws it is constant: with the draws of the scene's own step size the motion is an ordinary one, which RK4
solves by whole fractions of that step. NumPy float64, as all of bench/reference/ whose force it uses.

The lab's own are in float64 and exact math on the CPU: not independent of what they judge; tests hold those very
configurations against bench/reference/ to rounding. Whoever uses one says so.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from app.driver import open_simulation
from bench.experiments.accuracy.judge import SECONDS_PER_EVALUATION, evaluation_seconds, fastest_rate
from bench.experiments.accuracy.methods import newton, why_unknown
from bench.experiments.accuracy.points import AT_REST
from bench.measure.experiment import source_hash
from bench.measure.growth import LOOKS, Growth, growth_along, kept_growth
from bench.reference import cache, rope
from bench.reference.mass_spring import simulate, smooth, start
from bench.reference.richardson import refine
from bench.store.database import Store
from model.core.build import build
from model.core.families import stability_limit
from model.core.integrators import damping_rate, frequency_bound
from model.core.simulation import Simulation, State
from model.scene.scene import Scene

CLOTH_TOLERANCE = 2e-7  # spacings; RK4 at dt 0.0005 on S4 is at 3e-6, and shall be resolved tenfold
ROPE_TOLERANCE = 2e-6
ROPE_STEPS_PER_RADIAN = 0.4  # RK4 holds from 0.36 on
STILL_STEPS_PER_RADIAN = 0.002  # no step is too long for implicit Euler; its end swings at 1.75 rad/s
LEFT = 1e-8  # m: of the swing, at the time of S6-still
FINER = 128  # steps of the lab's own reference of contacts to one at the limit
OWN_SECONDS = 6e-9  # s a mass and force evaluation, rounded up
MAX_NUMPY_SECONDS = 20.0
MAX_HALVINGS = 5
SECONDS_PER_STEP = 1e-3  # s, of NumPy's calls under a random force, rounded up


def references(store: Store) -> Path | None:
    """The folder of the converged references that belong to a store; None for one in memory."""
    return None if store.path == ":memory:" else Path(store.path).absolute().parent / "references"


# ---------------------------------------------------------------------- of the accuracy scenes


def motion_of(scene: Scene) -> Scene:
    """The scene that references are made of: for the solver mass-spring, but where that does not know its loads."""
    return scene if scene.loads and why_unknown(scene) is None else newton(scene)


def converged_for(label: str, scene: Scene, end: float, folder: Path | None) -> cache.Converged:
    """The state of an accuracy scene's motion (`motion_of`) at `end` [s], kept in `folder` (None: not at all)."""
    if label in AT_REST:
        position = rope.hanging(scene)
        return cache.Converged(position, np.zeros_like(position), LEFT)
    if scene.loads:
        return cache.kept(scene, end, folder, tolerance=ROPE_TOLERANCE, per_radian=ROPE_STEPS_PER_RADIAN)
    if scene.colliders:
        return contact_converged(scene, end, folder)
    if scene.cloth:
        return cache.kept(scene, end, folder, tolerance=CLOTH_TOLERANCE)
    return cache.kept(scene, end, folder)


def growth_for(label: str, scene: Scene, end: float, folder: Path | None) -> Growth:
    """How much a disturbance of that motion has grown by then."""
    if label in AT_REST:
        return kept_growth(scene, end, folder, "implicit-euler", STILL_STEPS_PER_RADIAN)
    if scene.loads:
        return kept_growth(scene, end, folder, per_radian=ROPE_STEPS_PER_RADIAN)
    return kept_growth(scene, end, folder)


def contact_converged(scene: Scene, time: float, folder: Path | None) -> cache.Converged:
    """The end state at `time` [s] with steps of half of limit / FINER; the estimate [m] is the largest difference to twice
    such steps, which of a method of first order is the error of the finer. Kept in `folder` (None: not at all)."""

    def make() -> cache.Converged:
        stepped = scene.replace({"method.integrator": "semi-implicit-euler"})
        steps = ceil(FINER * time / stability_limit(stepped))
        (coarse, _), (position, velocity) = (_end(stepped, time, count) for count in (steps, 2 * steps))
        return cache.Converged(position, velocity, float(np.linalg.norm(position - coarse, axis=1).max()))

    key = f"{cache.key(scene, time, 1.0, 1 / FINER)}-{source_hash('cpu')}"
    return cache.kept_state(folder / f"contact-{key}.npz" if folder else None, scene, make)


def _end(scene: Scene, time: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    fine = scene.replace({"method.dt": time / steps})
    with open_simulation(fine, "cpu", precision="float64", math="exact") as simulation:
        simulation.advance(steps)
        state = simulation.state()
    return state.position, state.velocity


# ---------------------------------------------------------------------- of any grid


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


# ---------------------------------------------------------------------- of a random force


def _first_fractions(scene: Scene) -> int:
    """Fractions of a step to begin with: h w = 1/4, as everywhere."""
    return max(1, ceil(4 * scene.method.dt * (frequency_bound(scene) + damping_rate(scene))))


def held_seconds(scene: Scene, steps: int) -> float:
    """What the reference takes, roughly: at h, h/2 and h/4."""
    each = 4 * scene.grid.particle_count * SECONDS_PER_EVALUATION + SECONDS_PER_STEP
    return 7 * steps * _first_fractions(scene) * each


def held_converged(scene: Scene, steps: int, folder: Path | None) -> cache.Converged:
    """The motion after `steps` steps of `method.dt` under the draws of exactly those steps, by RK4 and Richardson.

    As bench.reference.mass_spring.converged, from `folder` where it is kept there (None: nothing is kept).
    """
    dt = scene.method.dt

    def solve(fractions: int) -> tuple[np.ndarray, np.ndarray]:
        finer = scene.replace({"method.dt": dt / fractions, "method.integrator": "rk4"})
        state = start(scene)
        for step in range(steps):
            for _ in range(fractions):
                state = simulate(finer, 1, *state, step)  # `step` numbers the draw
        return state

    def make() -> cache.Converged:
        first = _first_fractions(scene)
        most = first * 2**MAX_HALVINGS
        return cache.Converged(*refine(solve, first, cache.TOLERANCE * scene.grid.spacing, most, smooth=True))

    key = cache.key(scene, steps * dt, 1.0, cache.TOLERANCE)
    return cache.kept_state(folder / f"held-{key}-{steps}.npz" if folder else None, scene, make)
