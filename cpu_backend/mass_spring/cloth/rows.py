"""Accelerations of a row of a cloth, for the kernel `fused`: each spring and each triangle once, along the row.

A walk goes down the rows. The springs that lead from a row to the right and down, and the triangles between it and the
next row, are computed into separate rows of scratch. A mass adds its own entry and, with the opposite sign, those of
the masses at the other ends of its springs (of this row and of one or two above). Springs that would lead out of the
sheet leave a 0 there, so that the loops have no case for the edges; their results for the padding columns are never
read. Sums have one fixed order (make_sums). Flags are closure constants: an absent part leaves no code.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.own_forces import make_particle_force_row
from softlab.cpu_backend.core.scratch import AXES, SPAN, make_scratch, triples_of
from softlab.cpu_backend.core.wind import make_winds
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import (
    spring_constants,
)
from softlab.model.core.own_forces import particle_forces, particle_forces_change
from softlab.model.formulas import springs
from softlab.model.tables.cloth import SPRING_KINDS


def make_accelerations(compiler: Compiler, real: Real, parts: frozenset[str], kind: str, place: Any) -> Callable:
    """Make pulls(blocks, source, plane, here, there, parameters, scratch, triple, width): the accelerations of the
    masses from `here` on by springs of a kind to those from `there` on."""
    block, has_damper = block_of(real), f"{kind}-damping" in parts
    formulas = compiler.formulas(springs, real)
    spring_acceleration_3d, damped_pull_3d = formulas.spring_acceleration_3d, formulas.damped_pull_3d
    k_stiffness, k_rest, k_damping = spring_constants(kind)

    def pull_row(blocks, x, y, z, far_x, far_y, far_z, stiffness, rest, out_x, out_y, out_z):
        for j in range(blocks * block):
            px, py, pz = spring_acceleration_3d(far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], stiffness, rest)
            out_x[j] = px
            out_y[j] = py
            out_z[j] = pz

    def damped_row(
        blocks, x, y, z, vx, vy, vz, far_x, far_y, far_z, far_vx, far_vy, far_vz, stiffness, rest, damping, out_x, out_y,
        out_z,
    ):  # fmt: skip
        for j in range(blocks * block):
            px, py, pz = damped_pull_3d(
                far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], far_vx[j] - vx[j], far_vy[j] - vy[j],
                far_vz[j] - vz[j], stiffness, rest, damping,
            )  # fmt: skip
            out_x[j] = px
            out_y[j] = py
            out_z[j] = pz

    pull_row.__name__, damped_row.__name__ = f"{kind}_pull_row", f"{kind}_damped_row"
    pull_row, damped_row = compiler.row(pull_row), compiler.row(damped_row)

    def pulls(blocks, source, plane, here, there, parameters, scratch, triple, width):
        x, y, z = row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane)
        far_x, far_y, far_z = row_at(source, there), row_at(source, there + plane), row_at(source, there + 2 * plane)
        out_x, out_y = row_at(scratch, place(triple, 0, width)), row_at(scratch, place(triple, 1, width))
        out_z = row_at(scratch, place(triple, 2, width))
        stiffness, rest = parameters[k_stiffness], parameters[k_rest]
        if has_damper:
            vx, vy, vz = (
                row_at(source, here + 3 * plane),
                row_at(source, here + 4 * plane),
                row_at(source, here + 5 * plane),
            )
            far_vx, far_vy = row_at(source, there + 3 * plane), row_at(source, there + 4 * plane)
            far_vz = row_at(source, there + 5 * plane)
            damped_row(
                blocks, x, y, z, vx, vy, vz, far_x, far_y, far_z, far_vx, far_vy, far_vz, stiffness, rest,
                parameters[k_damping], out_x, out_y, out_z,
            )  # fmt: skip
        else:
            pull_row(blocks, x, y, z, far_x, far_y, far_z, stiffness, rest, out_x, out_y, out_z)

    pulls.__name__ = f"{kind}_pulls"
    return compiler.compiled(pulls)


def make_spring_rows(
    compiler: Compiler, real: Real, parts: frozenset[str], scratches: SimpleNamespace,
    make: Callable = make_accelerations,
) -> Callable:  # fmt: skip
    """Make spring_rows(i, across, blocks, layout, source, parameters, scratch, width): the accelerations by the springs that
    lead from row `i` down and, if `across`, to the right; 0 for those that would lead out of the sheet. `make`: of the
    springs."""
    at = triples_of(parts)
    forget, place = scratches.forget, scratches.place
    structural, shear, bending = (make(compiler, real, parts, kind, place) for kind in SPRING_KINDS)
    has_structural, has_shear, has_bending = (kind in parts for kind in SPRING_KINDS)
    a_across, a_down, a_right = at.get("across", 0), at.get("down", 0), at.get("right", 0)
    a_left, a_far_across, a_far_down = at.get("left", 0), at.get("far_across", 0), at.get("far_down", 0)

    @compiler.compiled
    def spring_rows(i, across, blocks, layout, source, parameters, scratch, width):
        rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        here, below_right, below_left = i * stride, i * stride, i * stride  # coincident masses do not pull
        below, beyond = here, here
        if i + 1 < rows:
            below = here + stride
            below_right, below_left = below + 1, below - 1
        if i + 2 < rows:
            beyond = here + 2 * stride
        if has_structural:
            if across:
                structural(blocks, source, plane, here, here + 1, parameters, scratch, a_across, width)
                forget(scratch, a_across, columns - 1, width)
            structural(blocks, source, plane, here, below, parameters, scratch, a_down + i % 2, width)
        if has_shear:
            right, left = a_right + i % 2, a_left + i % 2
            shear(blocks, source, plane, here, below_right, parameters, scratch, right, width)
            forget(scratch, right, columns - 1, width)
            shear(blocks, source, plane, here, below_left, parameters, scratch, left, width)
            forget(scratch, left, 0, width)
            forget(scratch, left, columns, width)
        if has_bending:
            if across:
                bending(blocks, source, plane, here, here + 2, parameters, scratch, a_far_across, width)
                forget(scratch, a_far_across, columns - 2, width)
                forget(scratch, a_far_across, columns - 1, width)
            bending(blocks, source, plane, here, beyond, parameters, scratch, a_far_down + i % 3, width)

    return spring_rows


def make_sums(compiler: Compiler, real: Real, parts: frozenset[str], scratches: SimpleNamespace) -> Callable:
    """Make sum_accelerations(i, blocks, parameters, scratch, width): springs and gravity on row `i`, into `close`.

    A kind's four springs in pairs, then (structural + shear) + bending, then gravity.
    """
    at, block, zero = triples_of(parts), block_of(real), real(0)
    edge, place, a_close = scratches.edge, scratches.place, at["close"]
    has_structural, has_shear, has_bending = (kind in parts for kind in SPRING_KINDS)
    a_across, a_down, a_right = at.get("across", 0), at.get("down", 0), at.get("right", 0)
    a_left, a_far_across, a_far_down = at.get("left", 0), at.get("far_across", 0), at.get("far_down", 0)

    def make_loop(has_gravity: bool) -> Callable:
        def sum_row(
            blocks, across, down, above, right, right_above, left, left_above, far_across, far_down, far_above, gravity, out
        ):  # fmt: skip
            for k in range(SPAN, blocks * block + SPAN):
                a = zero
                if has_structural:
                    a = (across[k] - across[k - 1]) + (down[k] - above[k])
                if has_shear:
                    h = (right[k] - right_above[k - 1]) + (left[k] - left_above[k + 1])
                    a = a + h if has_structural else h
                if has_bending:
                    b = (far_across[k] - far_across[k - 2]) + (far_down[k] - far_above[k])
                    a = a + b if has_structural or has_shear else b
                if has_gravity:
                    a = a + gravity
                out[k - SPAN] = a

        sum_row.__name__ = "sum_row_with_gravity" if has_gravity else "sum_row"
        return compiler.row(sum_row)

    plain_sum, vertical_sum = make_loop(False), make_loop("gravity" in parts)

    @compiler.compiled
    def sum_accelerations(i, blocks, parameters, scratch, width):
        now, before = i % 2, (i + 1) % 2
        far_now, far_before = i % 3, (i + 1) % 3
        for axis in range(AXES):
            pulls = (
                row_at(scratch, edge(a_across, axis, width)), row_at(scratch, edge(a_down + now, axis, width)),
                row_at(scratch, edge(a_down + before, axis, width)), row_at(scratch, edge(a_right + now, axis, width)),
                row_at(scratch, edge(a_right + before, axis, width)), row_at(scratch, edge(a_left + now, axis, width)),
                row_at(scratch, edge(a_left + before, axis, width)), row_at(scratch, edge(a_far_across, axis, width)),
                row_at(scratch, edge(a_far_down + far_now, axis, width)),
                row_at(scratch, edge(a_far_down + far_before, axis, width)),
            )  # fmt: skip
            out = row_at(scratch, place(a_close, axis, width))
            if axis == 1:
                vertical_sum(blocks, *pulls, parameters.gravity, out)
            else:
                plain_sum(blocks, *pulls, zero, out)

    return sum_accelerations


def make_row_forces(compiler: Compiler, real: Real, two_sums: bool, parts: frozenset[str], place: Any) -> Callable:
    """Make add(i, closing, opening, layout, parameters, integers, scratch, width): it adds forces on single masses to
    row `i`'s sums.

    `closing`: the number of the step whose forces the sum `close` gets; `opening`: that of `open`, if `two_sums`.
    """
    particle_force_row = make_particle_force_row(compiler, real, AXES, parts)
    a_close, a_open = (triples_of(parts)[name] for name in ("close", "open"))

    @compiler.compiled
    def rows_of(scratch, triple, width):
        x, y = row_at(scratch, place(triple, 0, width)), row_at(scratch, place(triple, 1, width))
        return x, y, row_at(scratch, place(triple, 2, width))

    @compiler.compiled
    def add(i, closing, opening, layout, parameters, integers, scratch, width):
        columns, close = layout[L_COLUMNS], rows_of(scratch, a_close, width)
        if two_sums:
            also = rows_of(scratch, a_open, width)
            for axis in range(AXES):
                for j in range(columns):
                    also[axis][j] = close[axis][j]
            particle_force_row(columns, i * columns, opening, parameters, integers, *also)
        particle_force_row(columns, i * columns, closing, parameters, integers, *close)

    return add


def make_cloth_forces(compiler: Compiler, real: Real, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `begin_walk(first, step, offset, ...)`, called before a band's first row, and `sum_forces(i, ...)`, row by
    row.

    `sum_forces` writes the accelerations of row `i`, without the damper, into `close` (and `open`, if `two_sums`).
    `air_now`: see core/wind.py.
    """
    scratches, at = make_scratch(compiler, real), triples_of(parts)
    spring_rows, sum_accelerations = (make(compiler, real, parts, scratches) for make in (make_spring_rows, make_sums))
    winds = make_winds(compiler, real, parts, scratches.place, scratches.edge, scratches.forget, scratches.clear, at)
    add_wind, wind_cells, has_wind = winds.add_wind, winds.wind_cells, "wind" in parts
    two_sums = integrator == "velocity-verlet" and particle_forces_change(parts)
    add_particle_force = make_row_forces(compiler, real, two_sums, parts, scratches.place)
    has_particle_forces = bool(particle_forces(parts))
    clear, count = scratches.clear, at["count"]

    @compiler.compiled
    def begin_walk(first, blocks, layout, source, parameters, air, scratch, width):
        """Compute the springs and triangles that lead down from the two rows above `first`, if there are any."""
        if first < SPAN:
            for triple in range(count):
                clear(scratch, np.int64(triple), width)
        for i in range(max(first - SPAN, 0), first):
            spring_rows(i, False, blocks, layout, source, parameters, scratch, width)
        if has_wind and first > 0:
            wind_cells(first - 1, blocks, layout, source, parameters, air, scratch, width)

    @compiler.compiled
    def sum_forces(i, closing, opening, blocks, source, sheet, air, scratch, width):
        layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
        spring_rows(i, True, blocks, layout, source, parameters, scratch, width)
        sum_accelerations(i, blocks, parameters, scratch, width)
        if has_wind:
            wind_cells(i, blocks, layout, source, parameters, air, scratch, width)
            add_wind(i, blocks, scratch, width)
        if has_particle_forces:
            add_particle_force(i, closing, opening, layout, parameters, integers, scratch, width)

    return SimpleNamespace(
        begin_walk=begin_walk, sum_forces=sum_forces, air_now=winds.air_now, two_sums=two_sums, place=scratches.place,
        a_close=at["close"], a_open=at["open"],
    )  # fmt: skip
