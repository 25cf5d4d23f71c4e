"""The classical Runge-Kutta method on the cloth: four passes per step, each as in mass_spring/cloth/kernels.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import AXES, cloth_variant, triples_of
from softlab.cpu_backend.mass_spring.cloth.kernels import PLANES, make_settle
from softlab.cpu_backend.mass_spring.cloth.rows import make_cloth_forces
from softlab.cpu_backend.mass_spring.grid.rk4 import BASE, SOURCE, STAGE_2, TARGET, TOTAL
from softlab.cpu_backend.mass_spring.grid.rk4 import update as update_row
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, motion, springs


def make_times(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make times(stage, step, parameters) -> (time of the stage's forces within the step, in steps; end time of the
    stage [s], 0 if no pin moves)."""
    instant, middle = compiler.formulas(cloth, real).instant, compiler.formulas(motion, real).middle
    has_motion, zero, half, one = "motion" in parts, real(0), real(0.5), real(1)

    @compiler.compiled
    def times(stage, step, parameters):
        offset = zero
        if stage == 1 or stage == 2:
            offset = half
        elif stage == 3:
            offset = one
        end = zero  # end of the stage: half of the step, half of it, all of it, all of it
        if has_motion:
            clock = parameters.dt, parameters.first_step, parameters.first_time
            end = middle(step, *clock) if stage < 2 else instant(step + 1, *clock)
        return offset, end

    return times


def make_stage_band(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make stage_band(band, stage, step, ...): a stage of a step on the rows of a band; other arguments as the
    kernel's.

    The fourth pass writes a row to a stage that is no longer read, since colliders need the old positions, and then
    copies it to the state.
    """
    compiled, row = compiler.compiled, compiler.row
    forces = make_cloth_forces(compiler, real, "rk4", parts)
    begin_walk, sum_forces, air_now, place = forces.begin_walk, forces.sum_forces, forces.air_now, forces.place
    settled = make_settle(compiler, real, parts)
    settle, collide_row, has_colliders = settled.settle, settled.collide_row, settled.has_colliders
    update = compiler.variant_of(real, {"block": block_of(real)})(update_row)
    damped = compiler.formulas(springs, real).damped
    has_wind, has_damping, a_close = "wind" in parts, "damping" in parts, forces.a_close
    triples, block = triples_of(parts)["count"], block_of(real)
    times, zero = make_times(compiler, real, parts), real(0)

    @row
    def damp(blocks, velocity, parameters, out):
        for j in range(blocks * block):
            out[j] = damped(out[j], velocity[j], parameters.damping)

    @row
    def copy_row(blocks, source, target):
        for j in range(blocks * block):
            target[j] = source[j]

    @compiled
    def stage_band(band, stage, step, states, sheet, scratches):
        layout, parameters, integers = sheet.layout, sheet.parameters, sheet.integers
        rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // (AXES * triples)
        first, last = rows * band // bands, rows * (band + 1) // bands
        size = PLANES * plane
        base, total = row_at(states, BASE * size), row_at(states, TOTAL * size)
        spare = row_at(states, STAGE_2 * size)
        source, target = row_at(states, SOURCE[stage] * size), row_at(states, TARGET[stage] * size)
        scratch = scratches[band]
        blocks = (columns + block - 1) // block
        offset, end = times(stage, step, parameters)
        air = (zero, zero, zero)
        if has_wind:
            air = air_now(parameters, integers, step, offset)
        begin_walk(first, blocks, layout, source, parameters, air, scratch, width)
        for i in range(first, last):
            here = i * stride
            sum_forces(i, step, step, blocks, source, sheet, air, scratch, width)
            into = target
            if has_colliders and stage == 3:
                into = spare
            for axis in range(AXES):
                position, velocity = here + axis * plane, here + (AXES + axis) * plane
                rate = row_at(scratch, place(a_close, axis, width))
                if has_damping:
                    damp(blocks, row_at(source, velocity), parameters, rate)
                update(
                    stage, blocks, row_at(base, position), row_at(source, velocity), parameters, row_at(total, position),
                    row_at(into, position),
                )  # fmt: skip
                update(
                    stage, blocks, row_at(base, velocity), rate, parameters, row_at(total, velocity), row_at(into, velocity)
                )  # fmt: skip
            if has_colliders and stage == 3:
                collide_row(sheet.bodies, sheet.kinds, step, parameters, blocks, base, here, plane, spare, here, plane)
                for axis in range(PLANES):
                    copy_row(blocks, row_at(spare, here + axis * plane), row_at(base, here + axis * plane))
            settle(i, blocks, source, target, end, sheet)

    return stage_band


@cache
def make_cloth_rk4(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, states, sheet, scratches).

    `states` as in mass_spring/grid/rk4.py, the rest as in mass_spring/cloth/kernels.py.
    """
    compiler = Compiler(cloth_variant("fused_rk4", real, math, parts), math)
    stage_band = make_stage_band(compiler, real, parts)

    def advance(team, member, bands, steps, step, states, sheet, scratches):
        for k in range(4 * steps):
            for band in assigned(team, member, bands):
                stage_band(np.int64(band), k % 4, step + k // 4, states, sheet, scratches)

    return compiler.team(advance)
