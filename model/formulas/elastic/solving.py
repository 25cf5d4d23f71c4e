"""Products in the passes of Newton's method on tetrahedra. They are here so that none is contracted."""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import dot


@formula
def times(a, b):
    return a * b


@formula
def scaled(s, x, y, z):
    return s * x, s * y, s * z


@formula
def weighted(s, m):
    """Matrix of nine numbers times s."""
    return s * m[0], s * m[1], s * m[2], s * m[3], s * m[4], s * m[5], s * m[6], s * m[7], s * m[8]


@formula
def preconditioned(m, x, y, z):
    """Symmetric block (xx, xy, xz, yy, yz, zz) times a vector."""
    return dot(m[0], m[1], m[2], x, y, z), dot(m[1], m[3], m[4], x, y, z), dot(m[2], m[4], m[5], x, y, z)
