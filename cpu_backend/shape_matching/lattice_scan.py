"""Sums over windows of lattices along y and z, on CPU threads: the scan of formulas/shape_matching/lattice.py, for
moments and for displacements to goals.

Along an axis, the arguments of a scan are the rows of positions, of summands and of sums, each Rows, and numbers per row
from the axis's table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.shape_matching.lattice_rows import make_goals, make_moments, make_rows
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import lattice


class Rows(NamedTuple):
    """Rows in planes of a flat array: distances between rows and between planes."""

    array: np.ndarray
    apart: int
    plane: int


class MomentScan(NamedTuple):
    """Weights, centres and masses along the axis; masses of a row; arguments of `then` in make_moment_scan."""

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


def make_scan(
    compiler: Compiler, real: Real, planes: int, keeps_all: bool, term: Callable, add: Callable, end: Callable
) -> Callable:
    """Make scan(n, length, region, positions, source, halves, sums, values): `length` rows of `n` masses, in groups of
    windows that contain a reference row b. `values`: MomentScan or GoalScan.

    `add(n, *term(j, b, values), row, pitch, x, reference, plane, sums)` adds row j to `planes` of sums. `end(n, i, b,
    reference, x, plane, sums, half, pitch, values)` completes the window of row i, from the sums behind b and the half
    before it. `halves` has a place for each row if a scan `keeps_all`, else for each row of a group.
    """
    rows = make_rows(compiler, real)
    clear, copy = rows.clear, rows.copy

    @compiler.compiled
    def scan(n, length, region, positions, source, halves, sums, values):
        x, apart, plane = positions
        terms, terms_apart, pitch = source
        stored, stored_apart, stored_pitch = halves
        width = 2 * region + 1
        for low in range(0, length, width):
            high, b = min(low + width, length), min(low + region, length - 1)
            reference, begin = row_at(x, b * apart), 0 if keeps_all else low
            clear(n, planes, n, sums)
            j = b
            for back in range(high - low):
                i = high - 1 - back
                while j > max(0, i - region):
                    j -= 1
                    row, here = row_at(terms, j * terms_apart), row_at(x, j * apart)
                    add(n, *term(j, b, values), row, pitch, here, reference, plane, sums)
                copy(n, planes, sums, n, row_at(stored, (i - begin) * stored_apart), stored_pitch)
            clear(n, planes, n, sums)
            j = b
            for i in range(low, high):
                while j <= min(length - 1, i + region):
                    row, here = row_at(terms, j * terms_apart), row_at(x, j * apart)
                    add(n, *term(j, b, values), row, pitch, here, reference, plane, sums)
                    j += 1
                half = row_at(stored, (i - begin) * stored_apart)
                end(n, i, b, reference, row_at(x, i * apart), plane, sums, half, stored_pitch, values)

    return scan


def make_moment_scan(compiler: Compiler, real: Real, turns: int, then: Callable) -> Callable:
    """Make the scan of moments, after `turns` axes. For each window it calls then(n, i, window, values.more)."""
    lever, moments = compiler.formulas(lattice, real, inline=True).lever, make_moments(compiler, real, turns)
    end_row = moments.end

    @compiler.inlined
    def term(j, b, values):
        return real(j - b), values.weights[j], values.mass

    @compiler.compiled
    def end(n, i, b, reference, x, plane, sums, window, pitch, values):
        to_centre = lever(real(b - i), values.centres[i])
        end_row(n, to_centre, values.masses[i], values.mass, reference, x, plane, sums, window, pitch)
        then(n, i, window, values.more)

    return make_scan(compiler, real, 3 * (turns + 2), True, term, moments.add, end)


def make_goal_scan(compiler: Compiler, real: Real, rest: int) -> Callable:
    """Make the scan of displacements to goals, before `rest` more axes."""
    lever, goals = compiler.formulas(lattice, real, inline=True).lever, make_goals(compiler, real, rest)
    end_goals = goals.end_goals

    @compiler.inlined
    def term(j, b, values):
        return lever(real(b - j), values.centres[j]) * values.spacing, values.clusters

    @compiler.compiled
    def end(n, i, b, reference, x, plane, sums, half, pitch, values):
        out = values.out
        end_goals(
            n, real(i - b) * values.spacing, values.counts[i] * values.clusters, reference, x, plane, sums, half, pitch,
            (row_at(out.array, i * out.apart), out.plane),
        )  # fmt: skip

    return make_scan(compiler, real, 3 * (rest + 2), False, term, goals.add_goals, end)
