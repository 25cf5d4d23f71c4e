"""Operations of implicit Euler on a row of a cloth, for each pass over the sheet (model/formulas/implicit.py names
them).

The working memory is planes as of a state, three for a vector, in the order for mass_spring/cloth/implicit_pulls.py.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, L_PLANE, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.scratch import AXES, make_scratch, triples_of
from softlab.cpu_backend.mass_spring.cloth.implicit_pulls import make_end_pulls, make_products
from softlab.cpu_backend.mass_spring.cloth.kernels import make_settle
from softlab.cpu_backend.mass_spring.cloth.rows import make_cloth_forces, make_spring_rows, make_sums
from softlab.cpu_backend.mass_spring.cloth.sums import make_sums_over_masses
from softlab.model.base.types import Real
from softlab.model.formulas import implicit
from softlab.model.tables.cloth import SPRING_KINDS

# First planes of the vectors: position without the velocity at the step's end, current estimates of position and
# velocity there, residual, solution of the Newton step, direction and A direction, A residual, velocity without
# springs.
BASE, X, U, R, S, Q, AQ, AR, BEGIN = range(0, 9 * AXES, AXES)
WORK_PLANES = 9 * AXES


def spring_parts(parts: frozenset[str]) -> frozenset[str]:
    """Return the springs and their dampers: the forces that are evaluated at the step's end."""
    return frozenset(part for part in parts if part.split("-")[0] in SPRING_KINDS)


def make_loops(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make the loops along one axis of a row; the arrays that a loop writes are its last arguments."""
    row, block = compiler.row, block_of(real)
    formulas = compiler.formulas(implicit, real)
    residual, applied, added = formulas.residual, formulas.applied, formulas.added
    half, one, zero = real(0.5), real(1), real(0)

    @row
    def leave(blocks, x, u, dt, base):
        for j in range(blocks * block):
            base[j] = added(x[j], -dt, u[j])

    @row
    def begin(blocks, position, velocity, acceleration, dt, x, u, started):
        for j in range(blocks * block):
            x[j] = position[j]
            u[j] = zero
            started[j] = added(velocity[j], dt, acceleration[j])

    @row
    def missing(blocks, started, u, acceleration, dt, rate, r):
        for j in range(blocks * block):
            r[j] = residual(started[j], u[j], acceleration[j], dt, rate)

    @row
    def apply(blocks, r, pulls, mass_entry, out):
        for j in range(blocks * block):
            out[j] = applied(r[j], pulls[j], mass_entry)

    @row
    def first_update(blocks, alpha, applied_r, r, s, q, applied_q):
        for j in range(blocks * block):
            q[j] = r[j]
            applied_q[j] = applied_r[j]
            s[j] = added(zero, alpha, r[j])
            r[j] = added(r[j], -alpha, applied_r[j])

    @row
    def next_update(blocks, alpha, beta, applied_r, r, s, q, applied_q):
        for j in range(blocks * block):
            direction, applied = added(r[j], beta, q[j]), added(applied_r[j], beta, applied_q[j])
            q[j] = direction
            applied_q[j] = applied
            s[j] = added(s[j], alpha, direction)
            r[j] = added(r[j], -alpha, applied)

    @row
    def move(blocks, position, dt, s, u, x):
        for j in range(blocks * block):
            u[j] = added(u[j], one, s[j])
            x[j] = added(position[j], dt, u[j])

    @row
    def retreat(blocks, position, dt, s, u, x):
        for j in range(blocks * block):
            s[j] = half * s[j]
            u[j] = added(u[j], -one, s[j])
            x[j] = added(position[j], dt, u[j])

    @row
    def copy(blocks, source, target):
        for j in range(blocks * block):
            target[j] = source[j]

    return SimpleNamespace(
        begin=begin, leave=leave, missing=missing, apply=apply, first_update=first_update, next_update=next_update, move=move,
        retreat=retreat, copy=copy,
    )  # fmt: skip


def make_system_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the operations of the passes over the linear system on row `i`.

    `residual_row`, `product_row`, `update_row`; `add_up`: sums over masses; `pull_end`, `pull_matrix`: spring terms at
    the step's end and of a product; `clear(scratch, width)`: before a walk begins in the sheet's first rows.
    """
    compiled, zero, loops = compiler.compiled, real(0), make_loops(compiler, real)
    missing, apply, first_update, next_update = loops.missing, loops.apply, loops.first_update, loops.next_update
    springs, has_pins, scratches = spring_parts(parts), "pins" in parts, make_scratch(compiler, real)
    pull_end, pull_matrix = (
        make_spring_rows(compiler, real, springs, scratches, m) for m in (make_end_pulls, make_products)
    )
    sum_accelerations, at = make_sums(compiler, real, springs, scratches), triples_of(springs)
    place, clear_triple = scratches.place, scratches.clear
    segment_sums = make_sums_over_masses(compiler, real).segment_sums
    close, triples = at["close"], at["count"]

    @compiled
    def zero_pinned(i, work, vector, sheet):
        layout = sheet.layout
        """Zero the entries of pinned masses in a vector of the system."""
        if has_pins:
            here, plane = i * layout[L_STRIDE], layout[L_PLANE]
            for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
                for axis in range(AXES):
                    work[here + sheet.pin_column[k] + (vector + axis) * plane] = zero

    @compiled
    def add_up(i, layout, work, one, other, lanes, out):
        """Write the segments' sums of the dot products of two vectors on row `i`."""
        columns, plane, here = layout[L_COLUMNS], layout[L_PLANE], i * layout[L_STRIDE]
        a, b = here + one * plane, here + other * plane
        segment_sums(
            columns, row_at(work, a), row_at(work, a + plane), row_at(work, a + 2 * plane), row_at(work, b),
            row_at(work, b + plane), row_at(work, b + 2 * plane), lanes, out,
        )  # fmt: skip

    @compiled
    def clear(scratch, width):
        for triple in range(triples):
            clear_triple(scratch, np.int64(triple), width)

    @compiled
    def residual_row(i, blocks, work, sheet, system, scratch, width):
        layout, parameters = sheet.layout, sheet.parameters
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        sum_accelerations(i, blocks, parameters, scratch, width)
        for axis in range(AXES):
            missing(
                blocks, row_at(work, here + (BEGIN + axis) * plane), row_at(work, here + (U + axis) * plane),
                row_at(scratch, place(close, axis, width)), system.dt, system.damping_of_step,
                row_at(work, here + (R + axis) * plane),
            )  # fmt: skip
        zero_pinned(i, work, R, sheet)

    @compiled
    def product_row(i, blocks, work, sheet, system, scratch, width):
        layout = sheet.layout
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        sum_accelerations(i, blocks, system, scratch, width)
        for axis in range(AXES):
            apply(
                blocks, row_at(work, here + (R + axis) * plane), row_at(scratch, place(close, axis, width)),
                system.mass_entry, row_at(work, here + (AR + axis) * plane),
            )  # fmt: skip
        zero_pinned(i, work, AR, sheet)

    @compiled
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

    return SimpleNamespace(
        clear=clear, pull_end=pull_end, pull_matrix=pull_matrix, add_up=add_up, residual_row=residual_row,
        product_row=product_row, update_row=update_row,
    )  # fmt: skip


def make_row_passes(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the operations of each pass on row `i`: those of `make_system_rows`, and those that move masses.

    `elsewhere`: sums of all forces except the springs', at the step's start (mass_spring/cloth/rows.py).
    """
    compiled, loops, settled = compiler.compiled, make_loops(compiler, real), make_settle(compiler, real, parts)
    begin, leave, copy, move, retreat = loops.begin, loops.leave, loops.copy, loops.move, loops.retreat
    settle, collide_row, has_colliders = settled.settle, settled.collide_row, settled.has_colliders
    elsewhere = make_cloth_forces(compiler, real, "implicit-euler", parts - spring_parts(parts))
    place, else_close = make_scratch(compiler, real).place, elsewhere.a_close

    @compiled
    def start_row(i, blocks, layout, source, work, parameters, scratch, width):
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        for axis in range(AXES):
            begin(
                blocks, row_at(source, here + axis * plane), row_at(source, here + (AXES + axis) * plane),
                row_at(scratch, place(else_close, axis, width)), parameters.dt, row_at(work, here + (X + axis) * plane),
                row_at(work, here + (U + axis) * plane), row_at(work, here + (BEGIN + axis) * plane),
            )  # fmt: skip

    @compiled
    def leave_row(i, blocks, layout, work, parameters):
        """Write the positions without the end velocity: the old positions, except for pins that move."""
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        for axis in range(AXES):
            x, u = row_at(work, here + (X + axis) * plane), row_at(work, here + (U + axis) * plane)
            leave(blocks, x, u, parameters.dt, row_at(work, here + (BASE + axis) * plane))

    @compiled
    def move_row(i, back, blocks, layout, source, work, parameters):
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        for axis in range(AXES):
            position, s = row_at(source, here + axis * plane), row_at(work, here + (S + axis) * plane)
            u, x = row_at(work, here + (U + axis) * plane), row_at(work, here + (X + axis) * plane)
            if back:
                retreat(blocks, position, parameters.dt, s, u, x)
            else:
                move(blocks, position, parameters.dt, s, u, x)

    @compiled
    def finish_row(i, step, blocks, layout, source, work, target, parameters, bodies, kinds):
        plane, here = layout[L_PLANE], i * layout[L_STRIDE]
        for axis in range(2 * AXES):
            copy(blocks, row_at(work, here + (X + axis) * plane), row_at(target, here + axis * plane))
        if has_colliders:
            collide_row(bodies, kinds, step, parameters, blocks, source, here, plane, target, here, plane)

    return SimpleNamespace(
        elsewhere=elsewhere, settle=settle, start_row=start_row, leave_row=leave_row, move_row=move_row,
        finish_row=finish_row, **vars(make_system_rows(compiler, real, parts)),
    )  # fmt: skip
