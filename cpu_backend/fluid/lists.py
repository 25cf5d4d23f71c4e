"""Who is near whom in a fluid: lists of neighbours, for CPU threads (model/fluid/plan.py, 3).

Particles are listed by slices of LANES that follow each other: entry k of all lanes, then entry k + 1. What a lane lacks, as
another has more, is filled with `nobody`, a particle so far off that it adds 0 to every sum. So loops over lanes are vectors,
and each lane's sum goes in the order of its own list.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.contact.particles_find import lowest_bit
from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from model.formulas.fluid import density

LANES = 16
FAR = 1e15  # m: nobody's place; its square is still a number in float32


def make_wrap(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """wrap(dx, dy, dz, sides): a difference, the shortest where the box repeats; `sides`: three lengths, and their halves."""
    wrapped = density.make(real, compiler.compiled).wrapped
    repeats, flat = "repeats" in parts, "flat" in parts

    @compiler.compiled
    def wrap(dx, dy, dz, sides):
        if repeats:
            dx, dy = wrapped(dx, sides[0], sides[3]), wrapped(dy, sides[1], sides[4])
            if not flat:
                dz = wrapped(dz, sides[2], sides[5])
        return dx, dy, dz

    return wrap


def make_find(compiler: Compiler, real: Any, parts: frozenset[str], most: int) -> Any:
    """find(first, last, count, room, nobody, place, starts, counts, sides, parameters, lists) -> neighbours that no list
    holds: of the slices `first` to before `last`. `counts`: of cells along x, y, z; `most`: neighbours of a particle."""
    formulas, wrap = density.make(real, compiler.compiled), make_wrap(compiler, real, parts)
    squared, within = formulas.squared, formulas.within
    repeats, flat = "repeats" in parts, "flat" in parts
    zero = real(0)

    @compiler.row
    def look(x, y, z, support, sides, xs, ys, zs):
        """Which of LANES particles are within the support, a bit each."""
        found = np.int32(0)
        for lane in range(LANES):
            dx, dy, dz = wrap(x - xs[lane], y - ys[lane], z - zs[lane], sides)
            found |= np.int32(within(squared(dx, dy, dz), support)) << np.int32(lane)
        return found

    @compiler.compiled
    def listed(i, lane, found, begin, end, room, place, sides, support, entries):
        """Appends those of the places `begin` to before `end` that are near; returned: how many there are with them."""
        x, y, z = place[i], place[room + i], place[2 * room + i]
        for k in range(begin, end, LANES):
            near = look(x, y, z, support, sides, row_at(place, k), row_at(place, room + k), row_at(place, 2 * room + k))
            near &= np.int32((1 << min(LANES, end - k)) - 1)
            while near != 0:
                j = k + lowest_bit(near)
                near &= near - np.int32(1)
                if j != i:
                    if found < most:
                        entries[found * LANES + lane] = np.int32(j)
                    found += 1
        return found

    @compiler.compiled
    def of_row(i, lane, found, x, row, nx, room, place, starts, sides, support, wraps, entries):
        """The cells x - 1, x, x + 1 of a row of cells."""
        begin, end = max(x - 1, 0), min(x + 2, nx)
        if wraps and x == 0:
            at = row + nx - 1
            found = listed(
                i, lane, found, np.int64(starts[at]), np.int64(starts[at + 1]), room, place, sides, support, entries
            )
        found = listed(
            i, lane, found, np.int64(starts[row + begin]), np.int64(starts[row + end]), room, place, sides, support, entries
        )  # fmt: skip
        if wraps and x == nx - 1:
            found = listed(
                i, lane, found, np.int64(starts[row]), np.int64(starts[row + 1]), room, place, sides, support, entries
            )
        return found

    @compiler.compiled
    def find(first, last, count, room, nobody, place, cell, order, starts, counts, sides, parameters, lists):
        neighbours, longest, entries = lists
        support, missed = parameters.support, 0
        nx, ny, nz = counts
        wraps_x = wraps_y = wraps_z = False
        if repeats:
            wraps_x, wraps_y, wraps_z = sides[0] > zero, sides[1] > zero, sides[2] > zero
        for s in range(first, last):
            own = row_at(entries, np.int64(s) * (LANES * most))
            longest[s] = 0
            for lane in range(LANES):
                i, found = np.int64(s) * LANES + lane, 0
                neighbours[i] = 0
                if i >= count:
                    continue
                c = np.int64(cell[order[i]])
                x, y, z = c % nx, c // nx % ny, c // (nx * ny)
                for beside in range(3 if flat else 0, 6 if flat else 9):
                    j, l = y + beside % 3 - 1, z + beside // 3 - 1  # noqa: E741
                    if wraps_y:
                        j = (j + ny) % ny
                    if wraps_z:
                        l = (l + nz) % nz  # noqa: E741
                    if j < 0 or j >= ny or l < 0 or l >= nz:
                        continue
                    row = (l * ny + j) * nx
                    found = of_row(
                        i, lane, found, x, row, nx, room, place, starts, sides, support, wraps_x, own
                    )  # fmt: skip
                missed += max(found - most, 0)
                neighbours[i] = np.int32(min(found, most))
                longest[s] = max(longest[s], neighbours[i])
            for lane in range(LANES):
                for k in range(neighbours[np.int64(s) * LANES + lane], longest[s]):
                    own[k * LANES + lane] = np.int32(nobody)
        return missed

    return find
