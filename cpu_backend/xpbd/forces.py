"""Accelerations of a substep that differ between masses, in separate planes: wind, and forces on single masses.

Wind is the mass-spring cloth's (core/wind.py), whose walk needs rows that are not combed: the sheet is
copied for it.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_PLANE, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.own_forces import make_particle_force
from softlab.cpu_backend.core.scratch import AXES, make_scratch, triples_of
from softlab.cpu_backend.core.wind import make_winds
from softlab.cpu_backend.xpbd.layout import (
    P_ACCELERATION,
    P_BLOCKS,
    P_CLASS,
    P_COLUMNS,
    P_NATURAL,
    P_PLANE,
    P_SCRATCH_SIZE,
    P_SCRATCH_WIDTH,
    P_STRIDE,
    P_WIND_SCRATCH,
)
from softlab.model.base.types import Real
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas import distance


def has_forces(parts: frozenset[str]) -> bool:
    """Return True if accelerations differ between masses, which then need planes."""
    return "wind" in parts or bool(particle_forces(parts))


WIND_PARTS = frozenset({"wind", "gust"})


def make_comb(compiler: Compiler, real: Real, classes: int) -> SimpleNamespace:
    """Make `smooth(spacing, blocks, row, out)`, a combed row with its columns in order, and `comb`, the reverse."""
    block = block_of(real)

    @compiler.row
    def smooth(spacing, blocks, row, out):
        for j in range(blocks * block):
            for c in range(classes):
                out[j * classes + c] = row[c * spacing + j]

    @compiler.row
    def comb(spacing, blocks, row, out):
        for j in range(blocks * block):
            for c in range(classes):
                out[c * spacing + j] = row[j * classes + c]

    return SimpleNamespace(smooth=smooth, comb=comb)


def make_forces(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], classes: int) -> Callable:
    """Make add_forces(i, step, memory, places, parameters, integers, weights): the accelerations of row `i`, in its
    planes.

    With wind, the planes already have wind and gravity. `weights`: offset of those of the row.
    """
    compiled, block, particle_force = (
        compiler.compiled,
        block_of(real),
        make_particle_force(compiler, real, axes, parts),
    )
    has_gravity, has_wind, has_particle_forces = "gravity" in parts, "wind" in parts, bool(particle_forces(parts))
    zero = real(0)

    @compiled
    def add_forces(i, step, memory, places, parameters, integers, weights):
        columns, plane, spacing = places[P_COLUMNS], places[P_PLANE], places[P_CLASS]
        here = places[P_ACCELERATION] + i * places[P_STRIDE]
        if not has_wind:
            for axis in range(axes):
                base = parameters.gravity if has_gravity and axis == 1 else zero
                for k in range(classes):
                    for j in range(places[P_BLOCKS] * block):
                        memory[here + axis * plane + k * spacing + j] = base
        if has_particle_forces:
            for j in range(columns):
                lane = j % classes * spacing + j // classes
                place, k, weight = here + lane, i * columns + j, memory[weights + lane]
                if axes == 2:
                    a = particle_force((memory[place], memory[place + plane]), k, weight, parameters, integers, step)
                else:
                    here_now = memory[place], memory[place + plane], memory[place + 2 * plane]
                    a = particle_force(here_now, k, weight, parameters, integers, step)
                for axis in range(axes):
                    memory[place + axis * plane] = a[axis]

    return add_forces


def make_wind(compiler: Compiler, real: Real, parts: frozenset[str], classes: int) -> SimpleNamespace:
    """Make functions for a band's rows, from `first` to before `last`.

    `copy_band(first, last, position, velocity, memory, places, natural)`: the rows, not combed, of planes that begin at
    `position` and `velocity`; `natural`: the integers of that sheet's layout. `wind_band(first, last, band, substep,
    memory, places, natural, parameters, integers, row_places)`: gravity and wind into the planes of accelerations;
    `substep`: counted from time 0.
    """
    compiled, block = compiler.compiled, block_of(real)
    combs, scratches, at = (
        make_comb(compiler, real, classes),
        make_scratch(compiler, real),
        triples_of(parts & WIND_PARTS),
    )
    smooth, comb, clear, place = combs.smooth, combs.comb, scratches.clear, scratches.place
    winds = make_winds(
        compiler, real, parts & WIND_PARTS, scratches.place, scratches.edge, scratches.forget, scratches.clear, at
    )
    air_now, wind_cells, add_wind = winds.air_now, winds.wind_cells, winds.add_wind
    added = compiler.formulas(distance, real).added
    has_load, has_gravity = "load" in parts, "gravity" in parts
    a_close, triples, zero = at["close"], at["count"], real(0)

    @compiled
    def copy_band(first, last, position, velocity, memory, places, natural):
        plane = places[P_PLANE]
        for i in range(first, last):
            for axis in range(2 * AXES):
                start = position if axis < AXES else velocity - AXES * plane
                smooth(
                    places[P_CLASS], places[P_BLOCKS], row_at(memory, start + axis * plane + i * places[P_STRIDE]),
                    row_at(memory, places[P_NATURAL] + axis * natural[L_PLANE] + i * natural[L_STRIDE]),
                )  # fmt: skip

    @compiler.row
    def weigh_row(count, force, weights, base, out):
        for j in range(count):
            out[j] = added(base, weights[j], force[j]) if has_load else base + force[j]

    @compiled
    def wind_band(first, last, band, substep, memory, places, natural, parameters, integers, row_places):
        plane, width = places[P_PLANE], places[P_SCRATCH_WIDTH]
        blocks = (places[P_COLUMNS] + block - 1) // block
        scratch = row_at(memory, places[P_WIND_SCRATCH] + band * places[P_SCRATCH_SIZE])
        source = row_at(memory, places[P_NATURAL])
        air = air_now(parameters, integers, substep, zero)
        for triple in range(triples):
            clear(scratch, np.int64(triple), width)
        if first > 0:
            wind_cells(first - 1, blocks, natural, source, parameters, air, scratch, width)
        spare = row_at(scratch, triples * AXES * width)
        for i in range(first, last):
            clear(scratch, np.int64(a_close), width)
            wind_cells(i, blocks, natural, source, parameters, air, scratch, width)
            add_wind(i, blocks, scratch, width)
            here = places[P_ACCELERATION] + i * places[P_STRIDE]
            for axis in range(AXES):
                out = row_at(memory, here + axis * plane)
                base = parameters.gravity if has_gravity and axis == 1 else zero
                comb(places[P_CLASS], places[P_BLOCKS], row_at(scratch, place(a_close, axis, width)), spare)
                weigh_row(
                    classes * places[P_CLASS], spare, row_at(memory, row_places[0, i]), base, out
                )  # fmt: skip

    return SimpleNamespace(copy_band=copy_band, wind_band=wind_band)
