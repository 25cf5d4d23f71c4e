"""Attachments as springs (model/tetrahedra/springs.py) on CUDA: the contribution of one particle's springs.

Corners and values are flat, spring by spring.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import spring


@cache
def make_pulled(real: Real, math: str) -> Callable:
    """Make pulled(k, position, springs): the sum over all springs of particle k, in their
    order.

    It returns the derivative (three numbers), the diagonal of the block, and the energy that particle k counts.
    """
    pull, zero, inline = device_formulas(spring, real, math).pull, real(0), inlined(math)
    one, four, seven = np.int32(1), np.int32(4), np.int32(7)
    wide, long = np.int32(spring.CORNERS), np.int32(spring.COUNT)

    @inline
    def xyz(quad):
        return quad[0], quad[1], quad[2]

    @inline
    def pulled(k, position, springs):
        offsets, entries, corners, values = springs
        x, y, z, hard, total = zero, zero, zero, zero, zero
        for n in range(offsets[k], offsets[k + one]):
            entry = entries[n]
            c, v = wide * (entry >> four), long * (entry >> four)
            points = (
                xyz(load_quad(position, corners[c])), xyz(load_quad(position, corners[c + 1])),
                xyz(load_quad(position, corners[c + 2])), xyz(load_quad(position, corners[c + 3])),
                xyz(load_quad(position, corners[c + 4])),
            )  # fmt: skip
            numbers = (
                values[v], values[v + 1], values[v + 2], values[v + 3], values[v + 4], values[v + 5], values[v + 6],
                values[v + 7],
            )  # fmt: skip
            p, q, r, stiffness, energy = pull(points, numbers, (entry >> one) & seven)
            x, y, z, hard = x + p, y + q, z + r, hard + stiffness
            if entry & one:
                total = total + energy
        return x, y, z, hard, total

    return pulled
