"""Distance constraints of a mass, all at once, as device functions: the Jacobi orderings.

Every mass reads the positions before the iteration: both of a constraint's ends compute its change, to the same bits,
and each stores its own multiplier. The fourth number of a position is its part of its constraints' denominators:
valence times weight, or the weight alone if displacements are averaged.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.position_based.constraints import KINDS, make_change
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import OF_SHEETS
from softlab.model.formulas import distance


def _make_pulls(real: Real, math: str, parts: frozenset[str], axes: int) -> Callable:
    """Make make_pull(kind, number) -> pull(other, odd, those), the displacement by one constraint of a kind; `odd`:
    true if it begins in an odd row or column."""
    formulas = device_formulas(distance, real, math)
    reciprocal_of, scaled = formulas.reciprocal, formulas.scaled
    solid, alternates, zero = axes == 3, "alternating" in parts, real(0)
    soft = [kind for kind in KINDS if f"{kind}-compliance" in parts]
    inline = inlined(math)

    def make_pull(kind: str, number: int) -> Callable:
        kind_index, odd_kind = OF_SHEETS.index(kind), OF_SHEETS.index("stiff")
        can_alternate = alternates and kind == "structural"
        has_compliance, has_damper = kind in soft, f"{kind}-damping" in parts
        slot = np.int32(4 * soft.index(kind) + number if has_compliance else 0)
        change_of = make_change(real, math, parts, kind, axes)

        @inline
        def pull(other, odd, those):
            position, before, lag, p, old, multipliers, first, step, constants = those
            q = load_quad(position, other)
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            ex, ey, ez = zero, zero, zero
            if has_damper:
                old_q = load_quad(before, other - lag)
                ex, ey, ez = dx - (old_q[0] - old[0]), dy - (old_q[1] - old[1]), dz - (old_q[2] - old[2])
            constants_here = constants[kind_index]
            if can_alternate:
                if odd:
                    constants_here = constants[odd_kind]
            multiplier = zero
            if has_compliance:
                multiplier = multipliers[first + slot * step]
            reciprocal = reciprocal_of(p[3] + q[3], constants_here.stiffening, constants_here.compliance)
            change, scale = change_of(
                (dx, dy, dz),
                (ex, ey, ez),
                reciprocal,
                multiplier,
                constants_here.rest,
                constants_here.compliance,
                constants[kind_index].damping,
            )
            if has_compliance:
                multipliers[first + slot * step] = multiplier + change
            z = zero
            if solid:
                z = scaled(-scale, dz)
            return scaled(-scale, dx), scaled(-scale, dy), z

        return pull

    return make_pull


def _make_neighbour_sum(real: Real, math: str, parts: frozenset[str], make_pull: Callable[[str, int], Any]) -> Callable:
    """Make total(k, pitch, cell, those) -> (x, y, z): the displacement of a mass by its neighbours.

    Summed by kind in pairs, (structural + shear) + bending; `those`: further arguments of pulls. See `make_gather`.
    """
    has_structural, has_shear, has_bending = "structural" in parts, "shear" in parts, "bending" in parts
    zero, one, two = real(0), np.int32(1), np.int32(2)
    inline = inlined(math)

    # A missing neighbour is the mass itself, as in mass_spring/cloth/point.py: it displaces nothing.

    @inline
    def beside(k, pitch, cell):
        """Return the indices to the right, to the left, below, above."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        return (
            k if j == columns - 1 else k + one, k if j == 0 else k - one,
            k if i == rows - 1 else k + pitch, k if i == 0 else k - pitch,
        )  # fmt: skip

    @inline
    def across(k, pitch, cell):
        """Return the indices below to the right, above to the left, below to the left, above to the right."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        return (
            k if bottom or last else k + pitch + one, k if top or first else k - pitch - one,
            k if bottom or first else k + pitch - one, k if top or last else k - pitch + one,
        )  # fmt: skip

    @inline
    def two_on(k, pitch, cell):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        return (
            k + two if j < columns - 2 else k, k - two if j > 1 else k,
            k + two * pitch if i < rows - 2 else k, k - two * pitch if i > 1 else k,
        )  # fmt: skip

    def make_sum(kind: str, places_of: Callable) -> Callable:
        first, second, third, fourth = (make_pull(kind, n) for n in range(4))

        @inline
        def kind_sum(k, pitch, cell, those):
            """Return (first + second) + (third + fourth), by axis."""
            i, j = cell.i, cell.j
            places, odd_row, odd_column = places_of(k, pitch, cell), (i & one) != 0, (j & one) != 0
            a, b = first(places[0], odd_column, those), second(places[1], not odd_column, those)
            c, d = third(places[2], odd_row, those), fourth(places[3], not odd_row, those)
            return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])

        return kind_sum

    structural_sum, shear_sum = make_sum("structural", beside), make_sum("shear", across)
    bending_sum = make_sum("bending", two_on)

    @inline
    def total(k, pitch, cell, those):
        x, y, z = zero, zero, zero
        if has_structural:
            x, y, z = structural_sum(k, pitch, cell, those)
        if has_shear:
            hx, hy, hz = shear_sum(k, pitch, cell, those)
            if has_structural:
                hx, hy, hz = x + hx, y + hy, z + hz
            x, y, z = hx, hy, hz
        if has_bending:
            bx, by, bz = bending_sum(k, pitch, cell, those)
            if has_structural or has_shear:
                bx, by, bz = x + bx, y + by, z + bz
            x, y, z = bx, by, bz
        return x, y, z

    return total


@cache
def make_gather(real: Real, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Make the device functions of Jacobi orderings:

    - `valence_of(cell)`: number of constraints of a mass; `weight_of(valence, weight)`: its fourth number;
    - `gather(position, before, k, lag, pitch, cell, p, old, m, first, step, constants)` -> (x, y, z): the sum of a mass's
      displacements. It is at index k of `position` (p), the mass below it at k + `pitch`; in `before` (old) all indices
      are `lag` less. Its multipliers are numbers first, first + step, ... of m, 4 of each kind of constraints with
      compliance;
    - `arrive(p, weight, sum, valence)` -> (x, y, z): the mass after the iteration.
    """
    formulas = device_formulas(distance, real, math)
    weighted_valence, gathered, averaged = formulas.weighted_valence, formulas.gathered, formulas.averaged
    has_structural, has_shear, has_bending = "structural" in parts, "shear" in parts, "bending" in parts
    averages, solid = "averaged-jacobi" in parts, axes == 3
    total = _make_neighbour_sum(real, math, parts, _make_pulls(real, math, parts, axes))
    inline = inlined(math)

    @inline
    def valence_of(cell):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        up, down = np.int32(i > 0), np.int32(i < rows - 1)
        left, right = np.int32(j > 0), np.int32(j < columns - 1)
        total = np.int32(0)
        if has_structural:
            total = total + up + down + left + right
        if has_shear:
            total = total + (up + down) * (left + right)
        if has_bending:
            total = total + np.int32(i > 1) + np.int32(i < rows - 2) + np.int32(j > 1) + np.int32(j < columns - 2)
        return real(total)

    @inline
    def weight_of(valence, weight):
        return weight if averages else weighted_valence(valence, weight)

    @inline
    def gather(position, before, k, lag, pitch, cell, p, old, m, first, step, constants):
        those = position, before, lag, p, old, m, first, step, constants
        return total(k, pitch, cell, those)

    @inline
    def arrive(p, weight, total, valence):
        z = p[2]
        if averages:
            if solid:
                z = averaged(z, weight, total[2], valence)
            return averaged(p[0], weight, total[0], valence), averaged(p[1], weight, total[1], valence), z
        if solid:
            z = gathered(z, weight, total[2])
        return gathered(p[0], weight, total[0]), gathered(p[1], weight, total[1]), z

    return SimpleNamespace(valence_of=valence_of, weight_of=weight_of, gather=gather, arrive=arrive)
