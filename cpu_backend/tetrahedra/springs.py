"""Attachments as springs (model/tetrahedra/springs.py) on CPU threads: the contribution of one particle's springs."""

from __future__ import annotations

from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.spring import pull


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
        points = (
            row(position, corners[one, 0]), row(position, corners[one, 1]), row(position, corners[one, 2]),
            row(position, corners[one, 3]), row(position, corners[one, 4]),
        )  # fmt: skip
        numbers = (
            values[one, 0], values[one, 1], values[one, 2], values[one, 3], values[one, 4], values[one, 5],
            values[one, 6], values[one, 7],
        )  # fmt: skip
        p, q, r, stiffness, energy = pull(points, numbers, (entry >> 1) & 7)
        x, y, z, hard = x + p, y + q, z + r, hard + stiffness
        if entry & 1:
            total = total + energy
    return x, y, z, hard, total
