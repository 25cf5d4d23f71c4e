"""Sums over all masses of a sheet in one fixed order, for any number of threads; the GPU uses the same order.

A row is divided into segments. In a segment LANES running sums add every LANES-th mass, then the lanes are added up in
halves. Of all segments' sums, row by row, TREE running sums add every TREE-th; these are added up in halves.
"""

from __future__ import annotations

from softlab.model.base.variant import routine, row_routine
from softlab.model.formulas.lengths import dot
from softlab.model.mass_spring.implicit_parameters import LANES, SEGMENT, TREE


@row_routine
def segment_sum(first, last, ax, ay, az, bx, by, bz, lanes):
    for lane in range(LANES):
        lanes[lane] = 0.0
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


@routine
def segment_sums(columns, ax, ay, az, bx, by, bz, lanes, out):
    """Write a . b of a row's vectors, segment by segment; `lanes` (LANES,) is scratch."""
    for segment in range((columns + SEGMENT - 1) // SEGMENT):
        first = segment * SEGMENT
        out[segment] = segment_sum(first, min(first + SEGMENT, columns), ax, ay, az, bx, by, bz, lanes)


@routine
def total(parts, count, tree):
    """Return the sum of the first `count` of `parts`; `tree` (TREE,) is scratch."""
    for k in range(TREE):
        tree[k] = 0.0
    for first in range(0, count, TREE):
        for k in range(min(TREE, count - first)):
            tree[k] = tree[k] + parts[first + k]
    half = TREE // 2
    while half > 0:
        for k in range(half):
            tree[k] = tree[k] + tree[k + half]
        half //= 2
    return tree[0]
