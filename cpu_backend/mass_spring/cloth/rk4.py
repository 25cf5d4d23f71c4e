"""The classical Runge-Kutta method on the cloth: four passes per step, each as in mass_spring/cloth/kernels.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import AXES, cloth_variant, row_start
from softlab.cpu_backend.core.wind import air_now
from softlab.cpu_backend.mass_spring.cloth.kernels import PLANES, settle
from softlab.cpu_backend.mass_spring.cloth.rows import (
    begin_walk,
    cloth_kernel,
    sum_forces,
)
from softlab.cpu_backend.mass_spring.grid.rk4 import BASE, SOURCE, STAGE_2, TARGET, TOTAL, damp, update
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.motion import middle


@routine
def times(stage, step, parameters):
    """Return (time of the stage's forces within the step, in steps; end time of the stage [s], 0 if no pin moves)."""
    offset = 0.0
    if stage == 1 or stage == 2:
        offset = 0.5
    elif stage == 3:
        offset = 1.0
    end = 0.0  # end of the stage: half of the step, half of it, all of it, all of it
    if FEATURE.motion:
        clock = parameters.dt, parameters.first_step, parameters.first_time
        end = middle(step, *clock) if stage < 2 else instant(step + 1, *clock)
    return offset, end


@row_routine
def copy_row(blocks, source, target):
    for j in range(blocks * BLOCK):
        target[j] = source[j]


@routine
def stage_band(band, stage, step, states, sheet, scratches):
    """Do a stage of a step on the rows of a band.

    The fourth pass writes a row to a stage that is no longer read, since colliders need the old positions, and then
    copies it to the state.
    """
    layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // (AXES * FEATURE.triples)
    first, last = rows * band // bands, rows * (band + 1) // bands
    size = PLANES * plane
    base, total = row_at(states, BASE * size), row_at(states, TOTAL * size)
    spare = row_at(states, STAGE_2 * size)
    source, target = row_at(states, SOURCE[stage] * size), row_at(states, TARGET[stage] * size)
    scratch = scratches[band]
    blocks = (columns + BLOCK - 1) // BLOCK
    offset, end = times(stage, step, parameters)
    air = (0.0, 0.0, 0.0)
    if FEATURE.wind:
        air = air_now(parameters, integers, step, offset)
    begin_walk(first, blocks, layout, source, parameters, air, scratch, width)
    for i in range(first, last):
        here = i * stride
        sum_forces(i, step, step, blocks, source, sheet, air, scratch, width)
        into = target
        if FEATURE.colliders and stage == 3:
            into = spare
        for axis in range(AXES):
            position, velocity = here + axis * plane, here + (AXES + axis) * plane
            rate = row_at(scratch, row_start(FEATURE.at_close, axis, width))
            if FEATURE.damped:
                damp(blocks, row_at(source, velocity), parameters, rate)
            update(
                stage, blocks, row_at(base, position), row_at(source, velocity), parameters, row_at(total, position),
                row_at(into, position),
            )  # fmt: skip
            update(
                stage, blocks, row_at(base, velocity), rate, parameters, row_at(total, velocity), row_at(into, velocity)
            )  # fmt: skip
        if FEATURE.colliders and stage == 3:
            collide_row(sheet.bodies, sheet.kinds, step, parameters, blocks, base, here, plane, spare, here, plane)
            for axis in range(PLANES):
                copy_row(blocks, row_at(spare, here + axis * plane), row_at(base, here + axis * plane))
        settle(i, blocks, source, target, end, sheet)


@routine
def advance(team, member, bands, steps, step, states, sheet, scratches):
    for k in range(4 * steps):
        for band in assigned(team, member, bands):
            stage_band(np.int64(band), k % 4, step + k // 4, states, sheet, scratches)


@cache
def make_cloth_rk4(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, states, sheet, scratches).

    `states` as in mass_spring/grid/rk4.py, the rest as in mass_spring/cloth/kernels.py.
    """
    compiler = Compiler(cloth_variant("fused_rk4", real, math, parts), math)
    return compiler.team(cloth_kernel(compiler, advance, real, "rk4", parts))
