"""Implicit Euler on a cloth in slow, plain NumPy float64: the reference of both backends.

From the papers, without model/formulas or a backend. Baraff and Witkin, "Large steps in cloth simulation", SIGGRAPH
1998 (eq. 4 to 6); Choi and Ko, "Stable but responsive cloth", SIGGRAPH 2002 (a compressed spring has no transverse
stiffness). The new velocity u of every mass, over its mass m, solves

 u = v + h (spring forces at (p + h u, u) + other forces at (p, v)) / m - h (c / m) u,        p' = p + h u.

A Newton step from u adds the s that solves (1 + h c/m) s + sum over springs B (s_own - s_other) = residual, where

 B = (h^2 k [n n^T + max(0, 1 - L/|d|) (I - n n^T)] + h c_s n n^T) / m,      n = d / |d|.

Times the masses the matrix is symmetric, and none of its eigenvalues is below 1. Clamping changes the path to the
solution, not the solution: for springs under tension and without dampers it is Newton's method, else a quasi-Newton
one. The first step is taken from u = 0, where masses are at p: it is the step of Baraff and Witkin, who write it for
the change of velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softlab.bench.reference import cloth
from softlab.bench.reference.steps import Poke, masses, pinned_mask
from softlab.model.scene.scene import Scene

NAMES = ("implicit-euler", "implicit-euler-linear")
ENOUGH = 1e-13  # residual relative to the first one
MOST = 400  # largest number of quasi-Newton steps


@dataclass
class Solution:
    """Result of one step.

    `velocity` (rows, columns, 3) [m/s]; `residuals` [m/s], Euclidean norms, before each Newton step and after the last;
    `first` (rows, columns, 3): the velocity after one Newton step.
    """

    velocity: np.ndarray
    residuals: list[float] = field(default_factory=list)
    first: np.ndarray | None = None


def system(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return the matrix over the mass at positions (rows, columns, 3) [m], pinned masses fixed: (3 particles, 3
    particles).
    """
    h = scene.method.dt
    shape = position.shape[:2]
    count = shape[0] * shape[1]
    number = np.arange(count).reshape(shape)
    mass = np.broadcast_to(masses(scene), (*shape, 1)).reshape(count, 1, 1)
    blocks = np.zeros((count, 3, count, 3))
    every = np.arange(count)
    blocks[every, :, every, :] = np.eye(3) * (1 + h * (scene.damping.coefficient if scene.damping else 0.0) / mass)
    for kind, springs in scene.cloth_springs.items():
        for offset in cloth.OFFSETS[kind]:
            first, second = (ends.ravel() for ends in cloth.ends(number, offset))
            d = position.reshape(-1, 3)[second] - position.reshape(-1, 3)[first]
            length = np.linalg.norm(d, axis=1)[:, None, None]
            n = np.divide(d, length[:, :, 0], out=np.zeros_like(d), where=length[:, :, 0] > 0)
            along = n[:, :, None] * n[:, None, :]
            rest = scene.grid.spacing * np.hypot(*offset)
            across = np.maximum(1 - np.divide(rest, length, out=np.zeros_like(length), where=length > 0), 0.0)
            stiff = h * h * springs.stiffness * (along + across * (np.eye(3) - along)) + h * springs.damping * along
            for a, b, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
                place: Any = (a, slice(None), b, slice(None))
                np.add.at(blocks, place, sign * stiff / mass[a])
    pinned = np.flatnonzero(pinned_mask(scene))
    blocks[pinned] = 0
    blocks[:, :, pinned] = 0
    blocks[pinned, :, pinned, :] = np.eye(3)
    return blocks.reshape(3 * count, 3 * count)


def solve(
    scene: Scene, position: np.ndarray, velocity: np.ndarray, other: np.ndarray, linear: bool, end: float
) -> Solution:
    """Return the new velocities from `position` [m] and `velocity` [m/s], under `other` forces [m/s^2].

    Arrays are (rows, columns, 3). `end` [s]: the end of the step, for moving pins. A step is halved while the residual
    along it has reversed by more than nine tenths (Nocedal and Wright, Numerical Optimization, eq. 3.7b, its upper
    half).
    """
    h, mass, free = scene.method.dt, masses(scene), ~pinned_mask(scene)[..., None]
    rate = (scene.damping.coefficient if scene.damping else 0.0) / mass

    def at(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (position, residual) of the new velocities u."""
        x, u = cloth.follow(scene, position + h * u, u, end)
        force = cloth.spring_forces(scene, x, u) / mass
        return x, np.where(free, velocity + h * (force + other) - h * rate * u - u, 0.0)

    u = np.zeros_like(velocity)
    x, residual = at(u)
    solution = Solution(u, [float(np.linalg.norm(residual))])
    while solution.residuals[-1] > ENOUGH * solution.residuals[0] and len(solution.residuals) <= MOST:
        s = np.linalg.solve(system(scene, x), residual.ravel()).reshape(u.shape)
        weighted = mass * s
        slope, part = float(np.vdot(residual, weighted)), 1.0
        if linear:
            solution.velocity = s
            return solution
        x, residual = at(u + s)
        while np.vdot(residual, weighted) < -0.9 * slope and part > 2**-10:
            part /= 2
            x, residual = at(u + part * s)
        u = u + part * s
        if solution.first is None:
            solution.first = u
        solution.residuals.append(float(np.linalg.norm(residual)))
        if len(solution.residuals) > 8 and solution.residuals[-1] > 0.99 * max(solution.residuals[-4:-1]):
            break  # limited by rounding
    solution.velocity = u
    return solution


def other_forces(
    scene: Scene, position: np.ndarray, velocity: np.ndarray, step: int, poke: Poke | None = None
) -> np.ndarray:
    """Return all accelerations but those of springs and the masses' damper, at the start of the step: (rows, columns,
    3) [m/s^2].
    """
    time = step * scene.method.dt
    position, velocity = cloth.follow(scene, position, velocity, time)
    whole = cloth.forces(scene, position, velocity, time, step, poke)
    return (whole - cloth.spring_forces(scene, position, velocity)) / masses(scene)


def simulate(
    scene: Scene,
    steps: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    first_step: int = 0,
    poke: Poke | None = None,
    *,
    linear: bool | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]) after `steps` steps of `method.dt`, (particles, 3) float64 each.

    Particles are in builder order. Arguments as in bench.reference.mass_spring.simulate. `linear`: one step of Baraff
    and Witkin instead of a full solve; None: as the scene's integrator says.
    """
    begin, at_rest = cloth.start(scene)
    shape = (scene.grid.rows, scene.grid.columns, 3)
    p = np.array(begin if position is None else position, dtype=np.float64).reshape(shape)
    v = np.array(at_rest if velocity is None else velocity, dtype=np.float64).reshape(shape)
    v *= ~pinned_mask(scene)[..., None]
    once = scene.method.integrator == NAMES[1] if linear is None else linear
    h = scene.method.dt
    for step in range(first_step, first_step + steps):
        end = (step + 1) * h
        u = solve(scene, p, v, other_forces(scene, p, v, step, poke), once, end).velocity
        x, u = cloth.follow(scene, p + h * u, u, end)
        p, v = cloth.collide(scene, p, x, u, step)
        p, v = cloth.follow(scene, p, v, end)
    return p.reshape(-1, 3), v.reshape(-1, 3)
