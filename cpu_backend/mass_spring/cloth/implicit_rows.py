"""Operations of implicit Euler on a row of a cloth, for each pass over the sheet (model/formulas/implicit.py names
them).

The working memory is planes as of a state, three for a vector, in the order for mass_spring/cloth/implicit_pulls.py.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_STRIDE, row_at
from softlab.cpu_backend.core.scratch import AXES, clear_triple, row_start
from softlab.cpu_backend.mass_spring.cloth.implicit_pulls import end_pulls, products
from softlab.cpu_backend.mass_spring.cloth.rows import (
    begin_walk,
    cloth_features,
    of_scene,
    spring_rows,
    sum_accelerations,
    sum_forces,
)
from softlab.cpu_backend.mass_spring.cloth.sums import segment_sums
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine, row_routine
from softlab.model.formulas.implicit import added, applied, residual
from softlab.model.tables.cloth import SPRING_KINDS

# First planes of the vectors: position without the velocity at the step's end, current estimates of position and
# velocity there, residual, solution of the Newton step, direction and A direction, A residual, velocity without
# springs.
BASE, X, U, R, S, Q, AQ, AR, BEGIN = range(0, 9 * AXES, AXES)
WORK_PLANES = 9 * AXES
# of other variants: all forces except the springs' at the step's start, spring terms at its end and of a product
walk_elsewhere, sum_elsewhere = Open("walk_elsewhere: rows.begin_walk"), Open("sum_elsewhere: rows.sum_forces")
pull_end, pull_matrix = Open("pull_end: rows.spring_rows"), Open("pull_matrix: rows.spring_rows")
sum_springs = Open("sum_springs: rows.sum_accelerations")


def spring_parts(parts: frozenset[str]) -> frozenset[str]:
    """Return the springs and their dampers: the forces that are evaluated at the step's end."""
    return frozenset(part for part in parts if part.split("-")[0] in SPRING_KINDS)


@row_routine
def leave(blocks, x, u, dt, base):
    for j in range(blocks * BLOCK):
        base[j] = added(x[j], -dt, u[j])


@row_routine
def begin(blocks, position, velocity, acceleration, dt, x, u, started):
    for j in range(blocks * BLOCK):
        x[j] = position[j]
        u[j] = 0.0
        started[j] = added(velocity[j], dt, acceleration[j])


@row_routine
def missing(blocks, started, u, acceleration, dt, rate, r):
    for j in range(blocks * BLOCK):
        r[j] = residual(started[j], u[j], acceleration[j], dt, rate)


@row_routine
def apply(blocks, r, pulls, mass_entry, out):
    for j in range(blocks * BLOCK):
        out[j] = applied(r[j], pulls[j], mass_entry)


@row_routine
def first_update(blocks, alpha, applied_r, r, s, q, applied_q):
    for j in range(blocks * BLOCK):
        q[j] = r[j]
        applied_q[j] = applied_r[j]
        s[j] = added(0.0, alpha, r[j])
        r[j] = added(r[j], -alpha, applied_r[j])


@row_routine
def next_update(blocks, alpha, beta, applied_r, r, s, q, applied_q):
    for j in range(blocks * BLOCK):
        direction, applied_direction = added(r[j], beta, q[j]), added(applied_r[j], beta, applied_q[j])
        q[j] = direction
        applied_q[j] = applied_direction
        s[j] = added(s[j], alpha, direction)
        r[j] = added(r[j], -alpha, applied_direction)


@row_routine
def move(blocks, position, dt, s, u, x):
    for j in range(blocks * BLOCK):
        u[j] = added(u[j], 1.0, s[j])
        x[j] = added(position[j], dt, u[j])


@row_routine
def retreat(blocks, position, dt, s, u, x):
    for j in range(blocks * BLOCK):
        s[j] = 0.5 * s[j]
        u[j] = added(u[j], -1.0, s[j])
        x[j] = added(position[j], dt, u[j])


@row_routine
def copy(blocks, source, target):
    for j in range(blocks * BLOCK):
        target[j] = source[j]


@routine
def zero_pinned(i, work, vector, sheet):
    """Zero the entries of pinned masses in a vector of the system."""
    layout = sheet.layout
    if FEATURE.pins:
        here, plane = i * layout[L_STRIDE], layout[L_PLANE]
        for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
            for axis in range(AXES):
                work[here + sheet.pin_column[k] + (vector + axis) * plane] = 0.0


@routine
def add_up(i, layout, work, one, other, lanes, out):
    """Write the segments' sums of the dot products of two vectors on row `i`."""
    columns, plane, here = layout[L_COLUMNS], layout[L_PLANE], i * layout[L_STRIDE]
    a, b = here + one * plane, here + other * plane
    segment_sums(
        columns, row_at(work, a), row_at(work, a + plane), row_at(work, a + 2 * plane), row_at(work, b),
        row_at(work, b + plane), row_at(work, b + 2 * plane), lanes, out,
    )  # fmt: skip


@routine
def clear(scratch, width):
    """Clear the rows of scratch before a walk begins in the sheet's first rows."""
    for triple in range(FEATURE.cleared):
        clear_triple(scratch, np.int64(triple), width)


@routine
def residual_row(i, blocks, work, sheet, system, scratch, width):
    layout, parameters = sheet.layout, sheet.parameters
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    sum_springs(i, blocks, parameters, scratch, width)
    for axis in range(AXES):
        missing(
            blocks, row_at(work, here + (BEGIN + axis) * plane), row_at(work, here + (U + axis) * plane),
            row_at(scratch, row_start(FEATURE.at_close, axis, width)), system.dt, system.damping_of_step,
            row_at(work, here + (R + axis) * plane),
        )  # fmt: skip
    zero_pinned(i, work, R, sheet)


@routine
def product_row(i, blocks, work, sheet, system, scratch, width):
    layout = sheet.layout
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    sum_springs(i, blocks, system, scratch, width)
    for axis in range(AXES):
        apply(
            blocks, row_at(work, here + (R + axis) * plane), row_at(scratch, row_start(FEATURE.at_close, axis, width)),
            system.mass_entry, row_at(work, here + (AR + axis) * plane),
        )  # fmt: skip
    zero_pinned(i, work, AR, sheet)


@routine
def update_row(i, first, blocks, layout, work, alpha, beta):
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    for axis in range(AXES):
        applied_r, r = row_at(work, here + (AR + axis) * plane), row_at(work, here + (R + axis) * plane)
        s, q = row_at(work, here + (S + axis) * plane), row_at(work, here + (Q + axis) * plane)
        applied_q = row_at(work, here + (AQ + axis) * plane)
        if first:
            first_update(blocks, alpha, applied_r, r, s, q, applied_q)
        else:
            next_update(blocks, alpha, beta, applied_r, r, s, q, applied_q)


@routine
def start_row(i, blocks, layout, source, work, parameters, scratch, width):
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    for axis in range(AXES):
        begin(
            blocks, row_at(source, here + axis * plane), row_at(source, here + (AXES + axis) * plane),
            row_at(scratch, row_start(FEATURE.at_close, axis, width)), parameters.dt, row_at(work, here + (X + axis) * plane),
            row_at(work, here + (U + axis) * plane), row_at(work, here + (BEGIN + axis) * plane),
        )  # fmt: skip


@routine
def leave_row(i, blocks, layout, work, parameters):
    """Write the positions without the end velocity: the old positions, except for pins that move."""
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    for axis in range(AXES):
        x, u = row_at(work, here + (X + axis) * plane), row_at(work, here + (U + axis) * plane)
        leave(blocks, x, u, parameters.dt, row_at(work, here + (BASE + axis) * plane))


@routine
def move_row(i, back, blocks, layout, source, work, parameters):
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    for axis in range(AXES):
        position, s = row_at(source, here + axis * plane), row_at(work, here + (S + axis) * plane)
        u, x = row_at(work, here + (U + axis) * plane), row_at(work, here + (X + axis) * plane)
        if back:
            retreat(blocks, position, parameters.dt, s, u, x)
        else:
            move(blocks, position, parameters.dt, s, u, x)


@routine
def finish_row(i, step, blocks, layout, source, work, target, parameters, bodies, kinds):
    plane, here = layout[L_PLANE], i * layout[L_STRIDE]
    for axis in range(2 * AXES):
        copy(blocks, row_at(work, here + (X + axis) * plane), row_at(target, here + axis * plane))
    if FEATURE.colliders:
        collide_row(bodies, kinds, step, parameters, blocks, source, here, plane, target, here, plane)


def system_functions(compiler: Compiler, real: Real, parts: frozenset[str]) -> dict[str, Callable]:
    """Return the functions for the open names of the passes in a scene."""
    springs, integrator = spring_parts(parts), "implicit-euler"
    elsewhere = compiler.variant_of(real, cloth_features(real, integrator, parts - springs))
    system = compiler.variant_of(real, cloth_features(real, integrator, springs))
    return {
        "walk_elsewhere": elsewhere(of_scene(begin_walk, integrator, parts - springs)),
        "sum_elsewhere": elsewhere(of_scene(sum_forces, integrator, parts - springs)),
        "pull_end": system(filled(spring_rows, end_pulls(springs))),
        "pull_matrix": system(filled(spring_rows, products(springs))), "sum_springs": system(sum_accelerations),
    }  # fmt: skip
