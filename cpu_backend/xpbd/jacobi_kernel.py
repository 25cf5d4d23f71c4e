"""The parallel part of the Jacobi orderings: bands of rows and their synchronisation; xpbd/jacobi.py has the rows'
part.

All bands predict their border rows first, which neighbours read, and the others just ahead of the iteration's walk.
Positions alternate between two buffers, one iteration each; an iteration begins when all bands have done the previous
one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.forces import copy_band, wind_band
from softlab.cpu_backend.xpbd.jacobi import displacement_triples, iterate_row, iteration_of, open_walk, stencil_rows
from softlab.cpu_backend.xpbd.layout import P_OTHER, P_PLANE, P_SCRATCH, P_SCRATCH_SIZE, P_STRIDE
from softlab.cpu_backend.xpbd.walk import begin_row, end_iteration, end_row, sheet_features, walk_of
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, routine


@routine
def open_band(band, bounds, step, source, sheet):
    """Predict a band's border rows."""
    first, last, stencil = bounds[band], bounds[band + 1], FEATURE.stencil_rows
    for i in range(first, min(first + stencil, last)):
        begin_row(i, step, source, sheet)
    for i in range(max(last - stencil, first + stencil), last):
        begin_row(i, step, source, sheet)


@routine
def iterate_band(band, bounds, k, iterations, step, substep, source, target, sheet):
    """Do an iteration. A substep's first one also predicts the other rows, its last one computes their velocities."""
    memory, places, stencil = sheet.memory, sheet.places, FEATURE.stencil_rows
    first, last = bounds[band], bounds[band + 1]
    scratch = row_at(memory, places[P_SCRATCH] + band * places[P_SCRATCH_SIZE])
    open_walk(first, source, k % 2, k > 0, scratch, sheet)
    for i in range(first, last):
        if k == 0 and i + stencil >= first + stencil and i + stencil < last - stencil:
            begin_row(i + stencil, step, source, sheet)
        iterate_row(i, source, target, k % 2, k > 0, scratch, sheet)
        end_iteration(i, target, sheet)
        if k == iterations - 1:
            end_row(i, substep, target, sheet)


@routine
def place_of(passes, places):
    """Return the offset of the positions after `passes` iterations."""
    return places[P_OTHER] if passes % 2 else np.int64(0)


@routine
def bring_back(band, bounds, sheet):
    """Copy positions, and with colliders velocities, from the other buffer to that of the state."""
    memory, places = sheet.memory, sheet.places
    for plane in range(2 * FEATURE.axes if FEATURE.separate_before else FEATURE.axes):
        start = plane * places[P_PLANE]
        for k in range(start + bounds[band] * places[P_STRIDE], start + bounds[band + 1] * places[P_STRIDE]):
            memory[k] = memory[places[P_OTHER] + k]


@routine
def advance(team, member, bands, steps, bounds, natural, sheet):
    """Do steps in place; as in xpbd/seidel.py, with bands of rows given by `bounds`."""
    count, step, substeps, iterations = steps
    places = sheet.places
    for number in range(count * substeps):
        now, substep, done = step + number // substeps, step * substeps + number, number * iterations
        if FEATURE.wind:
            for band in assigned(team, member, bands):
                copy_band(band, bounds, place_of(done, places), natural, sheet)
            for band in assigned(team, member, bands):
                wind_band(band, bounds, natural, substep, sheet)
        for band in assigned(team, member, bands):
            open_band(band, bounds, now, place_of(done, places), sheet)
        for k in range(iterations):
            source, target = place_of(done + k, places), place_of(done + k + 1, places)
            for band in assigned(team, member, bands):
                iterate_band(band, bounds, k, iterations, now, substep, source, target, sheet)
    if count * substeps * iterations % 2 == 1:
        for band in assigned(team, member, bands):
            bring_back(band, bounds, sheet)


@cache
def make_jacobi_advance(real: Real, math: str, axes: int, parts: frozenset[str], several: bool) -> Callable:
    """Compile `advance`; `several`: true for more than one iteration."""
    words = parts | ({"several"} if several else set())
    compiler = Compiler(cloth_variant(f"xpbd_{axes}d", real, math, words), math)
    of_sheet = sheet_features(parts, axes, 1)
    variant = compiler.variant_of(
        real, of_sheet | {"triples": displacement_triples(parts)["count"], "stencil_rows": stencil_rows(parts)}
    )
    names = walk_of(compiler, real, axes, parts, 1) | iteration_of(compiler, real, axes, parts, several)
    names["wind_band"] = compiler.variant_of(real, of_sheet)(wind_band)  # it has other scratch rows
    return compiler.team(variant.copied(with_forces(filled(advance, names), parts)))
