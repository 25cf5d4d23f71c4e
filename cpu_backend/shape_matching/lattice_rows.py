"""Passes over lattices on CPU threads, row by row along x; formulas/shape_matching/lattice.py defines the sums and
their order.

Rows are arrays of unchecked length (`row_at`), which do not overlap. Arrays that belong together (the sums of a window,
and so on) are consecutive rows, `pitch` apart: of a slice in a thread's scratch, or planes of the whole. Vectors are
three rows; `n`: masses of a row.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import lattice

LINE, SLICE, WINDOW = 6, 9, 12  # sums over a row, a slice and a whole window: differences and turns, three each
GOAL_LINE = 6  # of displacements to goals, after the passes along z and y; after z, as many as of a slice


def make_rows(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `clear(n, rows, pitch, out)`, `copy(n, rows, source, source_pitch, out, pitch)` and `add_to(n, source,
    out)`, one row."""
    compiled, row, zero = compiler.compiled, compiler.row, real(0)

    @row
    def clear_row(n, out):
        for k in range(n):
            out[k] = zero

    @row
    def copy_row(n, source, out):
        for k in range(n):
            out[k] = source[k]

    @row
    def add_to(n, source, out):
        for k in range(n):
            out[k] = out[k] + source[k]

    @compiled
    def clear(n, rows, pitch, out):
        for k in range(rows):
            clear_row(n, row_at(out, k * pitch))

    @compiled
    def copy(n, rows, source, source_pitch, out, pitch):
        for k in range(rows):
            copy_row(n, row_at(source, k * source_pitch), row_at(out, k * pitch))

    return SimpleNamespace(clear=clear, copy=copy, add_to=add_to)


def make_line_sums(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make sums over windows along a row at x: `sum_line(n, region, x, plane, weights, centre, line, pitch)`, of masses,
    and `sum_goals(n, region, rest, count, x, plane, centre, line, pitch, displacements)`, of displacements to goals."""
    compiled, row, clear = compiler.compiled, compiler.row, make_rows(compiler, real).clear
    formulas = compiler.formulas(lattice, real, inline=True)
    lever, part_of, added_turn, added_goal = formulas.lever, formulas.part_of, formulas.added_turn, formulas.added_goal

    @row
    def add_members(n, step, x, middle, weights, centre, total, turn):
        for k in range(n):
            part = part_of(weights[k], x[k], middle[k])
            total[k] = total[k] + part
            turn[k] = added_turn(turn[k], part, lever(step, centre[k]))

    @compiled
    def sum_line(n, region, x, plane, weights, centre, line, pitch):
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

    @row
    def add_goal_members(n, step, rest, count, total, column, x, middle, centre, displacement):
        for k in range(n):
            along = lever(step, centre[k]) * rest
            displacement[k] = added_goal(displacement[k], total[k], count, x[k], middle[k], along, column[k])

    @compiled
    def sum_goals(n, region, rest, count, x, plane, centre, line, pitch, displacements):
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

    return SimpleNamespace(sum_line=sum_line, sum_goals=sum_goals)


def make_moments(compiler: Compiler, real: Real, turns: int) -> SimpleNamespace:
    """Make moments along y and z: `add` adds a row's sums to a scan; `end` combines both halves of a window's sums,
    relative to its own mass. Both have differences, turns along the `turns` axes that are done, and those along the
    scan's own."""
    compiled, row, rows_before = compiler.compiled, compiler.row, 3 * (turns + 1)
    formulas = compiler.formulas(lattice, real, inline=True)
    part_of_row, added_turn, shifted = formulas.part_of_row, formulas.added_turn, formulas.shifted
    add_to = make_rows(compiler, real).add_to

    @row
    def add_row(n, step, weight, mass, total, x, reference, sums, turn):
        for k in range(n):
            part = part_of_row(weight, total[k], mass[k], x[k], reference[k])
            sums[k] = sums[k] + part
            turn[k] = added_turn(turn[k], part, step)

    @row
    def add_turn(n, weight, turn, sums):
        for k in range(n):
            sums[k] = added_turn(sums[k], turn[k], weight)

    @compiled
    def add(n, step, weight, mass, rows, pitch, x, reference, plane, sums):
        for axis in range(3):
            add_row(
                n, step, weight, mass, row_at(rows, axis * pitch), row_at(x, axis * plane), row_at(reference, axis * plane),
                row_at(sums, axis * n), row_at(sums, (rows_before + axis) * n),
            )  # fmt: skip
        for other in range(3, rows_before):
            add_turn(n, weight, row_at(rows, other * pitch), row_at(sums, other * n))

    @row
    def end_row(n, far, weight, mass, reference, x, added, behind, sums, turn):
        for k in range(n):
            total = sums[k] + added[k]
            turn[k] = added_turn(turn[k] + behind[k], total, far)
            sums[k] = shifted(total, mass[k] * weight, reference[k], x[k])

    @compiled
    def end(n, far, weight, mass, reference, x, plane, added, sums, pitch):
        for axis in range(3):
            end_row(
                n, far, weight, mass, row_at(reference, axis * plane), row_at(x, axis * plane), row_at(added, axis * n),
                row_at(added, (rows_before + axis) * n), row_at(sums, axis * pitch),
                row_at(sums, (rows_before + axis) * pitch),
            )  # fmt: skip
        for other in range(3, rows_before):
            add_to(n, row_at(added, other * n), row_at(sums, other * pitch))

    return SimpleNamespace(add=add, end=end)


def make_goals(compiler: Compiler, real: Real, rest: int) -> SimpleNamespace:
    """Make displacements to goals along y and z: `add_goals` adds to a scan; `end_goals` combines both halves.

    Both have displacements, the columns of the rotations along the scan's axis, and those of the `rest` axes that are
    still to come, in the order displacements, others, own ones.
    """
    compiled, row, rows_before = compiler.compiled, compiler.row, 3 * (rest + 1)
    formulas = compiler.formulas(lattice, real, inline=True)
    added_goal, ended, add_to = formulas.added_goal, formulas.ended, make_rows(compiler, real).add_to

    @row
    def add_goal_row(n, lever, count, total, column, x, reference, displacement, columns):
        for k in range(n):
            displacement[k] = added_goal(displacement[k], total[k], count, x[k], reference[k], lever, column[k])
            columns[k] = columns[k] + column[k]

    @compiled
    def add_goals(n, lever, count, goals, pitch, x, reference, plane, sums):
        for axis in range(3):
            add_goal_row(
                n, lever, count, row_at(goals, axis * pitch), row_at(goals, (rows_before + axis) * pitch),
                row_at(x, axis * plane), row_at(reference, axis * plane), row_at(sums, axis * n),
                row_at(sums, (rows_before + axis) * n),
            )  # fmt: skip
        for other in range(3, rows_before):
            add_to(n, row_at(goals, other * pitch), row_at(sums, other * n))

    @row
    def end_goal_row(n, lever, count, reference, x, added, added_column, displacement, column, out):
        for k in range(n):
            out[k] = ended(displacement[k] + added[k], count, reference[k], x[k], lever, column[k] + added_column[k])

    @row
    def end_other_row(n, one, other, out):
        for k in range(n):
            out[k] = one[k] + other[k]

    @compiled
    def end_goals(n, lever, count, reference, x, plane, added, sums, pitch, target):
        out, out_pitch = target
        for axis in range(3):
            end_goal_row(
                n, lever, count, row_at(reference, axis * plane), row_at(x, axis * plane), row_at(added, axis * pitch),
                row_at(added, (rows_before + axis) * pitch), row_at(sums, axis * pitch),
                row_at(sums, (rows_before + axis) * pitch), row_at(out, axis * out_pitch),
            )  # fmt: skip
        for other in range(3, rows_before):
            end_other_row(n, row_at(sums, other * pitch), row_at(added, other * pitch), row_at(out, other * out_pitch))

    return SimpleNamespace(add_goals=add_goals, end_goals=end_goals)
