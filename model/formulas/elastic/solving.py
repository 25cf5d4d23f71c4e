"""Products in the passes of Newton's method on tetrahedra. They are here so that none is contracted."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain
from softlab.model.formulas.elastic.descent import make_matrices
from softlab.model.formulas.lengths import make as make_lengths


def make(real, compiled=plain):
    """Make the products of one particle, row or tetrahedron, in the arithmetic `real`."""
    dot = make_lengths(real, compiled).dot
    applied = make_matrices(real, compiled).times  # a 3 x 3 block, by rows, times a vector

    @compiled
    def times(a, b):
        return a * b

    @compiled
    def scaled(s, x, y, z):
        return s * x, s * y, s * z

    @compiled
    def weighted(s, m):
        """Matrix of nine numbers times s."""
        return s * m[0], s * m[1], s * m[2], s * m[3], s * m[4], s * m[5], s * m[6], s * m[7], s * m[8]

    @compiled
    def preconditioned(m, x, y, z):
        """Symmetric block (xx, xy, xz, yy, yz, zz) times a vector."""
        return dot(m[0], m[1], m[2], x, y, z), dot(m[1], m[3], m[4], x, y, z), dot(m[2], m[4], m[5], x, y, z)

    return SimpleNamespace(
        times=times, scaled=scaled, weighted=weighted, applied=applied, preconditioned=preconditioned,
        dot=dot,
    )  # fmt: skip
