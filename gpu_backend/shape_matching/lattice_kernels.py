"""CUDA kernels of lattices: passes along x with a thread per mass, along y and z with a thread per group of windows.

formulas/shape_matching/lattice.py defines the sums. Neighbouring threads process neighbours along x. Sums are in planes
of `total` numbers: the three components of differences, then those of turns, by axis.

Arguments of all are (numbers, values, tables, total, position, source, ...) of one lattice and its copies; `span`: windows
of a group that a thread processes in sequence: many need the fewest sums, few use the most threads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.assets.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_WEIGHT, V_MATCHING, V_SPACING, V_TURN
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, real, routine
from softlab.model.formulas.rotation import matrix_of, rotation_3d
from softlab.model.formulas.shape_matching.lattice import (
    added_goal,
    added_turn,
    centre,
    ended,
    entry,
    lever,
    moved,
    part_of,
    part_of_row,
    shifted,
)

THREADS = 128  # per block
PLANES = 12
NUMBERS = 10  # of a lattice; tables: offset of each axis's table
N_X, N_Y, N_Z, N_REGION, N_COPIES, N_FIRST, N_PLACE, N_TABLE_X, N_TABLE_Y, N_TABLE_Z = range(NUMBERS)
AXES = 3
FIRST = np.int32(V_TURN)


@routine
def sum_lines(numbers, values, tables, total, position, out):
    """Sum, along x, the differences from the mass in the middle, and their turns."""
    t, nx = np.int32(cuda.grid(1)), numbers[N_X]
    size = np.int32(nx * numbers[N_Y] * numbers[N_Z])
    if t < size * numbers[N_COPIES]:
        k, region = np.int32(t % nx), numbers[N_REGION]
        first, place = np.int32(numbers[N_FIRST] + t - k), np.int32(numbers[N_PLACE] + t)
        here = load_quad(position, np.int32(first + k))
        x, y, z, xx, yx, zx = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for other in range(max(np.int32(0), k - region), min(nx, k + region + 1)):
            if other != k:
                p = load_quad(position, np.int32(first + other))
                weight = tables[numbers[N_TABLE_X] + T_WEIGHT * nx + other]
                away = lever(real(other - k), tables[numbers[N_TABLE_X] + T_CENTRE * nx + k])
                a, b = part_of(weight, p[0], here[0]), part_of(weight, p[1], here[1])
                c = part_of(weight, p[2], here[2])
                x, y, z = x + a, y + b, z + c
                xx, yx, zx = added_turn(xx, a, away), added_turn(yx, b, away), added_turn(zx, c, away)
        out[place], out[total + place], out[2 * total + place] = x, y, z
        out[3 * total + place], out[4 * total + place], out[5 * total + place] = xx, yx, zx


@routine
def move_lines(numbers, values, tables, total, position, source):
    """Sum displacements to goals along x, and move masses by a fraction of their mean. The source also has old
    positions, as neighbours may have moved."""
    t, nx, ny, nz = np.int32(cuda.grid(1)), numbers[N_X], numbers[N_Y], numbers[N_Z]
    size = np.int32(nx * ny * nz)
    if t < size * numbers[N_COPIES]:
        k, region = np.int32(t % nx), numbers[N_REGION]
        j, deep = np.int32(t // nx % ny), np.int32(t // (nx * ny) % nz)
        first, place = np.int32(numbers[N_FIRST] + t - k), np.int32(numbers[N_PLACE] + t - k)
        at_x, at_y, at_z = numbers[N_TABLE_X], numbers[N_TABLE_Y], numbers[N_TABLE_Z]
        count = tables[at_y + T_COUNT * ny + j] * tables[at_z + T_COUNT * nz + deep]
        here, was = load_quad(position, np.int32(first + k)), np.int32(PLANES - AXES)
        x, y, z = 0.0, 0.0, 0.0
        for other in range(max(np.int32(0), k - region), min(nx, k + region + 1)):
            at = np.int32(place + other)
            px, py, pz = source[was * total + at], source[(was + 1) * total + at], source[(was + 2) * total + at]
            along = lever(real(k - other), tables[at_x + T_CENTRE * nx + other]) * values[V_SPACING]
            x = added_goal(x, source[at], count, px, here[0], along, source[3 * total + at])
            y = added_goal(y, source[total + at], count, py, here[1], along, source[4 * total + at])
            z = added_goal(z, source[2 * total + at], count, pz, here[2], along, source[5 * total + at])
        weight_x, weight_y = tables[at_x + T_WEIGHT * nx + k], tables[at_y + T_WEIGHT * ny + j]
        weight_z, matching = tables[at_z + T_WEIGHT * nz + deep], values[V_MATCHING]
        store_quad(
            position, np.int32(first + k), moved(here[0], x, weight_x, weight_y, weight_z, matching),
            moved(here[1], y, weight_x, weight_y, weight_z, matching),
            moved(here[2], z, weight_x, weight_y, weight_z, matching), here[3],
        )  # fmt: skip


@routine
def scan_moments(numbers, values, tables, total, position, source, out, span):
    """Sum windows along z if `upwards`, of sums over slices, else along y, of sums along rows."""
    rows_before = AXES * (3 if FEATURE.upwards else 2)
    sums = rows_before + AXES
    t, nx, ny, nz = np.int32(cuda.grid(1)), numbers[N_X], numbers[N_Y], numbers[N_Z]
    region, at_x, at_y = numbers[N_REGION], numbers[N_TABLE_X], numbers[N_TABLE_Y]
    n, at = (nz, numbers[N_TABLE_Z]) if FEATURE.upwards else (ny, at_y)
    width = np.int32(2 * region + 1)
    parts = np.int32((width + span - 1) // span)  # of a group of windows, a thread each
    groups, others = np.int32((n + width - 1) // width * parts), ny if FEATURE.upwards else nz
    if t < nx * groups * others * numbers[N_COPIES]:
        k, rest = np.int32(t % nx), np.int32(t // nx)
        if FEATURE.upwards:
            row, rest = np.int32(rest % ny), np.int32(rest // ny)
            group, copy = np.int32(rest % groups), np.int32(rest // groups)
            begin, pitch = np.int32((copy * nz * ny + row) * nx + k), np.int32(ny * nx)
            mass, weight = tables[at_x + T_MASS * nx + k], tables[at_y + T_MASS * ny + row]
        else:
            group, rest = np.int32(rest % groups), np.int32(rest // groups)
            begin, pitch = np.int32(rest * ny * nx + k), nx
            mass, weight = tables[at_x + T_MASS * nx + k], 1.0
        heavy = mass * weight
        begins = np.int32(group // parts * width)
        low, b = np.int32(begins + group % parts * span), np.int32(min(begins + region, n - 1))
        high = np.int32(min(low + span, min(begins + width, n)))
        first, place = np.int32(numbers[N_FIRST] + begin), np.int32(numbers[N_PLACE] + begin)
        reference = load_quad(position, np.int32(first + b * pitch))
        s = cuda.local.array(PLANES, real)
        for half in range(2):
            for m in range(sums):
                s[m] = 0.0
            j = np.int32(b - 1 + half)
            for step in range(high - low):
                i = np.int32(low + step if half else high - 1 - step)
                last = np.int32(min(n - 1, i + region) if half else max(np.int32(0), i - region))
                while (j <= last) if half else (j >= last):
                    p, here = load_quad(position, np.int32(first + j * pitch)), np.int32(place + j * pitch)
                    row_weight, away = tables[at + T_WEIGHT * n + j], real(j - b)
                    for axis in range(AXES):
                        part = part_of_row(row_weight, source[axis * total + here], heavy, p[axis], reference[axis])
                        s[axis] = s[axis] + part
                        s[rows_before + axis] = added_turn(s[rows_before + axis], part, away)
                    for m in range(AXES, rows_before):
                        s[m] = added_turn(s[m], source[m * total + here], row_weight)
                    j = np.int32(j + 1 if half else j - 1)
                here = np.int32(place + i * pitch)
                if half == 0:
                    for m in range(sums):
                        out[m * total + here] = s[m]
                else:
                    p = load_quad(position, np.int32(first + i * pitch))
                    far = lever(real(b - i), tables[at + T_CENTRE * n + i])
                    its = heavy * tables[at + T_MASS * n + i]
                    for axis in range(AXES):
                        whole = out[axis * total + here] + s[axis]
                        turn = out[(rows_before + axis) * total + here] + s[rows_before + axis]
                        out[(rows_before + axis) * total + here] = added_turn(turn, whole, far)
                        out[axis * total + here] = shifted(whole, its, reference[axis], p[axis])
                    for m in range(AXES, rows_before):
                        out[m * total + here] = out[m * total + here] + s[m]


@routine
def turn(numbers, values, tables, total, position, source, rotation, new_rotation, frames, for_view):
    """Write rotations, and in the source vectors to centres and columns of rotations, or, with `for_view`, frames."""
    t, nx, ny, nz = np.int32(cuda.grid(1)), numbers[N_X], numbers[N_Y], numbers[N_Z]
    size = np.int32(nx * ny * nz)
    if t < size * numbers[N_COPIES]:
        k, c = np.int32(t % nx), np.int32(numbers[N_PLACE] + t)
        j, deep = np.int32(t // nx % ny), np.int32(t // (nx * ny) % nz)
        q = load_quad(rotation, c)
        ta, tb, tc = values[FIRST], values[FIRST + 1], values[FIRST + 2]
        td, te, tf = values[FIRST + 3], values[FIRST + 4], values[FIRST + 5]
        tg, th, ti = values[FIRST + 6], values[FIRST + 7], values[FIRST + 8]
        xx, xy, xz = source[3 * total + c], source[6 * total + c], source[9 * total + c]
        yx, yy, yz = source[4 * total + c], source[7 * total + c], source[10 * total + c]
        zx, zy, zz = source[5 * total + c], source[8 * total + c], source[11 * total + c]
        moments = (
            entry(xx, xy, xz, ta, tb, tc), entry(xx, xy, xz, td, te, tf), entry(xx, xy, xz, tg, th, ti),
            entry(yx, yy, yz, ta, tb, tc), entry(yx, yy, yz, td, te, tf), entry(yx, yy, yz, tg, th, ti),
            entry(zx, zy, zz, ta, tb, tc), entry(zx, zy, zz, td, te, tf), entry(zx, zy, zz, tg, th, ti),
        )  # fmt: skip
        w, x, y, z = rotation_3d(moments, (q[0], q[1], q[2], q[3]))
        store_quad(new_rotation, c, w, x, y, z)
        xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix_of(w, x, y, z)
        of_slice = tables[numbers[N_TABLE_X] + T_INVERSE * nx + k] * tables[numbers[N_TABLE_Y] + T_INVERSE * ny + j]
        of_z = tables[numbers[N_TABLE_Z] + T_INVERSE * nz + deep]
        a, b = centre(source[c], of_slice, of_z), centre(source[total + c], of_slice, of_z)
        d = centre(source[2 * total + c], of_slice, of_z)
        if for_view:
            p, row = load_quad(position, np.int32(numbers[N_FIRST] + t)), np.int32(AXES * c)
            store_quad(frames, row, xx, xy, xz, p[0] + a)
            store_quad(frames, np.int32(row + 1), yx, yy, yz, p[1] + b)
            store_quad(frames, np.int32(row + 2), zx, zy, zz, p[2] + d)
        else:
            source[c], source[total + c], source[2 * total + c] = a, b, d
            source[3 * total + c], source[6 * total + c], source[9 * total + c] = (
                entry(xx, xy, xz, ta, td, tg), entry(xx, xy, xz, tb, te, th), entry(xx, xy, xz, tc, tf, ti)
            )  # fmt: skip
            source[4 * total + c], source[7 * total + c], source[10 * total + c] = (
                entry(yx, yy, yz, ta, td, tg), entry(yx, yy, yz, tb, te, th), entry(yx, yy, yz, tc, tf, ti)
            )  # fmt: skip
            source[5 * total + c], source[8 * total + c], source[11 * total + c] = (
                entry(zx, zy, zz, ta, td, tg), entry(zx, zy, zz, tb, te, th), entry(zx, zy, zz, tc, tf, ti)
            )  # fmt: skip


@routine
def scan_goals(numbers, values, tables, total, position, source, out, span):
    """Sum displacements to goals along z if `upwards`, of clusters, else along y, of their sums; without the last column
    of rotations."""
    rows_before = AXES * (3 if FEATURE.upwards else 2)
    sums = rows_before + AXES
    t, nx, ny, nz = np.int32(cuda.grid(1)), numbers[N_X], numbers[N_Y], numbers[N_Z]
    region, at_z, spacing = numbers[N_REGION], numbers[N_TABLE_Z], values[V_SPACING]
    n, at = (nz, at_z) if FEATURE.upwards else (ny, numbers[N_TABLE_Y])
    width = np.int32(2 * region + 1)
    parts = np.int32((width + span - 1) // span)  # of a group of windows, a thread each
    groups, others = np.int32((n + width - 1) // width * parts), ny if FEATURE.upwards else nz
    if t < nx * groups * others * numbers[N_COPIES]:
        k, rest = np.int32(t % nx), np.int32(t // nx)
        if FEATURE.upwards:
            row, rest = np.int32(rest % ny), np.int32(rest // ny)
            group, copy = np.int32(rest % groups), np.int32(rest // groups)
            begin, pitch = np.int32((copy * nz * ny + row) * nx + k), np.int32(ny * nx)
            count = 1.0
        else:
            group, rest = np.int32(rest % groups), np.int32(rest // groups)
            begin, pitch = np.int32(rest * ny * nx + k), nx
            count = tables[at_z + T_COUNT * nz + rest % nz]
        begins = np.int32(group // parts * width)
        low, b = np.int32(begins + group % parts * span), np.int32(min(begins + region, n - 1))
        high = np.int32(min(low + span, min(begins + width, n)))
        first, place = np.int32(numbers[N_FIRST] + begin), np.int32(numbers[N_PLACE] + begin)
        reference = load_quad(position, np.int32(first + b * pitch))
        s = cuda.local.array(PLANES, real)
        for half in range(2):
            for m in range(sums):
                s[m] = 0.0
            j = np.int32(b - 1 + half)
            for step in range(high - low):
                i = np.int32(low + step if half else high - 1 - step)
                last = np.int32(min(n - 1, i + region) if half else max(np.int32(0), i - region))
                while (j <= last) if half else (j >= last):
                    p, here = load_quad(position, np.int32(first + j * pitch)), np.int32(place + j * pitch)
                    along = lever(real(b - j), tables[at + T_CENTRE * n + j]) * spacing
                    for axis in range(AXES):
                        column = source[(rows_before + axis) * total + here]
                        s[axis] = added_goal(
                            s[axis], source[axis * total + here], count, p[axis], reference[axis], along, column
                        )
                        s[rows_before + axis] = s[rows_before + axis] + column
                    for m in range(AXES, rows_before):
                        s[m] = s[m] + source[m * total + here]
                    j = np.int32(j + 1 if half else j - 1)
                here = np.int32(place + i * pitch)
                if half == 0:
                    for m in range(sums):
                        out[m * total + here] = s[m]
                else:
                    p = load_quad(position, np.int32(first + i * pitch))
                    all_of_it = tables[at + T_COUNT * n + i] * count
                    if not FEATURE.upwards:
                        for axis in range(AXES):
                            out[(PLANES - AXES + axis) * total + here] = p[axis]
                    for axis in range(AXES):
                        displacement = out[axis * total + here] + s[axis]
                        column = out[(rows_before + axis) * total + here] + s[rows_before + axis]
                        out[axis * total + here] = ended(
                            displacement, all_of_it, reference[axis], p[axis], real(i - b) * spacing, column
                        )
                    for m in range(AXES, rows_before):
                        out[m * total + here] = out[m * total + here] + s[m]


@cache
def make_lattice_kernels(real: Real, math: str) -> SimpleNamespace:
    """Compile `sum_lines(..., out)` without a source, `sum_slices(..., out, span)`, `sum_windows(..., out, span)`: moments;
    `turn(..., rotation, new_rotation, frames, for_view)`; `goal_slices(..., out, span)` and `goal_lines(..., out, span)`:
    displacements, positions; `move_lines(...)`: masses."""
    label, scans = f"lattice_{variant_name(real, math)}", (scan_moments, scan_goals)
    along_y, along_z = (
        kernels_of(device_variant(real, math, {"upwards": upwards}), math, scans, label) for upwards in (False, True)
    )
    lines = kernels_of(device_variant(real, math), math, (sum_lines, move_lines, turn), label)
    return SimpleNamespace(
        sum_lines=lines.sum_lines, sum_slices=along_y.scan_moments, sum_windows=along_z.scan_moments, turn=lines.turn,
        goal_slices=along_z.scan_goals, goal_lines=along_y.scan_goals, move_lines=lines.move_lines,
    )  # fmt: skip
