"""Accelerations of a row of a cloth, for the kernel `fused`: each spring and each triangle once, along the row.

A walk goes down the rows. The springs that lead from a row to the right and down, and the triangles between it and the
next row, are computed into separate rows of scratch. A mass adds its own entry and, with the opposite sign, those of
the masses at the other ends of its springs (of this row and of one or two above). Springs that would lead out of the
sheet leave a 0 there, so that the loops have no case for the edges; their results for the padding columns are never
read. Sums have one fixed order (sum_accelerations). A part that a scene lacks leaves no code.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, row_at
from softlab.cpu_backend.core.own_forces import add_3d, with_forces
from softlab.cpu_backend.core.scratch import AXES, SPAN, clear_column, clear_triple, row_edge, row_start, triples_of
from softlab.cpu_backend.core.wind import add_wind, wind_cells
from softlab.model.base.types import Feature, Real
from softlab.model.base.variant import FEATURE, Open, filled, routine, row_routine
from softlab.model.contact.cloth_parameters import spring_constants
from softlab.model.core.integrators import step_formula
from softlab.model.formulas.springs import damped_pull_3d, spring_acceleration_3d
from softlab.model.mass_spring.cloth_plan import kicks_coupled
from softlab.model.mass_spring.plan import sheet_features
from softlab.model.tables.cloth import COLLIDER_KINDS, SPRING_KINDS

# of `pulls`, for a kind of springs: names of their constants; whether they have a damper
k_stiffness, k_rest, k_damping = Open("k_stiffness: a name"), Open("k_rest: a name"), Open("k_damping: a name")
has_damper, has_gravity = Open("has_damper: a bool"), Open("has_gravity: a bool, of `sum_row`")
structural, shear, bending = (
    Open(f"{kind}(blocks, source, ...): `pulls` of a kind of springs") for kind in SPRING_KINDS
)


@row_routine
def pull_row(blocks, x, y, z, far_x, far_y, far_z, stiffness, rest, out_x, out_y, out_z):
    for j in range(blocks * BLOCK):
        px, py, pz = spring_acceleration_3d(far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], stiffness, rest)
        out_x[j] = px
        out_y[j] = py
        out_z[j] = pz


@row_routine
def damped_row(
    blocks, x, y, z, vx, vy, vz, far_x, far_y, far_z, far_vx, far_vy, far_vz, stiffness, rest, damping, out_x, out_y,
    out_z,
):  # fmt: skip
    for j in range(blocks * BLOCK):
        px, py, pz = damped_pull_3d(
            far_x[j] - x[j], far_y[j] - y[j], far_z[j] - z[j], far_vx[j] - vx[j], far_vy[j] - vy[j],
            far_vz[j] - vz[j], stiffness, rest, damping,
        )  # fmt: skip
        out_x[j] = px
        out_y[j] = py
        out_z[j] = pz


@routine
def pulls(blocks, source, plane, here, there, parameters, scratch, triple, width):
    """Write the accelerations of the masses from `here` on by springs of a kind to those from `there` on."""
    x, y, z = row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane)
    far_x, far_y, far_z = row_at(source, there), row_at(source, there + plane), row_at(source, there + 2 * plane)
    out_x, out_y = row_at(scratch, row_start(triple, 0, width)), row_at(scratch, row_start(triple, 1, width))
    out_z = row_at(scratch, row_start(triple, 2, width))
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


@routine
def spring_rows(i, across, blocks, layout, source, parameters, scratch, width):
    """Write the accelerations by the springs that lead from row `i` down and, if `across`, to the right; 0 for those that
    would lead out of the sheet."""
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    here, below_right, below_left = i * stride, i * stride, i * stride  # coincident masses do not pull
    below, beyond = here, here
    if i + 1 < rows:
        below = here + stride
        below_right, below_left = below + 1, below - 1
    if i + 2 < rows:
        beyond = here + 2 * stride
    if FEATURE.structural:
        if across:
            structural(blocks, source, plane, here, here + 1, parameters, scratch, FEATURE.at_across, width)
            clear_column(scratch, FEATURE.at_across, columns - 1, width)
        structural(blocks, source, plane, here, below, parameters, scratch, FEATURE.at_down + i % 2, width)
    if FEATURE.shear:
        right, left = FEATURE.at_right + i % 2, FEATURE.at_left + i % 2
        shear(blocks, source, plane, here, below_right, parameters, scratch, right, width)
        clear_column(scratch, right, columns - 1, width)
        shear(blocks, source, plane, here, below_left, parameters, scratch, left, width)
        clear_column(scratch, left, 0, width)
        clear_column(scratch, left, columns, width)
    if FEATURE.bending:
        if across:
            bending(blocks, source, plane, here, here + 2, parameters, scratch, FEATURE.at_far_across, width)
            clear_column(scratch, FEATURE.at_far_across, columns - 2, width)
            clear_column(scratch, FEATURE.at_far_across, columns - 1, width)
        bending(blocks, source, plane, here, beyond, parameters, scratch, FEATURE.at_far_down + i % 3, width)


@row_routine
def sum_row(
    blocks, across, down, above, right, right_above, left, left_above, far_across, far_down, far_above, gravity, out
):  # fmt: skip
    for k in range(SPAN, blocks * BLOCK + SPAN):
        a = 0.0
        if FEATURE.structural:
            a = (across[k] - across[k - 1]) + (down[k] - above[k])
        if FEATURE.shear:
            h = (right[k] - right_above[k - 1]) + (left[k] - left_above[k + 1])
            a = a + h if FEATURE.structural else h
        if FEATURE.bending:
            b = (far_across[k] - far_across[k - 2]) + (far_down[k] - far_above[k])
            a = a + b if FEATURE.structural or FEATURE.shear else b
        if has_gravity:
            a = a + gravity
        out[k - SPAN] = a


plain_sum = filled(sum_row, {"has_gravity": False})
vertical_sum = filled(sum_row, {"has_gravity": True})


@routine
def sum_accelerations(i, blocks, parameters, scratch, width):
    """Sum springs and gravity on row `i` into `close`: a kind's four springs in pairs, then (structural + shear) +
    bending, then gravity."""
    now, before = i % 2, (i + 1) % 2
    far_now, far_before = i % 3, (i + 1) % 3
    for axis in range(AXES):
        pulls = (
            row_at(scratch, row_edge(FEATURE.at_across, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_down + now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_down + before, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_right + now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_right + before, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_left + now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_left + before, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_far_across, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_far_down + far_now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_far_down + far_before, axis, width)),
        )
        out = row_at(scratch, row_start(FEATURE.at_close, axis, width))
        if FEATURE.gravity and axis == 1:
            vertical_sum(blocks, *pulls, parameters.gravity, out)
        else:
            plain_sum(blocks, *pulls, 0.0, out)


@routine
def rows_of(scratch, triple, width):
    x, y = row_at(scratch, row_start(triple, 0, width)), row_at(scratch, row_start(triple, 1, width))
    return x, y, row_at(scratch, row_start(triple, 2, width))


@routine
def add_particle_force(i, closing, opening, layout, parameters, integers, scratch, width):
    """Add forces on single masses to row `i`'s sums. `closing`: the number of the step whose forces the sum `close` gets;
    `opening`: that of `open`."""
    columns, close = layout[L_COLUMNS], rows_of(scratch, FEATURE.at_close, width)
    if FEATURE.changing and FEATURE.verlet:
        also = rows_of(scratch, FEATURE.at_open, width)
        for axis in range(AXES):
            for j in range(columns):
                also[axis][j] = close[axis][j]
        add_3d(columns, i * columns, opening, parameters, integers, *also)
    add_3d(columns, i * columns, closing, parameters, integers, *close)


@routine
def begin_walk(first, blocks, layout, source, parameters, air, scratch, width):
    """Compute the springs and triangles that lead down from the two rows above `first`, if there are any."""
    if first < SPAN:
        for triple in range(FEATURE.cleared):
            clear_triple(scratch, np.int64(triple), width)
    for i in range(max(first - SPAN, 0), first):
        spring_rows(i, False, blocks, layout, source, parameters, scratch, width)
    if FEATURE.wind and first > 0:
        wind_cells(first - 1, blocks, layout, source, parameters, air, scratch, width)


@routine
def sum_forces(i, closing, opening, blocks, source, sheet, air, scratch, width):
    """Write the accelerations of row `i`, without the damper, into `close` (and `open`)."""
    layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
    spring_rows(i, True, blocks, layout, source, parameters, scratch, width)
    sum_accelerations(i, blocks, parameters, scratch, width)
    if FEATURE.wind:
        wind_cells(i, blocks, layout, source, parameters, air, scratch, width)
        add_wind(i, blocks, scratch, width)
    if FEATURE.forced:
        add_particle_force(i, closing, opening, layout, parameters, integers, scratch, width)


def pulls_of(parts: frozenset[str], pulls: Callable = pulls) -> dict[str, Callable]:
    """Return `pulls` for each kind of springs, by their open names."""
    kinds = {}
    for kind in SPRING_KINDS:
        names = dict(zip(("k_stiffness", "k_rest", "k_damping"), spring_constants(kind), strict=True))
        kinds[kind] = filled(pulls, {**names, "has_damper": f"{kind}-damping" in parts})
    return kinds


def of_scene(kernel: Callable, integrator: str, parts: frozenset[str]) -> Callable:
    """Return a kernel with the springs and forces of a scene and the formula of an integrator."""
    return with_forces(filled(kernel, {**pulls_of(parts), "one_force": step_formula(integrator)}), parts)


def cloth_features(real: Real, integrator: str, parts: frozenset[str]) -> dict[str, Feature]:
    """Return the features of a cloth's kernels."""
    at = triples_of(parts)
    names = ("across", "close", "down", "far_across", "far_down", "first", "left", "open", "right", "second")
    return {
        **sheet_features(integrator, parts), **{f"at_{name}": at.get(name, 0) for name in names}, "axes": AXES,
        "cleared": at["count"], "colliders": not parts.isdisjoint(COLLIDER_KINDS),
        "neighbour_velocities": not kicks_coupled(parts), "triples": at["count"],
    }  # fmt: skip


def cloth_kernel(compiler: Compiler, kernel: Callable, real: Real, integrator: str, parts: frozenset[str]) -> Callable:
    """Return a copy of a kernel of the cloth for a scene's `parts`, which the compiler compiles."""
    variant = compiler.variant_of(real, cloth_features(real, integrator, parts))
    return variant.copied(of_scene(kernel, integrator, parts))
