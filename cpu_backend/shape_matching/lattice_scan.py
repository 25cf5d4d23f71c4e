"""Sums over windows of lattices along y and z, on CPU threads: the scan of formulas/shape_matching/lattice.py, for
moments and for displacements to goals.

Along an axis, the arguments of a scan are the rows of positions, of summands and of sums, each Rows, and numbers per row
from the axis's table.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.shape_matching.lattice_rows import (
    add_goals,
    add_moments,
    clear,
    copy,
    end_goals,
    end_moments,
)
from softlab.model.base.variant import Open, filled, inlined_routine, open_constant, real, routine
from softlab.model.formulas.shape_matching.lattice import lever


class Rows(NamedTuple):
    """Rows in planes of a flat array: distances between rows and between planes."""

    array: np.ndarray
    apart: int
    plane: int


class MomentScan(NamedTuple):
    """Weights, centres and masses along the axis; masses of a row; arguments of `then` in moment_scan."""

    weights: np.ndarray
    centres: np.ndarray
    masses: np.ndarray
    mass: np.ndarray
    more: tuple[Any, ...] = ()


class GoalScan(NamedTuple):
    """Centres and numbers of clusters along the axis; distance of masses [m]; number of clusters of a row; the windows'
    sums that are written."""

    centres: np.ndarray
    counts: np.ndarray
    spacing: float
    clusters: float
    out: Rows


PLANES = open_constant("PLANES: rows of a sum")
KEEPS_ALL = open_constant("KEEPS_ALL: the scan's halves of all windows are stored")
term = Open("term(j, b, values) -> arguments of `add` of row j")
add = Open("add(n, *term(j, b, values), row, pitch, x, reference, plane, sums): adds row j to sums")
end = Open("end(n, i, b, reference, x, plane, sums, half, pitch, values): completes the window of row i")
then = Open("then(n, i, window, values.more): what follows for the window of row i")


@routine
def scan(n, length, region, positions, source, halves, sums, values):
    """Sum `length` rows of `n` masses over windows, in groups of windows that contain a reference row b.

    `values`: MomentScan or GoalScan; `halves` has a place for each row if a scan KEEPS_ALL, else for each row of a group.
    """
    x, apart, plane = positions
    terms, terms_apart, pitch = source
    stored, stored_apart, stored_pitch = halves
    width = 2 * region + 1
    for low in range(0, length, width):
        high, b = min(low + width, length), min(low + region, length - 1)
        reference, begin = row_at(x, b * apart), 0 if KEEPS_ALL else low
        clear(n, PLANES, n, sums)
        j = b
        for back in range(high - low):
            i = high - 1 - back
            while j > max(0, i - region):
                j -= 1
                row, here = row_at(terms, j * terms_apart), row_at(x, j * apart)
                add(n, *term(j, b, values), row, pitch, here, reference, plane, sums)
            copy(n, PLANES, sums, n, row_at(stored, (i - begin) * stored_apart), stored_pitch)
        clear(n, PLANES, n, sums)
        j = b
        for i in range(low, high):
            while j <= min(length - 1, i + region):
                row, here = row_at(terms, j * terms_apart), row_at(x, j * apart)
                add(n, *term(j, b, values), row, pitch, here, reference, plane, sums)
                j += 1
            half = row_at(stored, (i - begin) * stored_apart)
            end(n, i, b, reference, row_at(x, i * apart), plane, sums, half, stored_pitch, values)


@inlined_routine
def moment_term(j, b, values):
    return real(j - b), values.weights[j], values.mass


@routine
def end_moment_window(n, i, b, reference, x, plane, sums, window, pitch, values):
    to_centre = lever(real(b - i), values.centres[i])
    end_moments(n, to_centre, values.masses[i], values.mass, reference, x, plane, sums, window, pitch)
    then(n, i, window, values.more)


@inlined_routine
def goal_term(j, b, values):
    return lever(real(b - j), values.centres[j]) * values.spacing, values.clusters


@routine
def end_goal_window(n, i, b, reference, x, plane, sums, half, pitch, values):
    out = values.out
    end_goals(
        n, real(i - b) * values.spacing, values.counts[i] * values.clusters, reference, x, plane, sums, half, pitch,
        (row_at(out.array, i * out.apart), out.plane),
    )  # fmt: skip


def moment_scan(turns: int, then: Any) -> Any:
    """Return the scan of moments after `turns` axes, which calls `then` for each window."""
    rows = {"ROWS_BEFORE": 3 * (turns + 1), "PLANES": 3 * (turns + 2)}
    parts = {
        "term": moment_term,
        "add": filled(add_moments, rows),
        "end": filled(end_moment_window, rows | {"then": then}),
    }
    return filled(scan, {"KEEPS_ALL": True, **rows, **parts})


def goal_scan(rest: int) -> Any:
    """Return the scan of displacements to goals before `rest` more axes."""
    rows = {"ROWS_BEFORE": 3 * (rest + 1), "PLANES": 3 * (rest + 2)}
    parts = {"term": goal_term, "add": filled(add_goals, rows), "end": filled(end_goal_window, rows)}
    return filled(scan, {"KEEPS_ALL": False, **rows, **parts})
