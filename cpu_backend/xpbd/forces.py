"""Accelerations of a substep that differ between masses, in separate planes: wind, and forces on single masses.

Wind is the mass-spring cloth's (core/wind.py), whose walk needs rows that are not combed: the sheet is
copied for it.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import BLOCK, L_PLANE, L_STRIDE, row_at
from softlab.cpu_backend.core.own_forces import particle_force
from softlab.cpu_backend.core.scratch import AXES, clear_triple, row_start, triples_of
from softlab.cpu_backend.core.wind import add_wind, air_now, wind_cells, wind_features
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
from softlab.model.base.types import Feature
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas.distance import added

WIND_PARTS = frozenset({"wind", "gust"})


def has_forces(parts: frozenset[str]) -> bool:
    """Return True if accelerations differ between masses, which then need planes."""
    return "wind" in parts or bool(particle_forces(parts))


@row_routine
def smooth(spacing, blocks, row, out):
    """Write a combed row with its columns in order."""
    classes = FEATURE.classes
    for j in range(blocks * BLOCK):
        for c in range(classes):
            out[j * classes + c] = row[c * spacing + j]


@row_routine
def comb(spacing, blocks, row, out):
    """Write a row with its columns in order as a combed one."""
    classes = FEATURE.classes
    for j in range(blocks * BLOCK):
        for c in range(classes):
            out[c * spacing + j] = row[j * classes + c]


@routine
def add_forces(i, step, memory, places, parameters, integers, weights):
    """Write the accelerations of row `i` into its planes, which with wind already have wind and gravity; `weights`:
    offset of those of the row."""
    columns, plane, spacing, classes = places[P_COLUMNS], places[P_PLANE], places[P_CLASS], FEATURE.classes
    here = places[P_ACCELERATION] + i * places[P_STRIDE]
    if not FEATURE.wind:
        for axis in range(FEATURE.axes):
            base = parameters.gravity if FEATURE.gravity and axis == 1 else 0.0
            for k in range(classes):
                for j in range(places[P_BLOCKS] * BLOCK):
                    memory[here + axis * plane + k * spacing + j] = base
    if FEATURE.particle_forces:
        for j in range(columns):
            lane = j % classes * spacing + j // classes
            place_now, k, weight = here + lane, i * columns + j, memory[weights + lane]
            if FEATURE.axes == 2:
                a_now = memory[place_now], memory[place_now + plane]
            else:
                a_now = memory[place_now], memory[place_now + plane], memory[place_now + 2 * plane]
            a = particle_force(a_now, k, weight, parameters, integers, step)
            for axis in range(FEATURE.axes):
                memory[place_now + axis * plane] = a[axis]


@routine
def copy_band(band, bounds, position, natural, sheet):
    """Copy the rows of a band, not combed, of planes that begin at `position`; `natural`: the integers of that copy's
    layout."""
    memory, places = sheet.memory, sheet.places
    plane = places[P_PLANE]
    velocity = position + FEATURE.axes * plane if FEATURE.separate_before else FEATURE.axes * plane
    for i in range(bounds[band], bounds[band + 1]):
        for axis in range(2 * AXES):
            start = position if axis < AXES else velocity - AXES * plane
            smooth(
                places[P_CLASS], places[P_BLOCKS], row_at(memory, start + axis * plane + i * places[P_STRIDE]),
                row_at(memory, places[P_NATURAL] + axis * natural[L_PLANE] + i * natural[L_STRIDE]),
            )  # fmt: skip


@row_routine
def weigh_row(count, force, weights, base, out):
    for j in range(count):
        out[j] = added(base, weights[j], force[j]) if FEATURE.load else base + force[j]


@routine
def wind_band(band, bounds, natural, substep, sheet):
    """Write gravity and wind on the rows of a band into the planes of accelerations; `substep`: counted from time 0."""
    memory, places, parameters, first = sheet.memory, sheet.places, sheet.parameters, bounds[band]
    plane, width = places[P_PLANE], places[P_SCRATCH_WIDTH]
    blocks = (places[P_COLUMNS] + BLOCK - 1) // BLOCK
    scratch = row_at(memory, places[P_WIND_SCRATCH] + band * places[P_SCRATCH_SIZE])
    source, close = row_at(memory, places[P_NATURAL]), np.int64(FEATURE.at_close)
    air = air_now(parameters, sheet.integers, substep, 0.0)
    for triple in range(FEATURE.triples):
        clear_triple(scratch, np.int64(triple), width)
    if first > 0:
        wind_cells(first - 1, blocks, natural, source, parameters, air, scratch, width)
    spare = row_at(scratch, FEATURE.triples * AXES * width)
    for i in range(first, bounds[band + 1]):
        clear_triple(scratch, close, width)
        wind_cells(i, blocks, natural, source, parameters, air, scratch, width)
        add_wind(i, blocks, scratch, width)
        here = places[P_ACCELERATION] + i * places[P_STRIDE]
        for axis in range(AXES):
            out = row_at(memory, here + axis * plane)
            base = parameters.gravity if FEATURE.gravity and axis == 1 else 0.0
            comb(places[P_CLASS], places[P_BLOCKS], row_at(scratch, row_start(close, axis, width)), spare)
            weigh_row(FEATURE.classes * places[P_CLASS], spare, row_at(memory, sheet.row_places[0, i]), base, out)


def force_features(parts: frozenset[str], axes: int, classes: int) -> dict[str, Feature]:
    """Return the features of the routines of this module."""
    at = triples_of(parts & WIND_PARTS)
    return wind_features(parts, at) | {
        "axes": axes, "classes": classes, "particle_forces": bool(particle_forces(parts)), "triples": at["count"]
    }  # fmt: skip
