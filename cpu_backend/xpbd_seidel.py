"""The kernel `fused` in the coloured Gauss-Seidel ordering: every thread follows the steps of its band's schedule.

xpbd_schedule.py says in which order rows are predicted, projected and given their velocity, and what neighbouring bands wait
for; this file does it. All bands run in one parallel region and tell each other how far they are by flags (progress.py);
where the threading layer cannot promise that they run at the same time, there is a region for each phase instead.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.cloth_scratch import cloth_variant
from cpu_backend.compile import Compiler
from cpu_backend.progress import all_arrived, store_release, wait_for
from cpu_backend.xpbd_forces import make_wind
from cpu_backend.xpbd_layout import P_PLANE, classes_of
from cpu_backend.xpbd_rows import make_link, make_rows_of_kinds
from cpu_backend.xpbd_schedule import (
    ALONG,
    AWAIT_LOWER,
    AWAIT_UPPER,
    BEGIN,
    DOWN,
    END,
    FAR_ALONG,
    FAR_DOWN,
    NEWS,
    PHASES,
    TELL,
)
from cpu_backend.xpbd_walk import make_walk
from model.xpbd_plan import FAMILIES


def make_links(
    compiler: Compiler, real: Any, axes: int, parts: frozenset[str], classes: int, several: bool
) -> list[Any]:
    """Of each of FAMILIES f(i, later, sheet): its constraints that lead down from row i, or those along it."""
    rows = make_rows_of_kinds(compiler, real, axes, parts, several)

    @compiler.compiled
    def nothing(i, later, sheet):
        """A family that the scene lacks."""

    return [
        make_link(compiler, real, axes, parts, family, rows[family.kind], classes) if family.kind in parts else nothing
        for family in FAMILIES
    ]


def make_follow(compiler: Compiler, real: Any, axes: int, parts: frozenset[str], several: bool, together: bool) -> Any:
    """follow(begin, end, band, news, is_first, is_last, step, substep, steps, sheet, progress, spins): the steps from `begin`
    to before `end` of a schedule, in an iteration that is a substep's first or last; `news`: what flags had grown to before.
    """
    classes = classes_of(parts)
    walk = make_walk(compiler, real, axes, parts, classes)
    begin_row, end_iteration, end_row = walk.begin_row, walk.end_iteration, walk.end_row
    vertical, falling, rising, horizontal, far_vertical, far_horizontal = make_links(
        compiler, real, axes, parts, classes, several
    )
    start = np.int64(0)

    @compiler.compiled
    def follow(begin, end, band, news, is_first, is_last, step, substep, steps, sheet, progress, spins):
        later = not is_first
        for k in range(begin, end):
            what, i = steps[k, 0], steps[k, 1]
            if what == DOWN:
                vertical(i, later, sheet)
                falling(i, later, sheet)
                rising(i, later, sheet)
            elif what == ALONG:
                horizontal(i, later, sheet)
            elif what == FAR_DOWN:
                far_vertical(i, later, sheet)
            elif what == FAR_ALONG:
                far_horizontal(i, later, sheet)
            elif what == BEGIN:
                if is_first:
                    begin_row(i, step, start, sheet)
            elif what == END:
                end_iteration(i, start, sheet)
                if is_last:
                    end_row(i, substep, start, sheet)
            elif together and what == TELL:
                store_release(progress, band, news + i)
            elif together and what == AWAIT_UPPER:
                wait_for(progress, band - 1, news + i, spins)
            elif together and what == AWAIT_LOWER:
                wait_for(progress, band + 1, news + i, spins)

    return follow


@cache
def make_seidel_advance(real: Any, math: str, axes: int, parts: frozenset[str], several: bool, together: bool) -> Any:
    """advance(count, step, substeps, iterations, steps, starts, bounds, natural, memory, places, record, integers, bodies,
    kinds, row_places, row_uneven, anchors, progress, gate, spins): `count` steps in place, the first of them number `step`.

    `several`: whether there is more than one iteration. `steps`, `starts`, `bounds`: the schedule; `natural`: of the sheet
    that wind sees; `progress`: two flags a band, `gate`: GATE_FLAGS, all 0; the rest: see xpbd_walk.py. `together`: one
    parallel region, in which bands wait for each other; if the gate then ends at GIVE_UP, nothing was done. Else a region for
    every phase.
    """
    words = parts | {word for word, there in (("several", several), ("together", together)) if there}
    compiler = Compiler(cloth_variant(f"xpbd_{axes}d", real, math, words), math)
    follow = make_follow(compiler, real, axes, parts, several, together)
    has_wind, compiled = "wind" in parts, compiler.compiled
    if has_wind:
        winds = make_wind(compiler, real, parts, classes_of(parts))
        copy_band, wind_band = winds.copy_band, winds.wind_band
    else:
        copy_band = wind_band = compiled(_nothing)

    @compiled
    def copy(band, bounds, natural, sheet):
        copy_band(bounds[band], bounds[band + 1], np.int64(0), axes * sheet[1][P_PLANE], sheet[0], sheet[1], natural)

    @compiled
    def blow(band, bounds, natural, substep, sheet):
        memory, places, record, integers, _, _, row_places, _, _ = sheet
        wind_band(bounds[band], bounds[band + 1], band, substep, memory, places, natural, record, integers, row_places)

    @compiled
    def run_band(
        band, bands, count, step, substeps, iterations, steps, starts, bounds, natural, sheet, progress, gate, spins
    ):  # fmt: skip
        if bands > 1 and not all_arrived(gate, bands, spins):
            return
        for number in range(count * substeps):
            if has_wind:  # once the neighbours have copied their rows, too
                copy(band, bounds, natural, sheet)
                store_release(progress, bands + band, number + 1)
                if band > 0:
                    wait_for(progress, bands + band - 1, number + 1, spins)
                if band < bands - 1:
                    wait_for(progress, bands + band + 1, number + 1, spins)
                blow(band, bounds, natural, step * substeps + number, sheet)
            for k in range(iterations):
                follow(
                    starts[band, 0], starts[band, PHASES], band, NEWS * (number * iterations + k), k == 0,
                    k == iterations - 1, step + number // substeps, step * substeps + number, steps, sheet, progress, spins,
                )  # fmt: skip

    def advance(
        count, step, substeps, iterations, steps, starts, bounds, natural, memory, places, record, integers, bodies, kinds,
        row_places, row_uneven, anchors, progress, gate, spins,
    ):  # fmt: skip
        sheet = (memory, places, record, integers, bodies, kinds, row_places, row_uneven, anchors)
        bands = starts.shape[0]
        for band in prange(bands):
            run_band(
                np.int64(band), bands, count, step, substeps, iterations, steps, starts, bounds, natural, sheet, progress,
                gate, spins,
            )  # fmt: skip

    def advance_in_turn(
        count, step, substeps, iterations, steps, starts, bounds, natural, memory, places, record, integers, bodies, kinds,
        row_places, row_uneven, anchors, progress, gate, spins,
    ):  # fmt: skip
        sheet = (memory, places, record, integers, bodies, kinds, row_places, row_uneven, anchors)
        bands = starts.shape[0]
        for number in range(count * substeps):
            if has_wind:
                for band in prange(bands):
                    copy(np.int64(band), bounds, natural, sheet)
                for band in prange(bands):
                    blow(np.int64(band), bounds, natural, step * substeps + number, sheet)
            for turn in range(iterations * PHASES):
                k, phase = turn // PHASES, turn % PHASES
                for band in prange(bands):
                    follow(
                        starts[band, phase], starts[band, phase + 1], np.int64(band), 0, k == 0, k == iterations - 1,
                        step + number // substeps, step * substeps + number, steps, sheet, progress, spins,
                    )  # fmt: skip

    return compiler.kernel(advance if together else advance_in_turn)


def _nothing(*arguments):
    """Wind in a scene without. (Compiled by the kernel.)"""
