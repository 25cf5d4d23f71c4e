"""Attachments as springs (model/tetrahedra/springs.py) on CUDA: the contribution of one particle's springs.

Corners and values are flat, spring by spring.
"""

from __future__ import annotations

from softlab.gpu_backend.core.quads import load_quad
from softlab.model.base.variant import inlined_routine, unrolled
from softlab.model.formulas.elastic.spring import CORNERS, COUNT, pull


@inlined_routine
def xyz(quad):
    return quad[0], quad[1], quad[2]


@inlined_routine
def pulled(k, position, springs):
    """Return the sum over all springs of particle k, in their order: the derivative (three numbers), the diagonal of the
    block, and the energy that particle k counts."""
    offsets, entries, corners, values = springs
    x, y, z, hard, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(offsets[k], offsets[k + 1]):
        entry = entries[n]
        c, v = CORNERS * (entry >> 4), COUNT * (entry >> 4)
        points = tuple(xyz(load_quad(position, corners[c + m])) for m in unrolled(CORNERS))
        numbers = tuple(values[v + m] for m in unrolled(COUNT))
        p, q, r, stiffness, energy = pull(points, numbers, (entry >> 1) & 7)
        x, y, z, hard = x + p, y + q, z + r, hard + stiffness
        if entry & 1:
            total = total + energy
    return x, y, z, hard, total
