"""Position-based tetrahedra whose voxels keep their volume as a whole, in slow, plain NumPy float64: a judge of both
backends.

The shapes of all tetrahedra are the rows of bench/reference/tetrahedra.py. Then comes each voxel: with the volumes V of its
tetrahedra at rest and J = det F

    C = sum V J / sum V - 1,    dC / dx of a corner = sum over its tetrahedra V cof(F) g / sum V,    g of its hat,

of the compliance 1 / sum V lambda.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.reference.elastic_materials import cofactor
from bench.reference.finite_elements import Body
from bench.reference.tetrahedra import SHAPE, Sweep


def keep_volume(sweep: Sweep, members: np.ndarray, position: np.ndarray, multiplier: float) -> float:
    """Moves the corners of the tetrahedra `members` of one voxel, in place; its multiplier [J s^2]."""
    body, volume = sweep.body, sweep.body.volume[members]
    f = sweep.gradient(members, position)
    ways = (volume / volume.sum())[:, None, None] * (cofactor(f) @ np.swapaxes(body.gradient[members], 1, 2))
    slope = np.zeros_like(position)
    np.add.at(slope, body.tetrahedra[members], np.swapaxes(ways, 1, 2))
    violation = float((volume * np.linalg.det(f)).sum() / volume.sum()) - 1
    alpha = 1 / float((body.lam[members] * volume).sum()) / sweep.h**2
    rate = sweep.gamma * float((slope * (position - sweep.before)).sum())
    weight = float((sweep.inverse_mass * (slope**2).sum(axis=1)).sum())
    change = (-violation - alpha * multiplier - rate) / ((1 + sweep.gamma) * weight + alpha)
    position += sweep.inverse_mass[:, None] * change * slope
    return multiplier + change


def simulate(
    body: Body,
    position: np.ndarray,
    velocity: np.ndarray,
    inverse_mass: np.ndarray,
    order: Sequence[np.ndarray],
    voxels: Sequence[np.ndarray],
    h: float,
    substeps: int,
    iterations: int,
    gravity: tuple[float, float, float],
    damping_time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(position [m], velocity [m/s]), (n, 3), after so many `substeps` of h [s]. `order`: sets of tetrahedra without a common
    vertex, one after the other; `voxels`: the tetrahedra of each, in the order in which they keep their volumes; the rest as
    in bench/reference/tetrahedra.py."""
    p, v, free = position.copy(), velocity.copy(), (inverse_mass > 0)[:, None]
    for _ in range(substeps):
        begin = p.copy()
        p = begin + h * np.where(free, v + h * np.asarray(gravity), 0.0)
        shape = np.zeros((len(body.tetrahedra), 3, 3))
        sweep = Sweep(body, inverse_mass, begin, h, damping_time / h, shape, shape[:, 0, 0].copy())
        held = np.zeros(len(voxels))
        for _ in range(iterations):
            for members in order:
                if body.material == "neo-hookean":
                    sweep.descend(members, p)
                else:
                    sweep.rows(members, p, (SHAPE,))
            for number, members in enumerate(voxels):
                held[number] = keep_volume(sweep, members, p, held[number])
        v = (p - begin) / h
    return p, v
