"""Sums over all masses of a sheet in one fixed order, for any number of threads; the GPU uses the same order.

A row is divided into segments. In a segment LANES running sums add every LANES-th mass, then the lanes are added up in
halves. Of all segments' sums, row by row, TREE running sums add every TREE-th; these are added up in halves.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas import lengths
from softlab.model.mass_spring.implicit_parameters import LANES, SEGMENT, TREE


def make_sums_over_masses(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `segment_sums(columns, ax, ay, az, bx, by, bz, lanes, out)`, a . b of a row's vectors, segment by segment,
    and `total(parts, count, tree)`, the sum of the first `count` of `parts`. `lanes` (LANES,) and `tree` (TREE,) are
    scratch."""
    dot, zero = compiler.formulas(lengths, real).dot, real(0)

    @compiler.row
    def segment_sum(first, last, ax, ay, az, bx, by, bz, lanes):
        for lane in range(LANES):
            lanes[lane] = zero
        whole = first + (last - first) // LANES * LANES
        for j in range(first, whole, LANES):
            for lane in range(LANES):
                k = j + lane
                lanes[lane] = lanes[lane] + dot(ax[k], ay[k], az[k], bx[k], by[k], bz[k])
        for k in range(whole, last):
            lanes[k - whole] = lanes[k - whole] + dot(ax[k], ay[k], az[k], bx[k], by[k], bz[k])
        half = LANES // 2
        while half > 0:
            for lane in range(half):
                lanes[lane] = lanes[lane] + lanes[lane + half]
            half //= 2
        return lanes[0]

    @compiler.compiled
    def segment_sums(columns, ax, ay, az, bx, by, bz, lanes, out):
        for segment in range((columns + SEGMENT - 1) // SEGMENT):
            first = segment * SEGMENT
            out[segment] = segment_sum(first, min(first + SEGMENT, columns), ax, ay, az, bx, by, bz, lanes)

    @compiler.compiled
    def total(parts, count, tree):
        for k in range(TREE):
            tree[k] = zero
        for first in range(0, count, TREE):
            for k in range(min(TREE, count - first)):
                tree[k] = tree[k] + parts[first + k]
        half = TREE // 2
        while half > 0:
            for k in range(half):
                tree[k] = tree[k] + tree[k + half]
            half //= 2
        return tree[0]

    return SimpleNamespace(segment_sums=segment_sums, total=total)
