"""Attachments as springs (model/tetrahedra/springs.py) on CPU threads: the contribution of one particle's springs."""

from __future__ import annotations

from softlab.model.base.variant import routine, unrolled
from softlab.model.formulas.elastic.spring import CORNERS, COUNT, pull


@routine
def row(points, k):
    """Return a point, three numbers."""
    return points[k, 0], points[k, 1], points[k, 2]


@routine
def pulled(k, position, springs):
    """Return the sum over all springs of particle k, in their order: the derivative (three numbers), the diagonal of the
    block, and the energy that particle k counts. `springs`: SpringArrays."""
    offsets, entries, corners, values = springs
    x, y, z, hard, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(offsets[k], offsets[k + 1]):
        entry = entries[n]
        one = entry >> 4
        points = tuple(row(position, corners[one, m]) for m in unrolled(CORNERS))
        numbers = tuple(values[one, m] for m in unrolled(COUNT))
        p, q, r, stiffness, energy = pull(points, numbers, (entry >> 1) & 7)
        x, y, z, hard = x + p, y + q, z + r, hard + stiffness
        if entry & 1:
            total = total + energy
    return x, y, z, hard, total
