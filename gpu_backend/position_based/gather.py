"""Distance constraints of a mass, all at once, as routines: the Jacobi orderings.

Every mass reads the positions before the iteration: both of a constraint's ends compute its change, to the same bits,
and each stores its own multiplier. The fourth number of a position is its part of its constraints' denominators:
valence times weight, or the weight alone if displacements are averaged.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.position_based.constraints import KINDS, change, kind_features
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, real
from softlab.model.contact.substep_parameters import OF_SHEETS
from softlab.model.formulas.distance import averaged, gathered, scaled, weighted_valence
from softlab.model.formulas.distance import reciprocal as reciprocal_of

ONE, TWO = np.int32(1), np.int32(2)
STRUCTURAL, STIFF = OF_SHEETS.index("structural"), OF_SHEETS.index("stiff")

neighbours = Open("neighbours(k, pitch, cell) -> four indices")
structural_sum = Open("structural_sum(k, pitch, cell, pulling) -> displacement")
shear_sum = Open("shear_sum(k, pitch, cell, pulling) -> displacement")
bending_sum = Open("bending_sum(k, pitch, cell, pulling) -> displacement")


@inlined_routine
def pull(other, odd, place, pulling):
    """Return the displacement of a mass by its constraint with the mass `other`, number `place` of its kind; `odd`:
    true if it begins in an odd row or column. `pulling`: see `displacement`."""
    position, before, lag, p, old, multipliers, first, step, constants_of_kinds = pulling
    kind = FEATURE.constants
    q = load_quad(position, other)
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    ex, ey, ez = 0.0, 0.0, 0.0
    if FEATURE.damped:
        old_q = load_quad(before, other - lag)
        ex, ey, ez = dx - (old_q[0] - old[0]), dy - (old_q[1] - old[1]), dz - (old_q[2] - old[2])
    constants = constants_of_kinds[kind]
    if FEATURE.alternating and FEATURE.constants == STRUCTURAL:
        if odd:
            constants = constants_of_kinds[STIFF]
    multiplier = 0.0
    slot = np.int32(FEATURE.first_multiplier + place)
    if FEATURE.soft:
        multiplier = multipliers[first + slot * step]
    reciprocal = reciprocal_of(p[3] + q[3], constants.stiffening, constants.compliance)
    added, scale = change(
        (dx, dy, dz), (ex, ey, ez), reciprocal, multiplier, constants.rest, constants.compliance,
        constants_of_kinds[kind].damping,
    )  # fmt: skip
    if FEATURE.soft:
        multipliers[first + slot * step] = multiplier + added
    z = 0.0
    if FEATURE.axes == 3:
        z = scaled(-scale, dz)
    return scaled(-scale, dx), scaled(-scale, dy), z


# A missing neighbour is the mass itself, as in mass_spring/cloth/point.py: it displaces nothing.


@inlined_routine
def beside(k, pitch, cell):
    """Return the indices to the right, to the left, below, above."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    return (
        k if j == columns - 1 else k + ONE, k if j == 0 else k - ONE,
        k if i == rows - 1 else k + pitch, k if i == 0 else k - pitch,
    )  # fmt: skip


@inlined_routine
def across(k, pitch, cell):
    """Return the indices below to the right, above to the left, below to the left, above to the right."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
    return (
        k if bottom or last else k + pitch + ONE, k if top or first else k - pitch - ONE,
        k if bottom or first else k + pitch - ONE, k if top or last else k - pitch + ONE,
    )  # fmt: skip


@inlined_routine
def two_on(k, pitch, cell):
    """Return the indices two to the right, two to the left, two below, two above."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    return (
        k + TWO if j < columns - 2 else k, k - TWO if j > 1 else k,
        k + TWO * pitch if i < rows - 2 else k, k - TWO * pitch if i > 1 else k,
    )  # fmt: skip


NEIGHBOURS = {"structural": beside, "shear": across, "bending": two_on}


@inlined_routine
def kind_sum(k, pitch, cell, pulling):
    """Return the displacement of a mass by a kind of constraints: (first + second) + (third + fourth), by axis."""
    i, j = cell.i, cell.j
    places, odd_row, odd_column = neighbours(k, pitch, cell), (i & ONE) != 0, (j & ONE) != 0
    a, b = pull(places[0], odd_column, 0, pulling), pull(places[1], not odd_column, 1, pulling)
    c, d = pull(places[2], odd_row, 2, pulling), pull(places[3], not odd_row, 3, pulling)
    return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])


@inlined_routine
def displacement(k, pitch, cell, pulling):
    """Return the displacement (x, y, z) of a mass by its neighbours: (structural + shear) + bending.

    `pulling`: (position, before, lag, p, old, multipliers, first, step, constants). The mass is at index k of
    `position` (p), the mass below it at k + `pitch`; in `before` (old) all indices are `lag` less. Its multipliers are
    numbers first, first + step, ... of `multipliers`, 4 of each kind of constraints with compliance.
    """
    x, y, z = 0.0, 0.0, 0.0
    if FEATURE.structural:
        x, y, z = structural_sum(k, pitch, cell, pulling)
    if FEATURE.shear:
        hx, hy, hz = shear_sum(k, pitch, cell, pulling)
        if FEATURE.structural:
            hx, hy, hz = x + hx, y + hy, z + hz
        x, y, z = hx, hy, hz
    if FEATURE.bending:
        bx, by, bz = bending_sum(k, pitch, cell, pulling)
        if FEATURE.structural or FEATURE.shear:
            bx, by, bz = x + bx, y + by, z + bz
        x, y, z = bx, by, bz
    return x, y, z


@cache
def displacement_of(real: Real, math: str, parts: frozenset[str], axes: int) -> Any:
    """Return `displacement` with the sums of a scene's kinds of constraints."""
    soft = [kind for kind in KINDS if f"{kind}-compliance" in parts]
    sums = {}
    for kind in KINDS:
        first = 4 * soft.index(kind) if kind in soft else 0
        variant = device_variant(real, math, kind_features(parts, kind, axes) | {"first_multiplier": first})
        sums[f"{kind}_sum"] = variant(filled(kind_sum, {"neighbours": NEIGHBOURS[kind]}))
    return filled(displacement, sums)


@inlined_routine
def valence_of(cell):
    """Return the number of constraints of a mass."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    up, down = np.int32(i > 0), np.int32(i < rows - 1)
    left, right = np.int32(j > 0), np.int32(j < columns - 1)
    total = np.int32(0)
    if FEATURE.structural:
        total = total + up + down + left + right
    if FEATURE.shear:
        total = total + (up + down) * (left + right)
    if FEATURE.bending:
        total = total + np.int32(i > 1) + np.int32(i < rows - 2) + np.int32(j > 1) + np.int32(j < columns - 2)
    return real(total)


@inlined_routine
def weight_of(valence, weight):
    """Return the fourth number of a mass."""
    return weight if FEATURE.averaged_jacobi else weighted_valence(valence, weight)


@inlined_routine
def arrive(p, weight, total, valence):
    """Return the position (x, y, z) of a mass after the iteration; `total`: its displacement."""
    z = p[2]
    if FEATURE.averaged_jacobi:
        if FEATURE.axes == 3:
            z = averaged(z, weight, total[2], valence)
        return averaged(p[0], weight, total[0], valence), averaged(p[1], weight, total[1], valence), z
    if FEATURE.axes == 3:
        z = gathered(z, weight, total[2])
    return gathered(p[0], weight, total[0]), gathered(p[1], weight, total[1]), z
