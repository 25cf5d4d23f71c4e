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
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.forces import make_wind
from softlab.cpu_backend.xpbd.jacobi import make_iterate, stencil_rows
from softlab.cpu_backend.xpbd.layout import P_OTHER, P_PLANE, P_SCRATCH, P_SCRATCH_SIZE, P_STRIDE
from softlab.cpu_backend.xpbd.walk import keeps_velocity, make_walk
from softlab.model.base.types import Real


def make_parts_of_substep(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], several: bool
) -> tuple[Callable, Callable]:
    """Make (open_band, iterate_band): the prediction of a band's border rows, and an iteration. A substep's first
    iteration also predicts the other rows, its last one computes their velocities."""
    walk, iterate = make_walk(compiler, real, axes, parts, 1), make_iterate(compiler, real, axes, parts, several)
    begin_row, end_iteration, end_row = walk.begin_row, walk.end_iteration, walk.end_row
    open_walk, iterate_row, stencil = iterate.open_walk, iterate.iterate_row, stencil_rows(parts)

    @compiler.compiled
    def open_band(band, bounds, step, source, sheet):
        first, last = bounds[band], bounds[band + 1]
        for i in range(first, min(first + stencil, last)):
            begin_row(i, step, source, sheet)
        for i in range(max(last - stencil, first + stencil), last):
            begin_row(i, step, source, sheet)

    @compiler.compiled
    def iterate_band(band, bounds, k, iterations, step, substep, source, target, sheet):
        memory, places = sheet.memory, sheet.places
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

    return open_band, iterate_band


@cache
def make_jacobi_advance(real: Real, math: str, axes: int, parts: frozenset[str], several: bool) -> Callable:
    """Compile advance(bands, steps, bounds, natural, sheet): as that of xpbd/seidel.py, with bands of rows given by
    `bounds`."""
    words = parts | ({"several"} if several else set())
    compiler = Compiler(cloth_variant(f"xpbd_{axes}d", real, math, words), math)
    compiled, has_wind, apart = compiler.compiled, "wind" in parts, keeps_velocity(parts)
    open_band, iterate_band = make_parts_of_substep(compiler, real, axes, parts, several)
    if has_wind:
        winds = make_wind(compiler, real, parts, 1)
        copy_band, wind_band = winds.copy_band, winds.wind_band
    else:
        copy_band = wind_band = compiled(_nothing)

    @compiled
    def copy(band, bounds, source, natural, sheet):
        velocity = source + axes * sheet.places[P_PLANE] if apart else axes * sheet.places[P_PLANE]
        copy_band(bounds[band], bounds[band + 1], source, velocity, sheet.memory, sheet.places, natural)

    @compiled
    def blow(band, bounds, natural, substep, sheet):
        memory, places, parameters, integers = sheet.memory, sheet.places, sheet.parameters, sheet.integers
        row_places = sheet.row_places
        wind_band(
            bounds[band], bounds[band + 1], band, substep, memory, places, natural, parameters, integers, row_places
        )

    @compiled
    def place_of(passes, places):
        """Return the offset of the positions after `passes` iterations."""
        return places[P_OTHER] if passes % 2 else np.int64(0)

    @compiled
    def bring_back(band, bounds, sheet):
        """Copy positions, and with colliders velocities, from the other buffer to that of the state."""
        memory, places = sheet.memory, sheet.places
        for plane in range(2 * axes if apart else axes):
            start = plane * places[P_PLANE]
            for k in range(start + bounds[band] * places[P_STRIDE], start + bounds[band + 1] * places[P_STRIDE]):
                memory[k] = memory[places[P_OTHER] + k]

    def advance(team, member, bands, steps, bounds, natural, sheet):
        count, step, substeps, iterations = steps
        places = sheet.places
        for number in range(count * substeps):
            now, substep, done = step + number // substeps, step * substeps + number, number * iterations
            if has_wind:
                for band in assigned(team, member, bands):
                    copy(band, bounds, place_of(done, places), natural, sheet)
                for band in assigned(team, member, bands):
                    blow(band, bounds, natural, substep, sheet)
            for band in assigned(team, member, bands):
                open_band(band, bounds, now, place_of(done, places), sheet)
            for k in range(iterations):
                source, target = place_of(done + k, places), place_of(done + k + 1, places)
                for band in assigned(team, member, bands):
                    iterate_band(band, bounds, k, iterations, now, substep, source, target, sheet)
        if count * substeps * iterations % 2 == 1:
            for band in assigned(team, member, bands):
                bring_back(band, bounds, sheet)

    return compiler.team(advance)


def _nothing(*arguments):
    """Do nothing, for a scene without wind; the kernel compiles it."""
