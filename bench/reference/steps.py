"""Common parts of references: pins, one step of every integrator, and motions in which others can intervene."""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.pins import MeshPins
from softlab.model.scene.scene import Scene

Poke = tuple[int, tuple[float, ...]]
Accelerate = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
Settle = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
# Steps that pause after the prediction of a substep and after each of its iterations: the generator yields the
# positions at the beginning and the current ones, receives the current ones to continue with, and returns positions and
# velocities
Motion = Generator[tuple[np.ndarray, np.ndarray], np.ndarray, tuple[np.ndarray, np.ndarray]]

# not an integrator of scenes: it shows the error of an explicit damper
EXPLICIT_DAMPING_VERLET = "velocity-verlet-explicit-damping"


def alone(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the result of a motion without any intervention."""
    try:
        _, now = next(motion)
        while True:
            _, now = motion.send(now)
    except StopIteration as ended:
        end_state: tuple[np.ndarray, np.ndarray] = ended.value
        return end_state


def pinned_mask(scene: Scene) -> np.ndarray:
    """Return the mask (rows, columns) of the masses that `grid.pinned` fixes."""
    return named_mask(scene.grid.pinned, scene.grid.rows, scene.grid.columns)


def named_mask(pins: MeshPins, rows: int, columns: int) -> np.ndarray:
    """Return the mask (rows, columns) of the masses of a sheet that `pins` names."""
    mask = np.zeros((rows, columns), dtype=bool)
    if isinstance(pins, list):
        for row, column in np.reshape(pins, (-1, 2)):
            mask[row, column] = True
    elif pins == "top-corners":
        mask[0, 0] = mask[0, -1] = True
    elif pins.startswith("every:"):
        mask[0, :: int(pins.removeprefix("every:"))] = True
    if pins in ("top", "top-bottom", "edges"):
        mask[0] = True
    if pins in ("bottom", "top-bottom", "edges"):
        mask[-1] = True
    if pins in ("left", "left-right", "edges"):
        mask[:, 0] = True
    if pins in ("right", "left-right", "edges"):
        mask[:, -1] = True
    return mask


def masses(scene: Scene) -> float | np.ndarray:
    """Return the mass of each particle [kg], pinned or not: (rows, columns, 1), or a number if all are equal."""
    if not scene.loads:
        return scene.grid.mass
    mass = np.full((scene.grid.rows, scene.grid.columns, 1), scene.grid.mass)
    for load in scene.loads.values():
        mass[load.at] = load.mass
    return mass


def one_step(
    integrator: str,
    p: np.ndarray,
    v: np.ndarray,
    t: float,
    dt: float,
    a: Accelerate,
    undamped: Accelerate,
    gamma: float | np.ndarray,
    settle: Settle = lambda before, p, v: (p, v),
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) after one step of `integrator`.

    a(p, v, t) is the whole acceleration, `undamped` the one without the damper. `settle(position before the step,
    position, velocity)` applies colliders to the new position and its velocity, before velocity Verlet's second half
    kick.
    """
    if integrator == "lab":
        new = p + v * dt + a(p, v, t) * dt**2 / 2
        return settle(p, new, (new - p) / dt)
    if integrator == "semi-implicit-euler":
        w = v + dt * a(p, v, t)
        return settle(p, p + dt * w, w)
    if integrator == "explicit-euler":
        return settle(p, p + dt * v, v + dt * a(p, v, t))
    if integrator == "taylor":
        now = a(p, v, t)
        return settle(p, p + v * dt + now * dt**2 / 2, v + now * dt)
    if integrator in ("velocity-verlet", EXPLICIT_DAMPING_VERLET):
        half = v + dt / 2 * a(p, v, t)
        p, half = settle(p, p + dt * half, half)
        if integrator == "velocity-verlet":
            return p, (half + dt / 2 * undamped(p, half, t + dt)) / (1 + dt * gamma / 2)
        return p, half + dt / 2 * a(p, half, t + dt)  # the damper at half a step: first order
    if integrator == "rk4":
        p1, v1 = v, a(p, v, t)
        p2, v2 = v + dt / 2 * v1, a(p + dt / 2 * p1, v + dt / 2 * v1, t + dt / 2)
        p3, v3 = v + dt / 2 * v2, a(p + dt / 2 * p2, v + dt / 2 * v2, t + dt / 2)
        p4, v4 = v + dt * v3, a(p + dt * p3, v + dt * v3, t + dt)
        return settle(p, p + dt / 6 * (p1 + 2 * p2 + 2 * p3 + p4), v + dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4))
    raise SceneError("method.integrator", integrator, "the reference does not support it")
