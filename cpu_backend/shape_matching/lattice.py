"""Lattices of bodies on CPU threads: three passes per iteration, over slices, pencils, slices
(shape_matching/lattice_rows.py).

A slice (x, y) sums along x and y. A pencil, a few rows along x over all z, sums along z, computes the clusters'
rotations and sums their goals along z. The slice then sums along y and x, and moves its masses. A pass waits for the
previous one. Slices and pencils are distributed over threads; the result does not depend on the distribution.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.lattice_layout import QUATERNION
from softlab.cpu_backend.shape_matching.lattice_rows import GOAL_LINE, LINE, SLICE, WINDOW, sum_goals, sum_line
from softlab.cpu_backend.shape_matching.lattice_scan import GoalScan, MomentScan, Rows, goal_scan, moment_scan
from softlab.cpu_backend.shape_matching.lattice_turns import centre_row, show_row, turn_row
from softlab.cpu_backend.shape_matching.motions import FRAME
from softlab.model.assets.lattice import (
    T_CENTRE,
    T_COUNT,
    T_INVERSE,
    T_MASS,
    T_WEIGHT,
    V_MATCHING,
    V_SPACING,
    V_TURN,
    VALUES,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import routine, row_routine
from softlab.model.formulas.shape_matching.lattice import moved


class Pencil(NamedTuple):
    """A pencil of windows: its first cluster, clusters between its rows and of all lattices; the lattice's turn at the
    start; rotations before and after; scratch; one over masses of the slice and along z."""

    first: int
    deep: int
    clusters: int
    start: np.ndarray
    rotation: np.ndarray
    turned: np.ndarray
    reached: np.ndarray
    inverse_slice: np.ndarray
    inverses: np.ndarray


@routine
def nothing(n, i, window, more):
    pass


@routine
def turn_window(n, i, window, pencil):
    """Compute the rotations and centres of a row of windows of a Pencil."""
    p, here = pencil, pencil.first + i * pencil.deep
    turn_row(n, p.start, window, row_at(p.rotation, here), row_at(p.turned, here), p.clusters, p.reached)
    for axis in range(3):
        centre_row(n, p.inverse_slice, p.inverses[i], row_at(window, axis * n))


scan_lines, scan_slices = moment_scan(1, nothing), moment_scan(2, turn_window)
scan_goals_along_z, scan_goals_along_y = goal_scan(2), goal_scan(1)


@routine
def slice_up(unit, position, count, arrays, band_scratch):
    """Write the sums of a slice into the work array."""
    numbers, units, tables, work = arrays.numbers, arrays.slices, arrays.tables, arrays.work
    which, first, z = units[unit, 0], units[unit, 1], units[unit, 2]
    nx, ny, region = numbers[which, 0], numbers[which, 1], numbers[which, 3]
    at_x, at_y = numbers[which, 4], numbers[which, 5]
    begin, x_table, y_table = first + z * ny * nx, row_at(tables, at_x), row_at(tables, at_y)
    for j in range(ny):
        x, line = row_at(position, begin + j * nx), row_at(band_scratch, LINE * nx * j)
        sum_line(
            nx, region, x, count, row_at(x_table, T_WEIGHT * nx), row_at(x_table, T_CENTRE * nx), line, nx
        )  # fmt: skip
    values = MomentScan(
        row_at(y_table, T_WEIGHT * ny), row_at(y_table, T_CENTRE * ny), row_at(y_table, T_MASS * ny),
        row_at(x_table, T_MASS * nx), (),
    )  # fmt: skip
    scan_lines(
        nx, ny, region, Rows(row_at(position, begin), nx, count), Rows(band_scratch, LINE * nx, nx),
        Rows(row_at(work, begin), nx, count), row_at(band_scratch, LINE * nx * ny), values,
    )  # fmt: skip


@routine
def turn_pencil(unit, position, count, arrays, new_rotation, frames, for_view, band_scratch):
    """Write the rotations of a pencil's clusters, and the sums of their goals into the work array or, with `for_view`, their
    frames."""
    numbers, units, tables, values = arrays.numbers, arrays.pencils, arrays.tables, arrays.values
    work, rotation = arrays.work, arrays.rotation
    which, first, cluster = units[unit, 0], units[unit, 1], units[unit, 2]
    nx, ny, nz, region = numbers[which, 0], numbers[which, 1], numbers[which, 2], numbers[which, 3]
    below = nx * units[unit, 3]  # masses of the slice before this pencil's
    n, deep, at_slice = nx * units[unit, 4] - below, nx * ny, numbers[which, 7] + below
    table, constants = row_at(tables, numbers[which, 6]), row_at(values, np.int64(VALUES * which))
    clusters, pitch, begin = rotation.size // QUATERNION, WINDOW * n, first + below
    x, out = Rows(row_at(position, begin), deep, count), Rows(row_at(work, begin), deep, count)
    sums = row_at(band_scratch, pitch * nz)
    groups, centres = row_at(sums, pitch), row_at(table, T_CENTRE * nz)
    pencil = Pencil(
        cluster + below, deep, clusters, row_at(constants, V_TURN), rotation, new_rotation, groups,
        row_at(tables, at_slice + deep), row_at(table, T_INVERSE * nz),
    )  # fmt: skip
    masses, mass = row_at(table, T_MASS * nz), row_at(tables, at_slice)
    windows = Rows(band_scratch, pitch, n)
    scan_slices(
        n, nz, region, x, out, windows, sums, MomentScan(row_at(table, T_WEIGHT * nz), centres, masses, mass, pencil)
    )
    if for_view:
        for i in range(nz):
            here = cluster + below + i * deep
            show_row(
                n, clusters, count, row_at(position, begin + i * deep), row_at(band_scratch, pitch * i),
                row_at(new_rotation, here), row_at(frames, np.int64(FRAME) * here),
            )  # fmt: skip
        return
    goals = GoalScan(centres, row_at(table, T_COUNT * nz), constants[V_SPACING], 1.0, out)
    scan_goals_along_z(n, nz, region, x, windows, Rows(groups, pitch, n), sums, goals)


@row_routine
def move_row(n, displacement, weights, weight_y, weight_z, matching, x):
    for k in range(n):
        x[k] = moved(x[k], displacement[k], weights[k], weight_y, weight_z, matching)


@routine
def move_slice(unit, position, count, arrays, band_scratch):
    """Move the masses of a slice."""
    numbers, units, tables = arrays.numbers, arrays.slices, arrays.tables
    values, work = arrays.values, arrays.work
    which, first, z = units[unit, 0], units[unit, 1], units[unit, 2]
    nx, ny, nz, region = numbers[which, 0], numbers[which, 1], numbers[which, 2], numbers[which, 3]
    x_table, y_table = row_at(tables, numbers[which, 4]), row_at(tables, numbers[which, 5])
    z_table, constants = row_at(tables, numbers[which, 6]), row_at(values, np.int64(VALUES * which))
    begin, count_z = first + z * ny * nx, z_table[T_COUNT * nz + z]
    sums, counts = row_at(band_scratch, GOAL_LINE * nx * ny), row_at(y_table, T_COUNT * ny)
    x, lines, spacing = row_at(position, begin), Rows(band_scratch, GOAL_LINE * nx, nx), constants[V_SPACING]
    scan_goals_along_y(
        nx, ny, region, Rows(x, nx, count), Rows(row_at(work, begin), nx, count),
        Rows(row_at(sums, SLICE * nx), SLICE * nx, nx), sums,
        GoalScan(row_at(y_table, T_CENTRE * ny), counts, spacing, count_z, lines),
    )  # fmt: skip
    for j in range(ny):
        here, line = row_at(x, j * nx), row_at(band_scratch, GOAL_LINE * nx * j)
        centres = row_at(x_table, T_CENTRE * nx)
        sum_goals(nx, region, spacing, counts[j] * count_z, here, count, centres, line, nx, sums)
        for axis in range(3):
            move_row(
                nx, row_at(sums, axis * nx), row_at(x_table, T_WEIGHT * nx), y_table[T_WEIGHT * ny + j],
                z_table[T_WEIGHT * nz + z], constants[V_MATCHING], row_at(here, axis * count),
            )  # fmt: skip


@routine
def match_all(team, member, bands, position, count, arrays, new_rotation, frames, for_view):
    """Compute the rotations of all clusters into `new_rotation`; with `for_view` their frames, too."""
    slices, pencils = arrays.slices.shape[0], arrays.pencils.shape[0]
    scratch, band_scratch = arrays.scratch, arrays.band_scratch
    for band in assigned(team, member, bands):
        for unit in range(slices * band // bands, slices * (band + 1) // bands):
            slice_up(unit, position, count, arrays, row_at(scratch, np.int64(band_scratch * band)))
    for band in assigned(team, member, bands):
        for unit in range(pencils * band // bands, pencils * (band + 1) // bands):
            turn_pencil(
                unit, position, count, arrays, new_rotation, frames, for_view,
                row_at(scratch, np.int64(band_scratch * band)),
            )  # fmt: skip


@routine
def move_all(team, member, bands, position, count, arrays):
    """Move the masses of all lattices towards the goals of their clusters."""
    slices, scratch, band_scratch = arrays.slices.shape[0], arrays.scratch, arrays.band_scratch
    for band in assigned(team, member, bands):
        for unit in range(slices * band // bands, slices * (band + 1) // bands):
            move_slice(unit, position, count, arrays, row_at(scratch, np.int64(band_scratch * band)))


@cache
def make_lattice_stages(real: Real, math: str) -> SimpleNamespace:
    """Compile `match(bands, position, count, arrays, new_rotation, frames, for_view)` and `move(bands, position, count,
    arrays)`, for all lattices of Lattices.arrays."""
    compiler = Compiler(f"lattice_stages_{np.dtype(real).name}_{math}", math)
    copied = compiler.variant_of(real).copied
    return SimpleNamespace(match=compiler.team(copied(match_all)), move=compiler.team(copied(move_all)))
