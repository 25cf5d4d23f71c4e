"""Mass-spring grid in slow, plain NumPy float64: the reference of both backends.

Written from the equations, by array slicing, without model/formulas, model/build or a backend on purpose (a test
asserts it), so that a mistake would have to be made twice to go unnoticed. Newton's law per mass m,

 m p'' = sum over neighbours k (|d| - L0) d / |d|  -  c v  +  m (0, -g)  +  external  +  poke,

with d the vector to the neighbour; a spring of length zero exerts no force. Pinned masses never move. The functions
accept a cloth too, whose forces and colliders are in bench/reference/cloth.py.
"""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from softlab.bench.reference import cloth, implicit
from softlab.bench.reference.philox import random_directions
from softlab.bench.reference.richardson import refine
from softlab.bench.reference.steps import EXPLICIT_DAMPING_VERLET as EXPLICIT_DAMPING_VERLET
from softlab.bench.reference.steps import Accelerate, Poke, masses, one_step
from softlab.bench.reference.steps import pinned_mask as pinned_mask
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene


def rest(scene: Scene) -> np.ndarray:
    """Return the rest positions, row 0 on top, y up (a cloth: see cloth.py): (rows, columns, dimensions) [m]."""
    if scene.cloth:
        return cloth.rest(scene)
    row, column = np.mgrid[: scene.grid.rows, : scene.grid.columns]
    return scene.grid.spacing * np.stack([column, -row], axis=-1)


def start(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) at time 0, (particles, dimensions) float64 each, in builder order."""
    if scene.cloth:
        return cloth.start(scene)
    position, pinned = rest(scene), pinned_mask(scene)
    velocity = np.zeros_like(position)
    if scene.perturbation:
        i, j = np.mgrid[: scene.grid.rows, : scene.grid.columns]
        offset = scene.perturbation.amplitude * np.stack(
            [np.sin(1.7 * i + 0.9 * j), np.cos(0.6 * i - 1.3 * j)], axis=-1
        )
        position[~pinned] += offset[~pinned]
    return position.reshape(-1, 2), velocity.reshape(-1, 2)


def spring_forces(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return the forces at positions (rows, columns, 2) by Hooke's law, on both ends of every spring: (rows, columns,
    2) [N].
    """
    force = np.zeros_like(position)
    if scene.springs is None:
        return force
    rest_length = scene.springs.rest_length
    # views: writing to f writes to force
    for p, f in ((position, force), (position.swapaxes(0, 1), force.swapaxes(0, 1))):
        d = p[1:] - p[:-1]
        length = np.hypot(d[..., :1], d[..., 1:])
        pull = (scene.springs.stiffness * (length - rest_length) / (length + (length == 0))) * d
        pull[1::2] *= scene.springs.stiffness_ratio  # every second spring is stiffer
        f[:-1] += pull
        f[1:] -= pull
    return force


def _force_without_damping(
    scene: Scene, position: np.ndarray, velocity: np.ndarray, time: float, step: int, poke: Poke | None
) -> np.ndarray:
    if scene.cloth:
        return cloth.forces(scene, position, velocity, time, step, poke)
    grid = scene.grid
    force = spring_forces(scene, position)
    if scene.gravity and scene.gravity.enabled:
        force[..., 1:2] -= masses(scene) * scene.gravity.acceleration
    if scene.external and scene.external.magnitude > 0:
        force += scene.external.magnitude * random_directions(scene.external.seed, step, grid.particle_count).reshape(
            force.shape
        )
    if poke is not None and poke[0] is not None:
        force[divmod(poke[0], grid.columns)] += poke[1]
    return force


def simulate(
    scene: Scene,
    steps: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    first_step: int = 0,
    poke: Poke | None = None,
    *,
    integrator: str | None = None,
    inertia: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]) after `steps` steps of `method.dt`, (particles, dimensions) float64 each.

    Particles are in builder order. `position`, `velocity` (particles, dimensions): the start (None: the scene's own).
    `first_step`: the number of the first step, for forces and colliders that depend on time. `poke`: (particle, force
    on each axis [N]), constant over all steps. `integrator` replaces the scene's. `inertia` multiplies every mass
    except in gravity: 2 gives the motion x'' = a/2 that the hand-out's step converges to (docs/method/cases.md, fact 1).
    There is no check for divergence.
    """
    grid, dt = scene.grid, scene.method.dt
    method = integrator or scene.method.integrator
    if method in implicit.NAMES:
        return implicit.simulate(scene, steps, position, velocity, first_step, poke, linear=method == implicit.NAMES[1])
    shape = (grid.rows, grid.columns, scene.dimensions)
    begin_position, begin_velocity = start(scene)
    p = np.array(begin_position if position is None else position, dtype=np.float64).reshape(shape)
    v = np.array(begin_velocity if velocity is None else velocity, dtype=np.float64).reshape(shape)
    free = ~pinned_mask(scene)[..., None]
    v *= free
    mass = inertia * masses(scene)
    gamma = (scene.damping.coefficient if scene.damping else 0.0) / mass
    with np.errstate(over="ignore", invalid="ignore"):  # above its limit an explicit scheme does overflow
        for step in range(first_step, first_step + steps):

            def undamped(p: np.ndarray, v: np.ndarray, t: float, step: int = step) -> np.ndarray:
                return np.where(free, _force_without_damping(scene, p, v, t, step, poke) / mass, 0.0)

            def whole(p: np.ndarray, v: np.ndarray, t: float, undamped: Accelerate = undamped) -> np.ndarray:
                return undamped(p, v, t) - gamma * v

            def settle(
                before: np.ndarray, p: np.ndarray, v: np.ndarray, step: int = step
            ) -> tuple[np.ndarray, np.ndarray]:
                return cloth.collide(scene, before, p, v, step) if scene.cloth else (p, v)

            p, v = one_step(method, p, v, step * dt, dt, whole, undamped, gamma, settle)
            if scene.cloth:
                p, v = cloth.follow(scene, p, v, (step + 1) * dt)
    return p.reshape(-1, scene.dimensions), v.reshape(-1, scene.dimensions)


def converged(
    scene: Scene,
    time: float,
    *,
    inertia: float = 1.0,
    tolerance: float = 1e-9,
    most_steps: int = 200_000,
    per_radian: float = 4,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Compute the converged motion of a scene with RK4 and Richardson extrapolation (bench/reference/richardson.py).

    Parameters
    ----------
    scene : Scene
        A grid or cloth of springs without random forces.
    time : float
        When to evaluate the motion, s.
    inertia : float
        Factor of the masses in the equation of motion, see `simulate`.
    tolerance : float
        Largest error estimate, as a multiple of the spacing.
    most_steps : int
        Number of steps not to exceed.
    per_radian : float
        Initial number of steps per radian of the fastest vibration.

    Returns
    -------
    position, velocity : (particles, dimensions) float64 arrays, m and m/s
    error : float
        Estimated error of the positions, m.

    Raises
    ------
    SceneError
        The scene has a random force, which differs at every step size.
    """
    if scene.external and scene.external.magnitude > 0:
        raise SceneError("external.magnitude", scene.external.magnitude, "must be 0 for a converged reference")
    steps = max(8, ceil(time * _fastest(scene) * per_radian))

    def solve(count: int) -> tuple[np.ndarray, np.ndarray]:
        return simulate(scene.replace({"method.dt": time / count}), count, integrator="rk4", inertia=inertia)

    return refine(solve, steps, tolerance * scene.grid.spacing, most_steps, smooth(scene))


def smooth(scene: Scene) -> bool:
    """True if forces and motion have all derivatives that RK4's order needs, apart from coincident masses."""
    return not (scene.wind or scene.colliders or scene.motions)


def _fastest(scene: Scene) -> float:
    """Return a rate [1/s] that nothing in the scene much exceeds: its largest frequency plus that of its dampers."""
    stiffness = scene.springs.stiffness * scene.springs.stiffness_ratio if scene.springs else 0.0
    damping = scene.damping.coefficient if scene.damping else 0.0
    if scene.cloth:
        stiffness = sum(springs.stiffness for springs in scene.cloth_springs.values())
        damping += 8 * sum(springs.damping for springs in scene.cloth_springs.values())
    mass = float(np.min(masses(scene)))
    return sqrt(8 * stiffness / mass) + damping / mass


def first_diverged(scene: Scene, steps: int, bound: float) -> tuple[int, int] | None:
    """Return the first (step, particle) within `steps` that is not finite or beyond `bound` [m]; None if there is none.

    `bound` applies to the distance from the centre of the start along each axis. `step` counts the completed steps,
    `particle` is the lowest such index.
    """
    position, velocity = start(scene)
    middle = (position.min(axis=0) + position.max(axis=0)) / 2
    for step in range(steps):
        position, velocity = simulate(scene, 1, position, velocity, step)
        bad = ~((np.abs(position - middle) <= bound).all(axis=1) & np.isfinite(velocity).all(axis=1))
        if bad.any():
            return step + 1, int(np.argmax(bad))
    return None
