"""Distance constraints as device functions: one of a colour (Gauss-Seidel), or all of a mass (Jacobi).

Both read and write quads in any array, in device memory or in a block's shared memory, by place. Gauss-Seidel moves both
ends of a constraint; no two of a colour share a mass. In a Jacobi ordering every mass gathers from the positions before the
iteration: both of a constraint's ends compute its change, to the same bits, and each keeps a multiplier of its own. There
the spare number of a position is its share of its constraints' denominators: valence times weight, or the weight alone
where displacements are averaged.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from gpu_backend.core.compile import inlined
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad, store_quad
from model.formulas import distance
from model.xpbd.parameters import (
    CONSTANTS,
    OF_SHEETS,
    X_BOTH,
    X_COMPLIANCE,
    X_CONSTRAINT,
    X_DAMPING,
    X_ONE,
    X_REST,
    X_STIFFENING,
)  # fmt: skip
from model.xpbd.plan import Family

KINDS = ("structural", "shear", "bending")
MAX_CONSTRAINTS = 12  # of a mass


def dampers(parts: frozenset[str]) -> bool:
    """Whether any constraint asks how far apart its ends were at the substep's beginning."""
    return any(f"{kind}-damping" in parts for kind in KINDS)


def compliant(parts: frozenset[str], family: Family) -> bool:
    """Whether a family's constraints have multipliers."""
    return f"{family.kind}-compliance" in parts


@cache
def make_constants(math: str) -> Any:
    """constants(record): those of the constraints as a tuple, read once: in a loop they would be read again after each
    barrier. Those of a sheet; of `OF_SHEETS[n]` they begin at n * len(CONSTANTS)."""
    c = X_CONSTRAINT[OF_SHEETS[0]]
    assert len(OF_SHEETS) * len(CONSTANTS) == 24

    @inlined(math)
    def constants(r):
        return (
            r[c], r[c + 1], r[c + 2], r[c + 3], r[c + 4], r[c + 5], r[c + 6], r[c + 7],
            r[c + 8], r[c + 9], r[c + 10], r[c + 11], r[c + 12], r[c + 13], r[c + 14], r[c + 15],
            r[c + 16], r[c + 17], r[c + 18], r[c + 19], r[c + 20], r[c + 21], r[c + 22], r[c + 23],
        )  # fmt: skip

    return constants


@cache
def make_change(real: Any, math: str, parts: frozenset[str], kind: str, axes: int) -> Any:
    """change(dx, dy, dz, ex, ey, ez, reciprocal, multiplier, rest, compliance, damping) -> (change, its scale) of one of a
    kind's constraints: d leads from one end to the other, e is what d changed by in this substep."""
    formulas = device_formulas(distance.make, real, math)
    rigid, soft, damped = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    squared_2d, squared_3d = formulas.squared_length_2d, formulas.squared_length_3d
    along_3d = formulas.along_3d
    has_compliance, has_damper = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
    solid = axes == 3

    @inlined(math)
    def change(dx, dy, dz, ex, ey, ez, reciprocal, multiplier, rest, compliance, damping):
        squared = squared_3d(dx, dy, dz) if solid else squared_2d(dx, dy)
        if has_damper:
            along = along_3d(dx, dy, dz, ex, ey, ez)
            return damped(squared, rest, reciprocal, compliance, multiplier, damping, along)
        if has_compliance:
            return soft(squared, rest, reciprocal, compliance, multiplier)
        return rigid(squared, rest, reciprocal)

    return change


@cache
def make_pair(real: Any, math: str, parts: frozenset[str], family: Family, colour: int, axes: int) -> Any:
    """pair(position, before, a, b, multiplier, constants) -> the multiplier afterwards: projects the constraint between the
    masses at places a (the first) and b of both arrays, and moves both in `position`."""
    kind = "stiff" if "alternating" in parts and family.kind == "structural" and colour else family.kind
    start = OF_SHEETS.index(kind) * len(CONSTANTS)
    rest, compliance, damping = start + X_REST, start + X_COMPLIANCE, start + X_DAMPING
    stiffening, both, one_free = start + X_STIFFENING, start + X_BOTH, start + X_ONE
    change_of = make_change(real, math, parts, family.kind, axes)
    formulas = device_formulas(distance.make, real, math)
    moved, reciprocal_of = formulas.moved, formulas.reciprocal
    has_pins, has_load, solid = "pins" in parts, "load" in parts, axes == 3
    has_damper = f"{family.kind}-damping" in parts
    zero, one, two = real(0), real(1), real(2)
    inline = inlined(math)

    @inline
    def reciprocal_between(first, second, constants):
        """By the weights of both ends."""
        if has_load:
            return reciprocal_of(first + second, constants[stiffening], constants[compliance])
        if has_pins:
            weight = first + second
            return constants[both] if weight == two else constants[one_free] if weight == one else zero
        return constants[both]

    @inline
    def pair(position, before, a, b, multiplier, constants):
        p, q = load_quad(position, a), load_quad(position, b)
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        ex, ey, ez = zero, zero, zero
        if has_damper:
            old_p, old_q = load_quad(before, a), load_quad(before, b)
            ex, ey, ez = dx - (old_q[0] - old_p[0]), dy - (old_q[1] - old_p[1]), dz - (old_q[2] - old_p[2])
        reciprocal = reciprocal_between(p[3], q[3], constants)
        change, scale = change_of(
            dx, dy, dz, ex, ey, ez, reciprocal, multiplier, constants[rest], constants[compliance], constants[damping]
        )  # fmt: skip
        wp, wq = one, one
        if has_pins or has_load:
            wp, wq = p[3], q[3]
        pz, qz = p[2], q[2]
        if solid:
            pz, qz = moved(pz, wp, -scale, dz), moved(qz, wq, scale, dz)
        store_quad(position, a, moved(p[0], wp, -scale, dx), moved(p[1], wp, -scale, dy), pz, p[3])
        store_quad(position, b, moved(q[0], wq, scale, dx), moved(q[1], wq, scale, dy), qz, q[3])
        return multiplier + change

    return pair


@cache
def make_gather(real: Any, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Jacobi's device functions:

    - `valence_of(i, j, rows, columns)`: how many constraints a mass has; `share_of(valence, weight)`: its spare number;
    - `gather(position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants)` -> (x, y, z): the
      sum of a mass's displacements. It lies at place k of `position` (p), the mass below it `pitch` places on; of `before`
      (old) all places are `lag` less. Its multipliers are numbers first, first + step, ... of m, 4 of each kind of
      constraints with compliance;
    - `arrive(p, weight, sum, valence)` -> (x, y, z): the mass after the iteration.
    """
    formulas = device_formulas(distance.make, real, math)
    reciprocal_of, scaled, share = formulas.reciprocal, formulas.scaled, formulas.share
    gathered, averaged = formulas.gathered, formulas.averaged
    has_structural, has_shear, has_bending = "structural" in parts, "shear" in parts, "bending" in parts
    averages, solid, alternates = "averaged-jacobi" in parts, axes == 3, "alternating" in parts
    soft = [kind for kind in KINDS if f"{kind}-compliance" in parts]
    zero, one, two = real(0), np.int32(1), np.int32(2)
    inline = inlined(math)

    @inline
    def valence_of(i, j, rows, columns):
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
    def share_of(valence, weight):
        return weight if averages else share(valence, weight)

    def make_pull(kind: str, number: int) -> Any:
        """By the constraint that has place `number` among those of its kind."""
        start, odd_start = OF_SHEETS.index(kind) * len(CONSTANTS), OF_SHEETS.index("stiff") * len(CONSTANTS)
        can_alternate = alternates and kind == "structural"
        has_compliance, has_damper = kind in soft, f"{kind}-damping" in parts
        slot = np.int32(4 * soft.index(kind) + number if has_compliance else 0)
        change_of = make_change(real, math, parts, kind, axes)
        rest_place, compliance_place = start + X_REST, start + X_COMPLIANCE
        stiffening_place, damping_place = start + X_STIFFENING, start + X_DAMPING
        odd_rest, odd_compliance = odd_start + X_REST, odd_start + X_COMPLIANCE
        odd_stiffening = odd_start + X_STIFFENING

        @inline
        def pull(position, before, other, lag, odd, p, old, multipliers, first, step, constants):
            q = load_quad(position, other)
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            ex, ey, ez = zero, zero, zero
            if has_damper:
                old_q = load_quad(before, other - lag)
                ex, ey, ez = dx - (old_q[0] - old[0]), dy - (old_q[1] - old[1]), dz - (old_q[2] - old[2])
            rest, compliance, stiffening = (
                constants[rest_place], constants[compliance_place], constants[stiffening_place]
            )  # fmt: skip
            if can_alternate:
                if odd:
                    rest, compliance = constants[odd_rest], constants[odd_compliance]
                    stiffening = constants[odd_stiffening]
            multiplier = zero
            if has_compliance:
                multiplier = multipliers[first + slot * step]
            reciprocal = reciprocal_of(p[3] + q[3], stiffening, compliance)
            change, scale = change_of(
                dx, dy, dz, ex, ey, ez, reciprocal, multiplier, rest, compliance, constants[damping_place]
            )  # fmt: skip
            if has_compliance:
                multipliers[first + slot * step] = multiplier + change
            z = zero
            if solid:
                z = scaled(-scale, dz)
            return scaled(-scale, dx), scaled(-scale, dy), z

        return pull

    right_pull, left_pull, below_pull, above_pull = (make_pull("structural", n) for n in range(4))
    below_right_pull, above_left_pull, below_left_pull, above_right_pull = (make_pull("shear", n) for n in range(4))
    right_bend, left_bend, below_bend, above_bend = (make_pull("bending", n) for n in range(4))

    @inline
    def paired(a, b, c, d):
        """(a + b) + (c + d), by axis."""
        return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])

    # A neighbour that is not there is the mass itself, as in mass_spring/cloth/point.py: it displaces nothing.

    @inline
    def structural_sum(position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants):
        right, left = k if j == columns - 1 else k + one, k if j == 0 else k - one
        below, above = k if i == rows - 1 else k + pitch, k if i == 0 else k - pitch
        odd_row, odd_column = (i & one) != 0, (j & one) != 0
        return paired(
            right_pull(position, before, right, lag, odd_column, p, old, m, first, step, constants),
            left_pull(position, before, left, lag, not odd_column, p, old, m, first, step, constants),
            below_pull(position, before, below, lag, odd_row, p, old, m, first, step, constants),
            above_pull(position, before, above, lag, not odd_row, p, old, m, first, step, constants),
        )

    @inline
    def shear_sum(position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants):
        top, bottom, start, end = i == 0, i == rows - 1, j == 0, j == columns - 1
        below_right, above_left = k if bottom or end else k + pitch + one, k if top or start else k - pitch - one
        below_left, above_right = k if bottom or start else k + pitch - one, k if top or end else k - pitch + one
        return paired(
            below_right_pull(position, before, below_right, lag, False, p, old, m, first, step, constants),
            above_left_pull(position, before, above_left, lag, False, p, old, m, first, step, constants),
            below_left_pull(position, before, below_left, lag, False, p, old, m, first, step, constants),
            above_right_pull(position, before, above_right, lag, False, p, old, m, first, step, constants),
        )

    @inline
    def bending_sum(position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants):
        right, left = k + two if j < columns - 2 else k, k - two if j > 1 else k
        below, above = k + two * pitch if i < rows - 2 else k, k - two * pitch if i > 1 else k
        return paired(
            right_bend(position, before, right, lag, False, p, old, m, first, step, constants),
            left_bend(position, before, left, lag, False, p, old, m, first, step, constants),
            below_bend(position, before, below, lag, False, p, old, m, first, step, constants),
            above_bend(position, before, above, lag, False, p, old, m, first, step, constants),
        )

    @inline
    def gather(position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants):
        x, y, z = zero, zero, zero
        if has_structural:
            x, y, z = structural_sum(
                position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants
            )
        if has_shear:
            hx, hy, hz = shear_sum(
                position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants
            )
            if has_structural:
                hx, hy, hz = x + hx, y + hy, z + hz
            x, y, z = hx, hy, hz
        if has_bending:
            bx, by, bz = bending_sum(
                position, before, k, lag, pitch, i, j, rows, columns, p, old, m, first, step, constants
            )
            if has_structural or has_shear:
                bx, by, bz = x + bx, y + by, z + bz
            x, y, z = bx, by, bz
        return x, y, z

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

    return SimpleNamespace(valence_of=valence_of, share_of=share_of, gather=gather, arrive=arrive)
