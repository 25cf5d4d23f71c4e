"""Clusters that deform besides turning, on CPU threads: the operations before and after the rotation is computed."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import deformation
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.deformation import S_CREEP, S_INVERSE, S_LIMIT, S_LINEAR, S_THRESHOLD, SHAPE

ENTRIES = 9


def make_shapes(compiler: Compiler, real: Real, shaping: frozenset[str], row: int) -> SimpleNamespace:
    """Make `prepare` and `finish`; they do nothing, and return the rotation, if `shaping`
    (model/shape_matching/cluster_tables.py) is empty.

    `prepare(c, place, arrays, sums, maps)`: for cluster c, in lane `place`, its linear map, into the 9 rows of `maps`,
    and its moments, from `row` of `sums`, bent if it is plastic. `finish(c, place, arrays, maps, r)`: the
    matrix of its goals from that of its rotation, and its new strain.
    """
    if not shaping:
        return _turning(compiler)
    has_linear, has_plastic = "linear" in shaping, "plastic" in shaping
    formulas = compiler.formulas(deformation, real)
    bent, gradient, undone, product = formulas.bent, formulas.gradient, formulas.undone, formulas.product
    blended, strain, crept = formulas.blended, formulas.strain, formulas.crept

    @compiler.compiled
    def nine(rows, place):
        return (
            rows[place], rows[LANES + place], rows[2 * LANES + place], rows[3 * LANES + place], rows[4 * LANES + place],
            rows[5 * LANES + place], rows[6 * LANES + place], rows[7 * LANES + place], rows[8 * LANES + place],
        )  # fmt: skip

    @compiler.compiled
    def into(rows, place, values):
        (
            rows[place], rows[LANES + place], rows[2 * LANES + place], rows[3 * LANES + place], rows[4 * LANES + place],
            rows[5 * LANES + place], rows[6 * LANES + place], rows[7 * LANES + place], rows[8 * LANES + place],
        ) = values  # fmt: skip

    @compiler.compiled
    def entries(array, k):
        return (
            array[k], array[k + 1], array[k + 2], array[k + 3], array[k + 4], array[k + 5], array[k + 6], array[k + 7],
            array[k + 8],
        )  # fmt: skip

    @compiler.compiled
    def prepare(c, place, arrays, sums, maps):
        table, plastic, _ = arrays.shapes
        moments, k = row_at(sums, row * LANES), SHAPE * c + S_INVERSE
        a = nine(moments, place)
        f = gradient(a, (table[k], table[k + 1], table[k + 2], table[k + 3], table[k + 4], table[k + 5]))
        if has_plastic:
            p = entries(plastic, ENTRIES * c)
            f = undone(f, p)
            into(moments, place, bent(a, p))
        into(maps, place, f)

    @compiler.compiled
    def finish(c, place, arrays, maps, r):
        table, plastic, after = arrays.shapes
        f, k = nine(maps, place), SHAPE * c
        goal = r
        if has_linear:
            goal = blended(f, r, table[k + S_LINEAR])
        if has_plastic:
            p, n = entries(plastic, ENTRIES * c), ENTRIES * c
            goal = product(goal, p)
            e = strain(f, r)
            (
                after[n], after[n + 1], after[n + 2], after[n + 3], after[n + 4], after[n + 5], after[n + 6], after[n + 7],
                after[n + 8],
            ) = crept(e, p, table[k + S_THRESHOLD], table[k + S_CREEP], table[k + S_LIMIT])  # fmt: skip
        return goal

    return SimpleNamespace(prepare=prepare, finish=finish)


def _turning(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def prepare(c, place, arrays, sums, maps):
        pass

    @compiler.compiled
    def finish(c, place, arrays, maps, r):
        return r

    return SimpleNamespace(prepare=prepare, finish=finish)
