"""The kernel `fused` of the cloth: one pass over the sheet per step, one thread per band of rows, as in
mass_spring/grid/kernels.py.

For each row: forces (mass_spring/cloth/rows.py), the integrator's formula, colliders, pins. mass_spring/cloth/rk4.py
has the Runge-Kutta method, which has stages.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_row
from softlab.cpu_backend.contact.pins import make_follow
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import AXES, cloth_variant, triples_of
from softlab.cpu_backend.mass_spring.cloth.rows import make_cloth_forces
from softlab.cpu_backend.mass_spring.grid.row_step import CLOSING, OPENING, finish_axis, pass_kind
from softlab.model.base.types import Real
from softlab.model.base.variant import filled
from softlab.model.contact.cloth_parameters import (
    P_MOTION,
    PIN_FIELDS,
)
from softlab.model.core.integrators import step_formula
from softlab.model.formulas import cloth
from softlab.model.mass_spring.cloth_plan import kicks_coupled
from softlab.model.mass_spring.plan import sheet_features
from softlab.model.tables.cloth import COLLIDER_KINDS

PLANES = 2 * AXES  # x, y, z, vx, vy, vz
PIN_ROWS = 3  # index in the integers: where the rows of pins begin among those of colliders and motions


def make_settle(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the functions that complete a written row: `collide_row` (contact/colliders.py; only if `has_colliders`) and
    `settle(i, blocks, source, target, time, sheet)`.

    `settle` puts pinned masses where `source` has them, at rest, or where their motion has them at `time` [s]; the
    padding columns copy the row's last mass, at rest, so that they stay finite.
    """
    block, zero, has_pins, has_motion = block_of(real), real(0), "pins" in parts, "motion" in parts
    follow = make_follow(compiler, real)

    @compiler.row
    def fill_spare(plane_row, value, spare):
        for j in range(block):
            plane_row[j] = value if j >= block - spare else plane_row[j]

    @compiler.compiled
    def settle(i, blocks, source, target, time, sheet):
        layout, bodies = sheet.layout, sheet.bodies
        columns, plane, here = layout[L_COLUMNS], layout[L_PLANE], i * layout[L_STRIDE]
        if has_pins:
            for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
                place = here + sheet.pin_column[k]
                for axis in range(AXES):
                    target[place + axis * plane] = source[place + axis * plane]
                    target[place + (AXES + axis) * plane] = zero
                if has_motion:
                    pin = np.int64(sheet.integers[PIN_ROWS]) + PIN_FIELDS * k
                    if bodies[pin + P_MOTION] >= zero:
                        x, y, z, vx, vy, vz = follow(bodies, pin, time)
                        target[place], target[place + plane], target[place + 2 * plane] = x, y, z
                        target[place + 3 * plane], target[place + 4 * plane], target[place + 5 * plane] = vx, vy, vz
        if columns % block != 0:
            last_block = here + (blocks - 1) * block
            for axis in range(AXES):
                last = target[here + axis * plane + columns - 1]
                fill_spare(row_at(target, last_block + axis * plane), last, block - columns % block)
                fill_spare(row_at(target, last_block + (AXES + axis) * plane), zero, block - columns % block)

    has_colliders = not parts.isdisjoint(COLLIDER_KINDS)
    return SimpleNamespace(
        settle=settle, has_colliders=has_colliders, collide_row=make_collide_row(compiler, real, parts)
    )


def make_finish_rows(compiler: Compiler, real: Real, integrator: str, parts: frozenset[str]) -> Callable:
    """Make finish(kind, blocks, position, velocity, closing, opening, parameters, new_position, new_velocity): it
    integrates one axis of a row from its sums of accelerations."""
    features = {**sheet_features(integrator, parts), "block": block_of(real)}
    return compiler.variant_of(real, features)(filled(finish_axis, {"one_force": step_formula(integrator)}))


@cache
def make_cloth_advance(real: Real, math: str, integrator: str, parts: frozenset[str]) -> Callable:
    """Compile the kernel for one-force integrators and velocity Verlet.

    advance(bands, passes, states, current, sheet, scratches) does the passes of `passes` over the sheet,
    alternating between the two states in the flat array `states` (core/layout.py); the first reads number `current`. If
    velocity Verlet's kicks cannot be combined (model/cloth_plan.kicks_coupled), passes open and close steps in turn.
    `scratches`: a flat row per band.
    """
    compiler = Compiler(cloth_variant(f"fused_{integrator}", real, math, parts), math)
    forces = make_cloth_forces(compiler, real, integrator, parts)
    settled = make_settle(compiler, real, parts)
    settle, collide_row, has_colliders = settled.settle, settled.collide_row, settled.has_colliders
    finish_axis = make_finish_rows(compiler, real, integrator, parts)
    begin_walk, sum_forces, air_now, place = forces.begin_walk, forces.sum_forces, forces.air_now, forces.place
    kind_of = compiler.compiled(pass_kind)
    two_sums, a_close, a_open = forces.two_sums, forces.a_close, forces.a_open
    verlet, has_wind, has_motion = integrator == "velocity-verlet", "wind" in parts, "motion" in parts
    instant = compiler.formulas(cloth, real).instant
    in_turn = verlet and not kicks_coupled(parts)
    triples, block, zero = triples_of(parts)["count"], block_of(real), real(0)

    @compiler.compiled
    def advance_band(band, kind, step, states, current, sheet, scratches):
        layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
        rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // (AXES * triples)
        first, last = rows * band // bands, rows * (band + 1) // bands
        source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
        scratch = scratches[band]
        blocks = (columns + block - 1) // block
        air = (zero, zero, zero)
        if has_wind:
            air = air_now(parameters, integers, step, zero)
        closing = step - 1 if verlet and (two_sums or kind == CLOSING) else step
        end = zero
        if has_motion:
            ended = step if verlet and kind == CLOSING else step + 1
            end = instant(ended, parameters.dt, parameters.first_step, parameters.first_time)
        begin_walk(first, blocks, layout, source, parameters, air, scratch, width)
        for i in range(first, last):
            here = i * stride
            sum_forces(i, closing, step, blocks, source, sheet, air, scratch, width)
            for axis in range(AXES):
                position, velocity = here + axis * plane, here + (AXES + axis) * plane
                close = row_at(scratch, place(a_close, axis, width))
                also = row_at(scratch, place(a_open, axis, width)) if two_sums else close
                finish_axis(
                    kind, blocks, row_at(source, position), row_at(source, velocity), close, also, parameters,
                    row_at(target, position), row_at(target, velocity),
                )  # fmt: skip
            if has_colliders and not (verlet and kind == CLOSING):
                collide_row(
                    sheet.bodies, sheet.kinds, step, parameters, blocks, source, here, plane, target, here, plane
                )
            settle(i, blocks, source, target, end, sheet)

    def advance(team, member, bands, passes, states, current, sheet, scratches):
        for k in range(passes.number):
            kind, begun = kind_of(k, passes), k
            if in_turn:
                kind, begun = CLOSING if k % 2 else OPENING, (k + 1) // 2
            for band in assigned(team, member, bands):
                advance_band(np.int64(band), kind, passes.step + begun, states, (current + k) % 2, sheet, scratches)

    return compiler.team(advance)
