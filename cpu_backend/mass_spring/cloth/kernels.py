"""The kernel `fused` of the cloth: one pass over the sheet per step, one thread per band of rows, as in
mass_spring/grid/kernels.py.

For each row: forces (mass_spring/cloth/rows.py), the integrator's formula, colliders, pins. mass_spring/cloth/rk4.py
has the Runge-Kutta method, which has stages.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row
from softlab.cpu_backend.contact.pins import follow
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import AXES, cloth_variant, row_start
from softlab.cpu_backend.core.wind import air_now
from softlab.cpu_backend.mass_spring.cloth.rows import (
    begin_walk,
    cloth_kernel,
    sum_forces,
)
from softlab.cpu_backend.mass_spring.grid.row_step import CLOSING, OPENING, finish_axis, pass_kind
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.contact.cloth_parameters import P_MOTION, PIN_FIELDS
from softlab.model.formulas.cloth import instant

PLANES = 2 * AXES  # x, y, z, vx, vy, vz
PIN_ROWS = 3  # index in the integers: where the rows of pins begin among those of colliders and motions


@row_routine
def fill_spare(plane_row, value, spare):
    for j in range(BLOCK):
        plane_row[j] = value if j >= BLOCK - spare else plane_row[j]


@routine
def settle(i, blocks, source, target, time, sheet):
    """Put pinned masses where `source` has them, at rest, or where their motion has them at `time` [s]; the padding
    columns copy the row's last mass, at rest, so that they stay finite."""
    layout, bodies = sheet.layout, sheet.bodies
    columns, plane, here = layout[L_COLUMNS], layout[L_PLANE], i * layout[L_STRIDE]
    if FEATURE.pins:
        for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
            place = here + sheet.pin_column[k]
            for axis in range(AXES):
                target[place + axis * plane] = source[place + axis * plane]
                target[place + (AXES + axis) * plane] = 0.0
            if FEATURE.motion:
                pin = np.int64(sheet.integers[PIN_ROWS]) + PIN_FIELDS * k
                if bodies[pin + P_MOTION] >= 0.0:
                    x, y, z, vx, vy, vz = follow(bodies, pin, time)
                    target[place], target[place + plane], target[place + 2 * plane] = x, y, z
                    target[place + 3 * plane], target[place + 4 * plane], target[place + 5 * plane] = vx, vy, vz
    if columns % BLOCK != 0:
        last_block = here + (blocks - 1) * BLOCK
        for axis in range(AXES):
            last = target[here + axis * plane + columns - 1]
            fill_spare(row_at(target, last_block + axis * plane), last, BLOCK - columns % BLOCK)
            fill_spare(row_at(target, last_block + (AXES + axis) * plane), 0.0, BLOCK - columns % BLOCK)


@routine
def advance_band(band, kind, step, states, current, sheet, scratches):
    layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // (AXES * FEATURE.triples)
    first, last = rows * band // bands, rows * (band + 1) // bands
    source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
    scratch = scratches[band]
    blocks = (columns + BLOCK - 1) // BLOCK
    air = (0.0, 0.0, 0.0)
    if FEATURE.wind:
        air = air_now(parameters, integers, step, 0.0)
    closing = step - 1 if FEATURE.verlet and ((FEATURE.changing and FEATURE.verlet) or kind == CLOSING) else step
    end = 0.0
    if FEATURE.motion:
        ended = step if FEATURE.verlet and kind == CLOSING else step + 1
        end = instant(ended, parameters.dt, parameters.first_step, parameters.first_time)
    begin_walk(first, blocks, layout, source, parameters, air, scratch, width)
    for i in range(first, last):
        here = i * stride
        sum_forces(i, closing, step, blocks, source, sheet, air, scratch, width)
        for axis in range(AXES):
            position, velocity = here + axis * plane, here + (AXES + axis) * plane
            close = row_at(scratch, row_start(FEATURE.at_close, axis, width))
            also = (
                row_at(scratch, row_start(FEATURE.at_open, axis, width))
                if FEATURE.changing and FEATURE.verlet
                else close
            )
            finish_axis(
                kind, blocks, row_at(source, position), row_at(source, velocity), close, also, parameters,
                row_at(target, position), row_at(target, velocity),
            )  # fmt: skip
        if FEATURE.colliders and not (FEATURE.verlet and kind == CLOSING):
            collide_row(sheet.bodies, sheet.kinds, step, parameters, blocks, source, here, plane, target, here, plane)
        settle(i, blocks, source, target, end, sheet)


@routine
def advance(team, member, bands, passes, states, current, sheet, scratches):
    for k in range(passes.number):
        kind, begun = pass_kind(k, passes), k
        if FEATURE.verlet and FEATURE.neighbour_velocities:
            kind, begun = CLOSING if k % 2 else OPENING, (k + 1) // 2
        for band in assigned(team, member, bands):
            advance_band(np.int64(band), kind, passes.step + begun, states, (current + k) % 2, sheet, scratches)


@cache
def make_cloth_advance(real: Real, math: str, integrator: str, parts: frozenset[str]) -> Callable:
    """Compile the kernel for one-force integrators and velocity Verlet.

    advance(bands, passes, states, current, sheet, scratches) does the passes of `passes` over the sheet,
    alternating between the two states in the flat array `states` (core/layout.py); the first reads number `current`. If
    velocity Verlet's kicks cannot be combined (model/cloth_plan.kicks_coupled), passes open and close steps in turn.
    `scratches`: a flat row per band.
    """
    compiler = Compiler(cloth_variant(f"fused_{integrator}", real, math, parts), math)
    return compiler.team(cloth_kernel(compiler, advance, real, integrator, parts))
