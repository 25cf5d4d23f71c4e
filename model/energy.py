"""Energies, strain and momentum of a grid, in float64 on the host; for judging and showing, not for stepping."""

from __future__ import annotations

import numpy as np

from model.scene import Scene


def _lengths(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths [m] of the horizontal (rows, columns - 1) and vertical (rows - 1, columns) springs."""
    grid = scene.grid
    p = np.asarray(position, dtype=np.float64).reshape(grid.rows, grid.columns, 2)
    across, down = p[:, 1:] - p[:, :-1], p[1:] - p[:-1]
    return np.hypot(across[..., 0], across[..., 1]), np.hypot(down[..., 0], down[..., 1])


def spring_strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(springs,) float64: (length - rest) / rest of the horizontal springs row by row, then of the vertical ones.

    For a rest length of zero: length / spacing. In the order of `spring_ends`.
    """
    across, down = _lengths(scene, position)
    length = np.concatenate([across.ravel(), down.ravel()])
    rest = scene.springs.rest_length if scene.springs else scene.grid.spacing
    return length / scene.grid.spacing if rest == 0 else (length - rest) / rest


def spring_ends(rows: int, columns: int) -> np.ndarray:
    """(springs, 2) int32: the particles at the ends of every spring, horizontal ones row by row, then vertical ones."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    across = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1)
    down = np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)
    return np.ascontiguousarray(np.concatenate([across, down]))


def energies(scene: Scene, position: np.ndarray, velocity: np.ndarray) -> dict[str, float]:
    """Energies in joules: `kinetic`, `spring`, `gravity`, `potential` (both), `total`, `conserved`.

    With the true mass. Gravity's zero is at y = 0. `conserved` is what the scheme itself keeps (up to a bounded
    wobble) without damping: the total, except for the hand-out's step `lab`, which moves exactly like semi-implicit
    Euler with doubled masses under the same forces, and so keeps 2 * kinetic + potential.
    """
    grid, springs, gravity = scene.grid, scene.springs, scene.gravity
    v = np.asarray(velocity, dtype=np.float64)
    kinetic = 0.5 * grid.mass * float(np.sum(v * v))
    spring = 0.0
    if springs:
        for length in _lengths(scene, position):
            spring += 0.5 * springs.stiffness * float(np.sum((length - springs.rest_length) ** 2))
    height = 0.0
    if gravity and gravity.enabled:
        y = np.asarray(position, dtype=np.float64)[:, 1]
        height = grid.mass * gravity.acceleration * float(np.sum(y))
    potential = spring + height
    inertia = 2.0 if scene.method.integrator == "lab" else 1.0
    return {
        "kinetic": kinetic,
        "spring": spring,
        "gravity": height,
        "potential": potential,
        "total": kinetic + potential,
        "conserved": inertia * kinetic + potential,
    }
