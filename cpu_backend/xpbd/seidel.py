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
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.forces import copy_band, wind_band
from softlab.cpu_backend.xpbd.layout import classes_of
from softlab.cpu_backend.xpbd.rows import make_link
from softlab.cpu_backend.xpbd.schedule import (
    ALONG,
    BEGIN,
    DOWN,
    END,
    FAR_ALONG,
    FAR_DOWN,
    PHASES,
)
from softlab.cpu_backend.xpbd.walk import begin_row, end_iteration, end_row, sheet_features, walk_of
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine
from softlab.model.position_based.plan import FAMILIES

vertical = Open("vertical(i, later, sheet): `link` of this family; so are the others")
falling, rising, horizontal = Open("falling(...)"), Open("rising(...)"), Open("horizontal(...)")
far_vertical, far_horizontal = Open("far_vertical(...)"), Open("far_horizontal(...)")
LINKS = ("vertical", "falling", "rising", "horizontal", "far_vertical", "far_horizontal")  # names of FAMILIES here


@routine
def follow(begin, end, is_first, is_last, step, substep, steps, sheet):
    """Do the steps from `begin` to before `end` of a schedule, in an iteration that is a substep's first or last."""
    later, start = not is_first, np.int64(0)
    for k in range(begin, end):
        what, i = steps[k, 0], steps[k, 1]
        if what == DOWN:
            if FEATURE.structural:
                vertical(i, later, sheet)
            if FEATURE.shear:
                falling(i, later, sheet)
                rising(i, later, sheet)
        elif what == ALONG:
            if FEATURE.structural:
                horizontal(i, later, sheet)
        elif what == FAR_DOWN:
            if FEATURE.bending:
                far_vertical(i, later, sheet)
        elif what == FAR_ALONG:
            if FEATURE.bending:
                far_horizontal(i, later, sheet)
        elif what == BEGIN:
            if is_first:
                begin_row(i, step, start, sheet)
        elif what == END:
            end_iteration(i, start, sheet)
            if is_last:
                end_row(i, substep, start, sheet)


@routine
def any_steps(starts, phase):
    any_left = False
    for band in range(starts.shape[0]):
        any_left = any_left or starts[band, phase] < starts[band, phase + 1]
    return any_left


@routine
def advance(team, member, bands, steps, order, starts, bounds, natural, sheet):
    """Do steps in place; `steps`: a Steps. `order`, `starts`, `bounds`: the schedule; `natural`: of the sheet for wind;
    `sheet`: see xpbd/walk.py."""
    count, step, substeps, iterations = steps
    for number in range(count * substeps):
        if FEATURE.wind:
            for band in assigned(team, member, bands):
                copy_band(band, bounds, np.int64(0), natural, sheet)
            for band in assigned(team, member, bands):
                wind_band(band, bounds, natural, step * substeps + number, sheet)
        for turn in range(iterations * PHASES):
            k, phase = turn // PHASES, turn % PHASES
            if any_steps(starts, phase):
                for band in assigned(team, member, bands):
                    follow(
                        starts[band, phase], starts[band, phase + 1], k == 0, k == iterations - 1,
                        step + number // substeps, step * substeps + number, order, sheet,
                    )  # fmt: skip


@cache
def make_seidel_advance(real: Real, math: str, axes: int, parts: frozenset[str], several: bool) -> Callable:
    """Compile `advance`; `several`: true for more than one iteration."""
    words = parts | ({"several"} if several else set())
    compiler, classes = Compiler(cloth_variant(f"xpbd_{axes}d", real, math, words), math), classes_of(parts)
    names = walk_of(compiler, real, axes, parts, classes)
    for name, family in zip(LINKS, FAMILIES, strict=True):
        if family.kind in parts:
            names[name] = make_link(compiler, real, axes, parts, family, classes, several)
    kernel = with_forces(filled(advance, names), parts)
    return compiler.team(compiler.variant_of(real, sheet_features(parts, axes, classes)).copied(kernel))
