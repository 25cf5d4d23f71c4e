"""Passes over lattices on CPU threads, row by row along x; formulas/shape_matching/lattice.py defines the sums and
their order.

Rows are arrays of unchecked length (`row_at`), which do not overlap. Arrays that belong together (the sums of a window,
and so on) are consecutive rows, `pitch` apart: of a slice in a thread's scratch, or planes of the whole. Vectors are
three rows; `n`: masses of a row.

Along y and z, moments have differences, turns along the axes that are done, and those along the scan's own axis;
displacements to goals have displacements, the columns of the rotations along the axes that are still to come, and those
along the scan's own axis. ROWS_BEFORE: rows before those of the scan's own axis.
"""

from __future__ import annotations

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.shape_matching.matching_rows import clear as clear_row
from softlab.cpu_backend.shape_matching.matching_rows import copy as copy_row
from softlab.model.base.variant import open_constant, real, routine, row_routine
from softlab.model.formulas.shape_matching.lattice import added_goal, added_turn, ended, part_of, part_of_row, shifted
from softlab.model.formulas.shape_matching.lattice import lever as lever_of

LINE, SLICE, WINDOW = 6, 9, 12  # sums over a row, a slice and a whole window: differences and turns, three each
GOAL_LINE = 6  # of displacements to goals, after the passes along z and y; after z, as many as of a slice

ROWS_BEFORE = open_constant("ROWS_BEFORE: rows of a sum before those of the scan's own axis")


@row_routine
def add_to(n, source, out):
    """Add a row to another."""
    for k in range(n):
        out[k] = out[k] + source[k]


@routine
def clear(n, rows, pitch, out):
    """Set rows to 0, `pitch` apart."""
    for k in range(rows):
        clear_row(n, row_at(out, k * pitch))


@routine
def copy(n, rows, source, source_pitch, out, pitch):
    """Copy rows."""
    for k in range(rows):
        copy_row(n, row_at(source, k * source_pitch), row_at(out, k * pitch))


@row_routine
def add_members(n, step, x, middle, weights, centre, total, turn):
    for k in range(n):
        part = part_of(weights[k], x[k], middle[k])
        total[k] = total[k] + part
        turn[k] = added_turn(turn[k], part, lever_of(step, centre[k]))


@routine
def sum_line(n, region, x, plane, weights, centre, line, pitch):
    """Write, for a row of masses, the sums over windows along x."""
    clear(n, LINE, pitch, line)
    for place in range(-region, region + 1):
        first = max(0, -place)
        if place != 0 and abs(place) < n:
            for axis in range(3):
                at = row_at(x, axis * plane)
                add_members(
                    n - abs(place), real(place), row_at(at, first + place), row_at(at, first),
                    row_at(weights, first + place), row_at(centre, first), row_at(line, axis * pitch + first),
                    row_at(line, (3 + axis) * pitch + first),
                )  # fmt: skip


@row_routine
def add_goal_members(n, step, rest, count, total, column, x, middle, centre, displacement):
    for k in range(n):
        along = lever_of(step, centre[k]) * rest
        displacement[k] = added_goal(displacement[k], total[k], count, x[k], middle[k], along, column[k])


@routine
def sum_goals(n, region, rest, count, x, plane, centre, line, pitch, displacements):
    """Write the sums over windows along a row of displacements to goals."""
    clear(n, 3, pitch, displacements)
    for place in range(-region, region + 1):
        first = max(0, -place)
        if abs(place) < n:
            for axis in range(3):
                at = row_at(x, axis * plane)
                add_goal_members(
                    n - abs(place), real(-place), rest, count, row_at(line, axis * pitch + first + place),
                    row_at(line, (3 + axis) * pitch + first + place), row_at(at, first + place), row_at(at, first),
                    row_at(centre, first + place), row_at(displacements, axis * pitch + first),
                )  # fmt: skip


@row_routine
def add_row(n, step, weight, mass, total, x, reference, sums, turn):
    for k in range(n):
        part = part_of_row(weight, total[k], mass[k], x[k], reference[k])
        sums[k] = sums[k] + part
        turn[k] = added_turn(turn[k], part, step)


@row_routine
def add_turn(n, weight, turn, sums):
    for k in range(n):
        sums[k] = added_turn(sums[k], turn[k], weight)


@routine
def add_moments(n, step, weight, mass, rows, pitch, x, reference, plane, sums):
    """Add a row's sums to a scan."""
    for axis in range(3):
        add_row(
            n, step, weight, mass, row_at(rows, axis * pitch), row_at(x, axis * plane), row_at(reference, axis * plane),
            row_at(sums, axis * n), row_at(sums, (ROWS_BEFORE + axis) * n),
        )  # fmt: skip
    for other in range(3, ROWS_BEFORE):
        add_turn(n, weight, row_at(rows, other * pitch), row_at(sums, other * n))


@row_routine
def end_row(n, far, weight, mass, reference, x, added, behind, sums, turn):
    for k in range(n):
        total = sums[k] + added[k]
        turn[k] = added_turn(turn[k] + behind[k], total, far)
        sums[k] = shifted(total, mass[k] * weight, reference[k], x[k])


@routine
def end_moments(n, far, weight, mass, reference, x, plane, added, sums, pitch):
    """Combine both halves of a window's sums, relative to its own mass."""
    for axis in range(3):
        end_row(
            n, far, weight, mass, row_at(reference, axis * plane), row_at(x, axis * plane), row_at(added, axis * n),
            row_at(added, (ROWS_BEFORE + axis) * n), row_at(sums, axis * pitch),
            row_at(sums, (ROWS_BEFORE + axis) * pitch),
        )  # fmt: skip
    for other in range(3, ROWS_BEFORE):
        add_to(n, row_at(added, other * n), row_at(sums, other * pitch))


@row_routine
def add_goal_row(n, lever, count, total, column, x, reference, displacement, columns):
    for k in range(n):
        displacement[k] = added_goal(displacement[k], total[k], count, x[k], reference[k], lever, column[k])
        columns[k] = columns[k] + column[k]


@routine
def add_goals(n, lever, count, goals, pitch, x, reference, plane, sums):
    """Add a row's displacements and columns of rotations to a scan."""
    for axis in range(3):
        add_goal_row(
            n, lever, count, row_at(goals, axis * pitch), row_at(goals, (ROWS_BEFORE + axis) * pitch),
            row_at(x, axis * plane), row_at(reference, axis * plane), row_at(sums, axis * n),
            row_at(sums, (ROWS_BEFORE + axis) * n),
        )  # fmt: skip
    for other in range(3, ROWS_BEFORE):
        add_to(n, row_at(goals, other * pitch), row_at(sums, other * n))


@row_routine
def end_goal_row(n, lever, count, reference, x, added, added_column, displacement, column, out):
    for k in range(n):
        out[k] = ended(displacement[k] + added[k], count, reference[k], x[k], lever, column[k] + added_column[k])


@row_routine
def end_other_row(n, one, other, out):
    for k in range(n):
        out[k] = one[k] + other[k]


@routine
def end_goals(n, lever, count, reference, x, plane, added, sums, pitch, target):
    """Combine both halves of a window's displacements."""
    out, out_pitch = target
    for axis in range(3):
        end_goal_row(
            n, lever, count, row_at(reference, axis * plane), row_at(x, axis * plane), row_at(added, axis * pitch),
            row_at(added, (ROWS_BEFORE + axis) * pitch), row_at(sums, axis * pitch),
            row_at(sums, (ROWS_BEFORE + axis) * pitch), row_at(out, axis * out_pitch),
        )  # fmt: skip
    for other in range(3, ROWS_BEFORE):
        end_other_row(n, row_at(sums, other * pitch), row_at(added, other * pitch), row_at(out, other * out_pitch))
