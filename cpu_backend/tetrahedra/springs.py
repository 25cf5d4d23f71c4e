"""Attachments as springs (model/tetrahedra/springs.py) on CPU threads: the contribution of one particle's springs."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import spring


def make_springs(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `pulled(k, position, springs)`: the sum over all springs of particle k, in their order.

    It returns the derivative (three numbers), the diagonal of the block, and the energy that particle k counts.
    `springs`: SpringArrays.
    """
    compiled = compiler.compiled
    pull, zero = compiler.formulas(spring, real).pull, real(0)

    @compiled
    def row(position, k):
        return position[k, 0], position[k, 1], position[k, 2]

    @compiled
    def pulled(k, position, springs):
        offsets, entries, corners, values = springs
        x, y, z, hard, total = zero, zero, zero, zero, zero
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

    return SimpleNamespace(pulled=pulled)
