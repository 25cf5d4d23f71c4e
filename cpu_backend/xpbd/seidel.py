"""The kernel `fused` in the coloured Gauss-Seidel ordering: each thread follows the schedule of its band.

xpbd/schedule.py defines the order in which rows are predicted, projected and given their velocities, and how
neighbouring bands synchronise; this file executes it. The phases of an iteration need no waiting between bands: a team
runs them (core/progress.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.forces import make_wind
from softlab.cpu_backend.xpbd.layout import P_PLANE, classes_of
from softlab.cpu_backend.xpbd.rows import make_link, make_rows_of_kinds
from softlab.cpu_backend.xpbd.schedule import (
    ALONG,
    BEGIN,
    DOWN,
    END,
    FAR_ALONG,
    FAR_DOWN,
    PHASES,
)
from softlab.cpu_backend.xpbd.walk import make_walk
from softlab.model.base.types import Real
from softlab.model.position_based.plan import FAMILIES


def make_links(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], classes: int, several: bool
) -> list[Callable]:
    """Make, for each of FAMILIES, f(i, later, sheet): its constraints that lead down from row i, or those along it."""
    rows = make_rows_of_kinds(compiler, real, axes, parts, several)

    @compiler.compiled
    def nothing(i, later, sheet):
        """Do nothing, for a family that the scene lacks."""

    return [
        make_link(compiler, real, axes, parts, family, rows[family.kind], classes) if family.kind in parts else nothing
        for family in FAMILIES
    ]


def make_follow(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], several: bool) -> Callable:
    """Make follow(begin, end, is_first, is_last, step, substep, steps, sheet): the steps from `begin` to before `end`
    of a schedule, in an iteration that is a substep's first or last."""
    classes = classes_of(parts)
    walk = make_walk(compiler, real, axes, parts, classes)
    begin_row, end_iteration, end_row = walk.begin_row, walk.end_iteration, walk.end_row
    vertical, falling, rising, horizontal, far_vertical, far_horizontal = make_links(
        compiler, real, axes, parts, classes, several
    )
    start = np.int64(0)

    @compiler.compiled
    def follow(begin, end, is_first, is_last, step, substep, steps, sheet):
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

    return follow


@cache
def make_seidel_advance(real: Real, math: str, axes: int, parts: frozenset[str], several: bool) -> Callable:
    """Compile advance(bands, steps, order, starts, bounds, natural, sheet): steps in place, `steps`: a Steps.

    `several`: true for more than one iteration. `order`, `starts`, `bounds`: the schedule; `natural`: of the sheet for
    wind; `sheet`: see xpbd/walk.py.
    """
    words = parts | ({"several"} if several else set())
    compiler = Compiler(cloth_variant(f"xpbd_{axes}d", real, math, words), math)
    follow = make_follow(compiler, real, axes, parts, several)
    has_wind, compiled = "wind" in parts, compiler.compiled
    if has_wind:
        winds = make_wind(compiler, real, parts, classes_of(parts))
        copy_band, wind_band = winds.copy_band, winds.wind_band
    else:
        copy_band = wind_band = compiled(_nothing)

    @compiled
    def copy(band, bounds, natural, sheet):
        copy_band(
            bounds[band],
            bounds[band + 1],
            np.int64(0),
            axes * sheet.places[P_PLANE],
            sheet.memory,
            sheet.places,
            natural,
        )

    @compiled
    def blow(band, bounds, natural, substep, sheet):
        memory, places, parameters, integers = sheet.memory, sheet.places, sheet.parameters, sheet.integers
        row_places = sheet.row_places
        wind_band(
            bounds[band], bounds[band + 1], band, substep, memory, places, natural, parameters, integers, row_places
        )

    @compiled
    def any_steps(starts, phase):
        any_left = False
        for band in range(starts.shape[0]):
            any_left = any_left or starts[band, phase] < starts[band, phase + 1]
        return any_left

    def advance(team, member, bands, steps, order, starts, bounds, natural, sheet):
        count, step, substeps, iterations = steps
        for number in range(count * substeps):
            if has_wind:
                for band in assigned(team, member, bands):
                    copy(band, bounds, natural, sheet)
                for band in assigned(team, member, bands):
                    blow(band, bounds, natural, step * substeps + number, sheet)
            for turn in range(iterations * PHASES):
                k, phase = turn // PHASES, turn % PHASES
                if any_steps(starts, phase):
                    for band in assigned(team, member, bands):
                        follow(
                            starts[band, phase], starts[band, phase + 1], k == 0, k == iterations - 1,
                            step + number // substeps, step * substeps + number, order, sheet,
                        )  # fmt: skip

    return compiler.team(advance)


def _nothing(*arguments):
    """Do nothing, for a scene without wind; the kernel compiles it."""
