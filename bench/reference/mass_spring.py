"""The mass-spring grid in slow, plain NumPy float64: the judge of both backends.

Written from the equations, by array slicing, on purpose without model/formulas, model/build or a backend (a test
asserts it): a mistake would have to be made twice to go unnoticed. Newton's law per mass m,

    m p'' = sum over neighbours k (|d| - L0) d / |d|  -  c v  +  m (0, -g)  +  external  +  poke,

with d the way to the neighbour; a spring of length zero pulls nowhere. Pinned masses never move.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, sqrt

import numpy as np

from bench.reference.philox import random_directions
from model.errors import SceneError
from model.scene import Scene

Poke = tuple[int, tuple[float, float]]
Accelerate = Callable[[np.ndarray, np.ndarray, float], np.ndarray]

EXPLICIT_DAMPING_VERLET = "velocity-verlet-explicit-damping"  # not a scene's integrator: kept to show what it loses


def pinned_mask(scene: Scene) -> np.ndarray:
    """(rows, columns) bool: the masses that `grid.pinned` holds."""
    grid = scene.grid
    mask = np.zeros((grid.rows, grid.columns), dtype=bool)
    if isinstance(grid.pinned, list):
        for row, column in grid.pinned:
            mask[row, column] = True
    elif grid.pinned == "top":
        mask[0] = True
    elif grid.pinned == "top-corners":
        mask[0, 0] = mask[0, -1] = True
    elif grid.pinned == "edges":
        mask[[0, -1]] = True
        mask[:, [0, -1]] = True
    elif grid.pinned.startswith("every:"):
        mask[0, :: int(grid.pinned.removeprefix("every:"))] = True
    return mask


def rest(scene: Scene) -> np.ndarray:
    """(rows, columns, 2) [m]: row 0 on top, y up."""
    row, column = np.mgrid[: scene.grid.rows, : scene.grid.columns]
    return scene.grid.spacing * np.stack([column, -row], axis=-1)


def manufactured_motion(scene: Scene, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p*, p*', p*'' (rows, columns, 2): rest + A [sin(2t + 1.7i + 0.9j), cos(3t + 0.6i - 1.3j)] and its derivatives."""
    assert scene.manufactured is not None
    amplitude = scene.manufactured.amplitude
    i, j = np.mgrid[: scene.grid.rows, : scene.grid.columns]
    x, y = 2 * time + 1.7 * i + 0.9 * j, 3 * time + 0.6 * i - 1.3 * j
    position = rest(scene) + amplitude * np.stack([np.sin(x), np.cos(y)], axis=-1)
    velocity = amplitude * np.stack([2 * np.cos(x), -3 * np.sin(y)], axis=-1)
    acceleration = amplitude * np.stack([-4 * np.sin(x), -9 * np.cos(y)], axis=-1)
    return position, velocity, acceleration


def start(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(position, velocity) at time 0, (particles, 2) float64 each, in builder order."""
    position, pinned = rest(scene), pinned_mask(scene)
    velocity = np.zeros_like(position)
    if scene.perturbation:
        i, j = np.mgrid[: scene.grid.rows, : scene.grid.columns]
        offset = scene.perturbation.amplitude * np.stack(
            [np.sin(1.7 * i + 0.9 * j), np.cos(0.6 * i - 1.3 * j)], axis=-1
        )
        position[~pinned] += offset[~pinned]
    if scene.manufactured:
        motion, velocity, _ = manufactured_motion(scene, 0.0)
        position = position + (motion - rest(scene))
        velocity[pinned] = 0
    return position.reshape(-1, 2), velocity.reshape(-1, 2)


def spring_forces(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(rows, columns, 2) [N] at positions (rows, columns, 2): Hooke's law along every spring, to both of its ends."""
    force = np.zeros_like(position)
    if scene.springs is None:
        return force
    k, rest_length = scene.springs.stiffness, scene.springs.rest_length
    for axis in (0, 1):
        p, f = np.moveaxis(position, axis, 0), np.moveaxis(force, axis, 0)  # views: writing to f writes to force
        d = p[1:] - p[:-1]
        length = np.hypot(d[..., :1], d[..., 1:])
        direction = np.divide(d, length, out=np.zeros_like(d), where=length > 0)
        pull = k * (length - rest_length) * direction
        f[:-1] += pull
        f[1:] -= pull
    return force


def _force_without_damping(scene: Scene, position: np.ndarray, time: float, step: int, poke: Poke | None) -> np.ndarray:
    grid = scene.grid
    force = spring_forces(scene, position)
    if scene.gravity and scene.gravity.enabled:
        force[..., 1] -= grid.mass * scene.gravity.acceleration
    if scene.external and scene.external.magnitude > 0:
        force += scene.external.magnitude * random_directions(scene.external.seed, step, grid.particle_count).reshape(
            force.shape
        )
    if scene.manufactured:
        p, v, a = manufactured_motion(scene, time)
        inner = spring_forces(scene, p)
        if scene.gravity and scene.gravity.enabled:
            inner[..., 1] -= grid.mass * scene.gravity.acceleration
        if scene.damping:
            inner -= scene.damping.coefficient * v
        force += scene.manufactured.inertia * grid.mass * a - inner
    if poke is not None and poke[0] is not None:
        force[divmod(poke[0], grid.columns)] += poke[1]
    return force


def _one_step(
    integrator: str,
    p: np.ndarray,
    v: np.ndarray,
    t: float,
    dt: float,
    a: Accelerate,
    undamped: Accelerate,
    gamma: float,
) -> tuple[np.ndarray, np.ndarray]:
    """One step of `integrator`; a(p, v, t) is the whole acceleration, `undamped` the one without the damper."""
    if integrator == "lab":
        new = p + v * dt + a(p, v, t) * dt**2 / 2
        return new, (new - p) / dt
    if integrator == "semi-implicit-euler":
        v = v + dt * a(p, v, t)
        return p + dt * v, v
    if integrator == "explicit-euler":
        return p + dt * v, v + dt * a(p, v, t)
    if integrator == "taylor":
        now = a(p, v, t)
        return p + v * dt + now * dt**2 / 2, v + now * dt
    if integrator == "velocity-verlet":
        half = v + dt / 2 * a(p, v, t)
        p = p + dt * half
        return p, (half + dt / 2 * undamped(p, half, t + dt)) / (1 + dt * gamma / 2)
    if integrator == EXPLICIT_DAMPING_VERLET:  # the damper takes the half-step velocity: first order with damping
        half = v + dt / 2 * a(p, v, t)
        p = p + dt * half
        return p, half + dt / 2 * a(p, half, t + dt)
    if integrator == "rk4":
        p1, v1 = v, a(p, v, t)
        p2, v2 = v + dt / 2 * v1, a(p + dt / 2 * p1, v + dt / 2 * v1, t + dt / 2)
        p3, v3 = v + dt / 2 * v2, a(p + dt / 2 * p2, v + dt / 2 * v2, t + dt / 2)
        p4, v4 = v + dt * v3, a(p + dt * p3, v + dt * v3, t + dt)
        return p + dt / 6 * (p1 + 2 * p2 + 2 * p3 + p4), v + dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
    raise SceneError("method.integrator", integrator, "the reference does not know it")


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
    """(position [m], velocity [m/s]), (particles, 2) float64 in builder order, after `steps` steps of `method.dt`.

    `position`, `velocity` (particles, 2): where to start (None: the scene's own start). `first_step`: the number of the
    first step, for the random force and the time of the manufactured one. `poke`: (particle, (fx, fy) [N]), held for
    all steps. `integrator` replaces the scene's. `inertia` multiplies every mass but gravity's: 2 gives the motion
    x'' = a/2 that the hand-out's step converges to (docs/method.md, fact 1). Nothing is checked for divergence.
    """
    grid, dt = scene.grid, scene.method.dt
    shape = (grid.rows, grid.columns, 2)
    begin_position, begin_velocity = start(scene)
    p = np.array(begin_position if position is None else position, dtype=np.float64).reshape(shape)
    v = np.array(begin_velocity if velocity is None else velocity, dtype=np.float64).reshape(shape)
    free = ~pinned_mask(scene)[..., None]
    v *= free
    mass = inertia * grid.mass
    gamma = (scene.damping.coefficient if scene.damping else 0.0) / mass
    method = integrator or scene.method.integrator
    with np.errstate(over="ignore", invalid="ignore"):  # over its limit an explicit scheme does overflow
        for step in range(first_step, first_step + steps):

            def undamped(p: np.ndarray, v: np.ndarray, t: float, step: int = step) -> np.ndarray:
                return np.where(free, _force_without_damping(scene, p, t, step, poke) / mass, 0.0)

            def whole(p: np.ndarray, v: np.ndarray, t: float, undamped: Accelerate = undamped) -> np.ndarray:
                return undamped(p, v, t) - gamma * v

            p, v = _one_step(method, p, v, step * dt, dt, whole, undamped, gamma)
    return p.reshape(-1, 2), v.reshape(-1, 2)


def converged(
    scene: Scene, time: float, *, inertia: float = 1.0, tolerance: float = 1e-9, most_steps: int = 200_000
) -> tuple[np.ndarray, np.ndarray, float]:
    """(position, velocity, error estimate [m]) of the scene's motion at `time` [s], by RK4 and Richardson.

    RK4 at h and h/2; with order 4 the finer one is off by their difference / 15, which is removed (Hairer, Norsett,
    Wanner, "Solving ODEs I", II.4). What remains is smaller than that difference / 15, whose maximum over the masses is
    the estimate. h is halved until the estimate is under `tolerance` times the spacing, or `most_steps` are reached.

    Raises SceneError for a random force, which is another force at every step size. `inertia`: see `simulate`.
    """
    if scene.external and scene.external.magnitude > 0:
        raise SceneError("external.magnitude", scene.external.magnitude, "must be 0 for a converged reference")
    stiffness = scene.springs.stiffness if scene.springs else 0.0
    fastest = (
        sqrt(8 * stiffness / scene.grid.mass) + (scene.damping.coefficient if scene.damping else 0.0) / scene.grid.mass
    )
    steps = max(8, ceil(time * fastest * 4))  # h w = 1/4 to begin with

    def solve(count: int) -> tuple[np.ndarray, np.ndarray]:
        return simulate(scene.replace({"method.dt": time / count}), count, integrator="rk4", inertia=inertia)

    coarse = solve(steps)
    while True:
        fine = solve(2 * steps)
        change = [(b - a) / 15 for a, b in zip(coarse, fine, strict=True)]
        estimate = float(np.max(np.hypot(change[0][:, 0], change[0][:, 1])))
        if estimate <= tolerance * scene.grid.spacing or 4 * steps > most_steps:
            return fine[0] + change[0], fine[1] + change[1], estimate
        coarse, steps = fine, 2 * steps


def first_bad(scene: Scene, steps: int, bound: float) -> tuple[int, int] | None:
    """(step, particle) where a coordinate first is beyond `bound` [m] or not finite, within `steps`; None if nowhere.

    `step` counts the steps done, `particle` is the lowest such index.
    """
    position, velocity = start(scene)
    for step in range(steps):
        position, velocity = simulate(scene, 1, position, velocity, step)
        bad = ~((np.abs(position) <= bound).all(axis=1) & np.isfinite(velocity).all(axis=1))
        if bad.any():
            return step + 1, int(np.argmax(bad))
    return None
