"""Clusters that deform besides turning, on CPU threads: the operations before and after the rotation is computed."""

from __future__ import annotations

from softlab.cpu_backend.core.layout import row_at
from softlab.model.base.variant import FEATURE, routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.deformation import (
    S_CREEP,
    S_INVERSE,
    S_LIMIT,
    S_LINEAR,
    S_THRESHOLD,
    SHAPE,
    bent,
    blended,
    crept,
    gradient,
    product,
    strain,
    undone,
)

AXES = 3
ENTRIES = AXES * AXES  # of a matrix


@routine
def nine(rows, place):
    return (
        rows[place], rows[LANES + place], rows[2 * LANES + place], rows[3 * LANES + place], rows[4 * LANES + place],
        rows[5 * LANES + place], rows[6 * LANES + place], rows[7 * LANES + place], rows[8 * LANES + place],
    )  # fmt: skip


@routine
def store_nine(rows, place, values):
    (
        rows[place], rows[LANES + place], rows[2 * LANES + place], rows[3 * LANES + place], rows[4 * LANES + place],
        rows[5 * LANES + place], rows[6 * LANES + place], rows[7 * LANES + place], rows[8 * LANES + place],
    ) = values  # fmt: skip


@routine
def entries(array, k):
    return (
        array[k], array[k + 1], array[k + 2], array[k + 3], array[k + 4], array[k + 5], array[k + 6], array[k + 7],
        array[k + 8],
    )  # fmt: skip


@routine
def prepare(c, place, arrays, sums, maps):
    """Write the linear map of cluster `c`, in lane `place`, into the 9 rows of `maps`, and bend its moments in `sums` if it
    is plastic."""
    if not (FEATURE.linear or FEATURE.plastic):
        return
    table, plastic, _ = arrays.shapes
    moments, k = row_at(sums, AXES * LANES), SHAPE * c + S_INVERSE
    a = nine(moments, place)
    f = gradient(a, (table[k], table[k + 1], table[k + 2], table[k + 3], table[k + 4], table[k + 5]))
    if FEATURE.plastic:
        p = entries(plastic, ENTRIES * c)
        f = undone(f, p)
        store_nine(moments, place, bent(a, p))
    store_nine(maps, place, f)


@routine
def finish(c, place, arrays, maps, r):
    """Return the matrix of a cluster's goals from that of its rotation, and write its new strain."""
    if not (FEATURE.linear or FEATURE.plastic):
        return r
    table, plastic, after = arrays.shapes
    f, k = nine(maps, place), SHAPE * c
    goal = r
    if FEATURE.linear:
        goal = blended(f, r, table[k + S_LINEAR])
    if FEATURE.plastic:
        p, n = entries(plastic, ENTRIES * c), ENTRIES * c
        goal = product(goal, p)
        e = strain(f, r)
        (
            after[n], after[n + 1], after[n + 2], after[n + 3], after[n + 4], after[n + 5], after[n + 6], after[n + 7],
            after[n + 8],
        ) = crept(e, p, table[k + S_THRESHOLD], table[k + S_CREEP], table[k + S_LIMIT])  # fmt: skip
    return goal
