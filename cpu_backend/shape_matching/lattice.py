"""Lattices among the bodies of CPU threads: three passes an iteration, over slices, pencils, slices; see
shape_matching/lattice_rows.py.

A slice (x, y) sums up along x and y; a pencil, a few rows along x over all z, along z, finds the clusters' rotations and sums
up their goals along z; the slice then along y and x, and moves its masses. A pass waits for the one before, and slices and
pencils are dealt out to threads: which one does what changes no bit.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from cpu_backend.core.progress import shares
from cpu_backend.shape_matching.lattice_layout import FRAME, QUATERNION
from cpu_backend.shape_matching.lattice_rows import GOAL_LINE, LINE, SLICE, WINDOW, make_lattice_rows
from model.formulas import lattice, rotation
from model.shape_matching.lattice import (
    T_CENTRE,
    T_COUNT,
    T_INVERSE,
    T_MASS,
    T_SHARE,
    V_MATCHING,
    V_SPACING,
    V_TURN,
    VALUES,
)


def make_lattice_passes(compiler: Compiler, real: Any) -> SimpleNamespace:
    """`slice_up(unit, position, count, arrays, room)`: the sums of a slice, into the work; `turn(unit, position, count,
    arrays, turned, frames, look, room)`: the clusters of a pencil into `turned`, and their goals' sums into the work, or, in
    a `look`, their frames; `move(unit, position, count, arrays, room)`: the masses of a slice."""
    compiled, row = compiler.compiled, compiler.row
    rows = make_lattice_rows(compiler, real)
    clear, copy, sum_line, add_line, end_slice = rows.clear, rows.copy, rows.sum_line, rows.add_line, rows.end_slice
    add_slice, end_window, add_goals, end_goals = rows.add_slice, rows.end_window, rows.add_goals, rows.end_goals
    sum_goals = rows.sum_goals
    inlined, turns = lattice.make(real, compiler.inlined), rotation.make(real, compiler.inlined)
    centre, moved, lever, entry = inlined.centre, inlined.moved, inlined.lever, inlined.entry
    near, matrix_of = turns.rotation_3d_near, turns.matrix_of
    far = rotation.make(real, compiled).rotation_3d_far
    zero, one = real(0), real(1)

    @compiled
    def slice_up(unit, position, count, arrays, room):
        numbers, units, tables, work = arrays[0], arrays[1], arrays[3], arrays[5]
        which, first, z = units[unit, 0], units[unit, 1], units[unit, 2]
        nx, ny, region = numbers[which, 0], numbers[which, 1], numbers[which, 3]
        at_x, at_y = numbers[which, 4], numbers[which, 5]
        begin, mass = first + z * ny * nx, row_at(tables, at_x + T_MASS * nx)
        sums = row_at(room, LINE * nx * ny)
        for j in range(ny):
            x, line = row_at(position, begin + j * nx), row_at(room, LINE * nx * j)
            share, centres = row_at(tables, at_x + T_SHARE * nx), row_at(tables, at_x + T_CENTRE * nx)
            sum_line(nx, region, x, count, share, centres, line, nx)
        width = 2 * region + 1
        for low in range(0, ny, width):
            high, b = min(low + width, ny), min(low + region, ny - 1)
            reference = row_at(position, begin + b * nx)
            clear(nx, SLICE, nx, sums)
            j = b
            for back in range(high - low):
                i = high - 1 - back
                while j > max(0, i - region):
                    j -= 1
                    add_line(
                        nx, real(j - b), tables[at_y + T_SHARE * ny + j], mass, row_at(room, LINE * nx * j), nx,
                        row_at(position, begin + j * nx), reference, count, sums, nx,
                    )  # fmt: skip
                copy(nx, SLICE, sums, nx, row_at(work, begin + i * nx), count)
            clear(nx, SLICE, nx, sums)
            j = b
            for i in range(low, high):
                while j <= min(ny - 1, i + region):
                    add_line(
                        nx, real(j - b), tables[at_y + T_SHARE * ny + j], mass, row_at(room, LINE * nx * j), nx,
                        row_at(position, begin + j * nx), reference, count, sums, nx,
                    )  # fmt: skip
                    j += 1
                end_slice(
                    nx, lever(real(b - i), tables[at_y + T_CENTRE * ny + i]), tables[at_y + T_MASS * ny + i], mass, reference,
                    row_at(position, begin + i * nx), count, sums, nx, row_at(work, begin + i * nx), count,
                )  # fmt: skip

    @row
    def near_row(n, t, xx, yx, zx, xy, yy, zy, xz, yz, zz, w, x, y, z, to_w, to_x, to_y, to_z, reached):
        for k in range(n):
            a, b, c = xx[k], xy[k], xz[k]
            d, e, f = yx[k], yy[k], yz[k]
            g, h, i = zx[k], zy[k], zz[k]
            to_w[k], to_x[k], to_y[k], to_z[k], there = near(
                entry(a, b, c, t[0], t[1], t[2]), entry(a, b, c, t[3], t[4], t[5]), entry(a, b, c, t[6], t[7], t[8]),
                entry(d, e, f, t[0], t[1], t[2]), entry(d, e, f, t[3], t[4], t[5]), entry(d, e, f, t[6], t[7], t[8]),
                entry(g, h, i, t[0], t[1], t[2]), entry(g, h, i, t[3], t[4], t[5]), entry(g, h, i, t[6], t[7], t[8]),
                w[k], x[k], y[k], z[k],
            )  # fmt: skip
            reached[k] = one if there else zero

    @compiled
    def far_of(a, n, t, w, x, y, z):
        """The rotation of a window whose sums' entries lie `n` apart, by columns."""
        xx, xy, xz = a[0], a[3 * n], a[6 * n]
        yx, yy, yz = a[n], a[4 * n], a[7 * n]
        zx, zy, zz = a[2 * n], a[5 * n], a[8 * n]
        return far(
            entry(xx, xy, xz, t[0], t[1], t[2]), entry(xx, xy, xz, t[3], t[4], t[5]), entry(xx, xy, xz, t[6], t[7], t[8]),
            entry(yx, yy, yz, t[0], t[1], t[2]), entry(yx, yy, yz, t[3], t[4], t[5]), entry(yx, yy, yz, t[6], t[7], t[8]),
            entry(zx, zy, zz, t[0], t[1], t[2]), entry(zx, zy, zz, t[3], t[4], t[5]), entry(zx, zy, zz, t[6], t[7], t[8]),
            w, x, y, z,
        )  # fmt: skip

    @row
    def matrix_row(n, t, w, x, y, z, xx, yx, zx, xy, yy, zy, xz, yz, zz):
        for k in range(n):
            a, b, c, d, e, f, g, h, i = matrix_of(w[k], x[k], y[k], z[k])
            xx[k], xy[k], xz[k] = (
                entry(a, b, c, t[0], t[3], t[6]), entry(a, b, c, t[1], t[4], t[7]), entry(a, b, c, t[2], t[5], t[8])
            )  # fmt: skip
            yx[k], yy[k], yz[k] = (
                entry(d, e, f, t[0], t[3], t[6]), entry(d, e, f, t[1], t[4], t[7]), entry(d, e, f, t[2], t[5], t[8])
            )  # fmt: skip
            zx[k], zy[k], zz[k] = (
                entry(g, h, i, t[0], t[3], t[6]), entry(g, h, i, t[1], t[4], t[7]), entry(g, h, i, t[2], t[5], t[8])
            )  # fmt: skip

    @row
    def centre_row(n, of_slice, inverse, total):
        for k in range(n):
            total[k] = centre(total[k], of_slice[k], inverse)

    @compiled
    def turn_row(n, t, window, rotation, turned, clusters, reached):
        """The rotations of a row of windows by their sums, which then are the columns that rest offsets are turned by. `t`:
        the lattice's turn at the start, by rows."""
        a, old, new = row_at(window, 3 * n), row_at(reached, n), turned
        copy(n, QUATERNION, rotation, clusters, old, n)  # which may be where the new ones go
        near_row(
            n, t, a, row_at(a, n), row_at(a, 2 * n), row_at(a, 3 * n), row_at(a, 4 * n), row_at(a, 5 * n), row_at(a, 6 * n),
            row_at(a, 7 * n), row_at(a, 8 * n), old, row_at(old, n), row_at(old, 2 * n),
            row_at(old, 3 * n), new, row_at(new, clusters), row_at(new, 2 * clusters), row_at(new, 3 * clusters),
            reached,
        )  # fmt: skip
        for k in range(n):
            if reached[k] == zero:
                new[k], new[clusters + k], new[2 * clusters + k], new[3 * clusters + k] = far_of(
                    row_at(a, k), n, t, new[k], new[clusters + k], new[2 * clusters + k], new[3 * clusters + k]
                )
        matrix_row(
            n, t, new, row_at(new, clusters), row_at(new, 2 * clusters), row_at(new, 3 * clusters), a, row_at(a, n),
            row_at(a, 2 * n), row_at(a, 3 * n), row_at(a, 4 * n), row_at(a, 5 * n), row_at(a, 6 * n), row_at(a, 7 * n),
            row_at(a, 8 * n),
        )  # fmt: skip

    @compiled
    def turn(unit, position, count, arrays, turned, frames, look, room):
        numbers, units, tables, values = arrays[0], arrays[2], arrays[3], arrays[4]
        work, rotation = arrays[5], arrays[6]
        which, first, cluster = units[unit, 0], units[unit, 1], units[unit, 2]
        nx, ny, nz, region = numbers[which, 0], numbers[which, 1], numbers[which, 2], numbers[which, 3]
        at_z, below = numbers[which, 6], nx * units[unit, 3]  # `below`: masses of the slice before this pencil's
        n, deep = nx * units[unit, 4] - below, nx * ny
        mass, inverse = row_at(tables, numbers[which, 7] + below), row_at(tables, numbers[which, 7] + deep + below)
        rest, clusters, pitch = values[VALUES * which + V_SPACING], rotation.size // QUATERNION, WINDOW * n
        begin, width = first + below, 2 * region + 1
        sums = row_at(room, pitch * nz)
        groups, turn_at_start = row_at(sums, pitch), row_at(values, np.int64(VALUES * which + V_TURN))
        for low in range(0, nz, width):
            high, b = min(low + width, nz), min(low + region, nz - 1)
            reference = row_at(position, begin + b * deep)
            clear(n, WINDOW, n, sums)
            j = b
            for back in range(high - low):
                i = high - 1 - back
                while j > max(0, i - region):
                    j -= 1
                    add_slice(
                        n, real(j - b), tables[at_z + T_SHARE * nz + j], mass, row_at(work, begin + j * deep), count,
                        row_at(position, begin + j * deep), reference, count, sums, n,
                    )  # fmt: skip
                copy(n, WINDOW, sums, n, row_at(room, pitch * i), n)
            clear(n, WINDOW, n, sums)
            j = b
            for i in range(low, high):
                while j <= min(nz - 1, i + region):
                    add_slice(
                        n, real(j - b), tables[at_z + T_SHARE * nz + j], mass, row_at(work, begin + j * deep), count,
                        row_at(position, begin + j * deep), reference, count, sums, n,
                    )  # fmt: skip
                    j += 1
                window = row_at(room, pitch * i)
                end_window(
                    n, lever(real(b - i), tables[at_z + T_CENTRE * nz + i]), tables[at_z + T_MASS * nz + i], mass,
                    reference, row_at(position, begin + i * deep), count, sums, window, n,
                )  # fmt: skip
                here = cluster + i * deep + below
                turn_row(n, turn_at_start, window, row_at(rotation, here), row_at(turned, here), clusters, groups)
                for axis in range(3):
                    centre_row(n, inverse, tables[at_z + T_INVERSE * nz + i], row_at(window, axis * n))
        if look:
            for i in range(nz):
                window, here = row_at(room, pitch * i), cluster + i * deep + below
                for k in range(n):
                    frame, c = row_at(frames, np.int64(FRAME) * (here + k)), here + k
                    frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6], frame[7], frame[8] = (
                        matrix_of(turned[c], turned[clusters + c], turned[2 * clusters + c], turned[3 * clusters + c])
                    )
                    for axis in range(3):
                        frame[9 + axis] = position[axis * count + begin + i * deep + k] + window[axis * n + k]
            return
        for low in range(0, nz, width):
            high, b = min(low + width, nz), min(low + region, nz - 1)
            reference = row_at(position, begin + b * deep)
            clear(n, WINDOW, n, sums)
            j = b
            for back in range(high - low):
                i = high - 1 - back
                while j > max(0, i - region):
                    j -= 1
                    add_goals(
                        n, 2, lever(real(b - j), tables[at_z + T_CENTRE * nz + j]) * rest, one, row_at(room, pitch * j), n,
                        row_at(position, begin + j * deep), reference, count, sums, n,
                    )  # fmt: skip
                copy(n, WINDOW, sums, n, row_at(groups, pitch * (i - low)), n)
            clear(n, WINDOW, n, sums)
            j = b
            for i in range(low, high):
                while j <= min(nz - 1, i + region):
                    add_goals(
                        n, 2, lever(real(b - j), tables[at_z + T_CENTRE * nz + j]) * rest, one, row_at(room, pitch * j), n,
                        row_at(position, begin + j * deep), reference, count, sums, n,
                    )  # fmt: skip
                    j += 1
                end_goals(
                    n, 2, real(i - b) * rest, tables[at_z + T_COUNT * nz + i], reference,
                    row_at(position, begin + i * deep), count, sums, row_at(groups, pitch * (i - low)), n,
                    row_at(work, begin + i * deep), count,
                )  # fmt: skip

    @row
    def move_row(n, way, share, share_y, share_z, matching, x):
        for k in range(n):
            x[k] = moved(x[k], way[k], share[k], share_y, share_z, matching)

    @compiled
    def move(unit, position, count, arrays, room):
        numbers, units, tables, values, work = arrays[0], arrays[1], arrays[3], arrays[4], arrays[5]
        which, first, z = units[unit, 0], units[unit, 1], units[unit, 2]
        nx, ny, nz, region = numbers[which, 0], numbers[which, 1], numbers[which, 2], numbers[which, 3]
        at_x, at_y, at_z = numbers[which, 4], numbers[which, 5], numbers[which, 6]
        rest, matching, begin = (
            values[VALUES * which + V_SPACING],
            values[VALUES * which + V_MATCHING],
            first + z * ny * nx,
        )
        count_z, width = tables[at_z + T_COUNT * nz + z], 2 * region + 1
        sums = row_at(room, GOAL_LINE * nx * ny)
        groups = row_at(sums, SLICE * nx)
        for low in range(0, ny, width):
            high, b = min(low + width, ny), min(low + region, ny - 1)
            reference = row_at(position, begin + b * nx)
            clear(nx, SLICE, nx, sums)
            j = b
            for back in range(high - low):
                i = high - 1 - back
                while j > max(0, i - region):
                    j -= 1
                    add_goals(
                        nx, 1, lever(real(b - j), tables[at_y + T_CENTRE * ny + j]) * rest, count_z,
                        row_at(work, begin + j * nx), count, row_at(position, begin + j * nx), reference, count, sums, nx,
                    )  # fmt: skip
                copy(nx, SLICE, sums, nx, row_at(groups, SLICE * nx * (i - low)), nx)
            clear(nx, SLICE, nx, sums)
            j = b
            for i in range(low, high):
                while j <= min(ny - 1, i + region):
                    add_goals(
                        nx, 1, lever(real(b - j), tables[at_y + T_CENTRE * ny + j]) * rest, count_z,
                        row_at(work, begin + j * nx), count, row_at(position, begin + j * nx), reference, count, sums, nx,
                    )  # fmt: skip
                    j += 1
                end_goals(
                    nx, 1, real(i - b) * rest, tables[at_y + T_COUNT * ny + i] * count_z, reference,
                    row_at(position, begin + i * nx), count, sums, row_at(groups, SLICE * nx * (i - low)), nx,
                    row_at(room, GOAL_LINE * nx * i), nx,
                )  # fmt: skip
        share, centres = row_at(tables, at_x + T_SHARE * nx), row_at(tables, at_x + T_CENTRE * nx)
        for j in range(ny):
            x, counted = row_at(position, begin + j * nx), tables[at_y + T_COUNT * ny + j] * count_z
            sum_goals(nx, region, rest, counted, x, count, centres, row_at(room, GOAL_LINE * nx * j), nx, sums)
            for axis in range(3):
                move_row(
                    nx, row_at(sums, axis * nx), share, tables[at_y + T_SHARE * ny + j], tables[at_z + T_SHARE * nz + z],
                    matching, row_at(x, axis * count),
                )  # fmt: skip

    return SimpleNamespace(slice_up=slice_up, turn=turn, move=move)


@cache
def make_lattice_matching(real: Any, math: str) -> SimpleNamespace:
    """`match(team, member, bands, position, count, arrays, turned, frames, look)` and `move(team, member, bands, position,
    count, arrays)`: what a member of a team does (core/progress.py) of all lattices, as Lattices.arrays has them."""
    compiler = Compiler(f"lattice_{np.dtype(real).name}_{math}", math)
    made = make_lattice_passes(compiler, real)
    slice_up, turn, move_slice = made.slice_up, made.turn, made.move

    @compiler.compiled
    def match_all(team, member, bands, position, count, arrays, turned, frames, look):
        slices, pencils, scratch, room = arrays[1].shape[0], arrays[2].shape[0], arrays[7], arrays[8]
        for band in shares(team, member, bands):
            for unit in range(slices * band // bands, slices * (band + 1) // bands):
                slice_up(unit, position, count, arrays, row_at(scratch, np.int64(room * band)))
        for band in shares(team, member, bands):
            for unit in range(pencils * band // bands, pencils * (band + 1) // bands):
                turn(unit, position, count, arrays, turned, frames, look, row_at(scratch, np.int64(room * band)))

    @compiler.compiled
    def move_all(team, member, bands, position, count, arrays):
        slices, scratch, room = arrays[1].shape[0], arrays[7], arrays[8]
        for band in shares(team, member, bands):
            for unit in range(slices * band // bands, slices * (band + 1) // bands):
                move_slice(unit, position, count, arrays, row_at(scratch, np.int64(room * band)))

    return SimpleNamespace(match=match_all, move=move_all)


@cache
def make_lattice_stages(real: Any, math: str) -> SimpleNamespace:
    """`match(bands, position, count, arrays, turned, frames, look)`, `move(bands, position, count, arrays)`: see
    make_lattice_matching."""
    made = make_lattice_matching(real, math)
    compiler = Compiler(f"lattice_stages_{np.dtype(real).name}_{math}", math)
    return SimpleNamespace(match=compiler.team(made.match), move=compiler.team(made.move))
