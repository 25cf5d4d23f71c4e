"""Position-based tetrahedra whose voxels keep their volume as a whole, in slow, plain NumPy float64: the reference.

The shapes of all tetrahedra are the rows of bench/reference/tetrahedra.py. Then each voxel follows: with the rest
volumes V of its tetrahedra and J = det F

 C = sum V J / sum V - 1,    dC / dx of a corner = sum over its tetrahedra V cof(F) g / sum V,    g of its hat,

with the compliance 1 / sum V lambda.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.bench.reference.elastic_materials import cofactor
from softlab.bench.reference.finite_elements import Body
from softlab.bench.reference.tetrahedra import SHAPE, Method, Sweep


def restore_volume(sweep: Sweep, members: np.ndarray, position: np.ndarray, multiplier: float) -> float:
    """Move the corners of the tetrahedra `members` of one voxel, in place, and return its multiplier [J s^2]."""
    body, volume = sweep.body, sweep.body.volume[members]
    f = sweep.gradient(members, position)
    gradients = (volume / volume.sum())[:, None, None] * (cofactor(f) @ np.swapaxes(body.gradient[members], 1, 2))
    slope = np.zeros_like(position)
    np.add.at(slope, body.tetrahedra[members], np.swapaxes(gradients, 1, 2))
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
    voxels: Sequence[np.ndarray],
    h: float,
    substeps: int,
    method: Method,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position [m], velocity [m/s]), (n, 3), after that many `substeps` of h [s].

    `voxels`: the tetrahedra of each, in the order of their projection; other arguments as in bench/reference/tetrahedra.py.
    """
    p, v, free = position.copy(), velocity.copy(), (inverse_mass > 0)[:, None]
    for _ in range(substeps):
        begin = p.copy()
        p = begin + h * np.where(free, v + h * np.asarray(method.gravity), 0.0)
        shape = np.zeros((len(body.tetrahedra), 3, 3))
        sweep = Sweep(body, inverse_mass, begin, h, method.damping_time / h, shape, shape[:, 0, 0].copy())
        multipliers = np.zeros(len(voxels))
        for _ in range(method.iterations):
            for members in method.order:
                if body.material == "neo-hookean":
                    sweep.descend(members, p)
                else:
                    sweep.rows(members, p, (SHAPE,))
            for number, members in enumerate(voxels):
                multipliers[number] = restore_volume(sweep, members, p, multipliers[number])
        v = (p - begin) / h
    return p, v
