"""Neighbour lists of a fluid, for CPU threads (model/fluid/plan.py, 3).

Lists are stored by slices of LANES consecutive particles: entry k of all lanes, then entry k + 1. A list that is
shorter than another one of its slice is padded with `nobody`, a particle so far away that it adds 0 to every sum. So
loops over lanes are vectors, and each lane sums in the order of its own list.

Indices of entries are unsigned where many are written: for a signed index numba first checks whether it is negative.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.bits import WORD, bits_below, bits_of, lowest_bit, without, without_lowest
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.formulas.fluid.density import squared, wrapped

AROUND = 1024  # capacity for the particles of 27 cells; more are processed in batches
RUNS = 64  # numbers: the ends of the runs around a cell
FAR = 1e15  # m: coordinate of `nobody`; its square is finite in float32
TOGETHER = 12  # bits handled in one pass, even if fewer are left


@routine
def wrap(dx, dy, dz, sides):
    """Return the shortest difference in a periodic box; `sides`: Sides of arrays.py."""
    if FEATURE.repeats:
        dx, dy = wrapped(dx, sides.x, sides.half_x), wrapped(dy, sides.y, sides.half_y)
        if FEATURE.axes == 3:
            dz = wrapped(dz, sides.z, sides.half_z)
    return dx, dy, dz


@row_routine
def distances(x, y, z, sides, xs, ys, zs, squares):
    """Write the squares of the distances of WORD particles from a position."""
    for k in range(WORD):
        dx, dy, dz = wrap(x - xs[k], y - ys[k], z - zs[k], sides)
        squares[k] = squared(dx, dy, dz)


@routine
def picked(i, self_index, lane, neighbour_count, many, around, limit, sides, entries, world):
    """Append to the list of i those of the `many` gathered particles that are near; i is number `self_index` among them.

    `limit`: square of the support radius. Returns the number of neighbours so far.
    """
    near_x, near_y, near_z, squares, who, _ = around
    fluid, sampled = world.in_order.fluid, np.int32(world.parameters.sampled)
    place, capacity = world.in_order.position, world.sizes.capacity
    x, y, z = place[i], place[capacity + i], place[2 * capacity + i]
    for first in range(0, many, WORD):
        at = np.int64(first)
        distances(x, y, z, sides, row_at(near_x, at), row_at(near_y, at), row_at(near_z, at), squares)
        near = without(bits_below(squares, np.int64(0), limit), np.int64(self_index - first))
        end = neighbour_count + bits_of(near)
        if FEATURE.solids or end + TOGETHER > FEATURE.neighbours:
            while near != 0:
                j = who[first + lowest_bit(near)]
                near = without_lowest(near)
                if FEATURE.solids and fluid[i] == sampled and fluid[j] == sampled:
                    continue  # two samples of solids are no neighbours
                if neighbour_count < FEATURE.neighbours:
                    entries[neighbour_count * LANES + lane] = j
                neighbour_count += 1
            continue
        for k in range(
            neighbour_count, end, TOGETHER
        ):  # numbers behind the last entry are overwritten by the next ones
            for n in range(TOGETHER):
                entries[np.uint64((k + n) * LANES + lane)] = who[np.uint64(first + lowest_bit(near))]
                near = without_lowest(near)
        neighbour_count = end
    return neighbour_count


@routine
def runs_around(c, nx, ny, nz, starts, sides, runs):
    """Write the ends of the runs of particles in the 27 cells around cell c into `runs`. Returns their number."""
    x, y, z, n = c % nx, c // nx % ny, c // (nx * ny), 0
    wraps_x = wraps_y = wraps_z = False
    if FEATURE.repeats:
        wraps_x, wraps_y, wraps_z = sides.x > 0.0, sides.y > 0.0, sides.z > 0.0
    begin, end = max(x - 1, 0), min(x + 2, nx)
    for beside in range(3 if FEATURE.axes == 2 else 0, 6 if FEATURE.axes == 2 else 9):
        j, l = y + beside % 3 - 1, z + beside // 3 - 1  # noqa: E741
        if wraps_y:
            j = (j + ny) % ny
        if wraps_z:
            l = (l + nz) % nz  # noqa: E741
        if j < 0 or j >= ny or l < 0 or l >= nz:
            continue
        row = (l * ny + j) * nx
        if wraps_x and x == 0:
            runs[n], runs[n + 1] = starts[row + nx - 1], starts[row + nx]
            n += 2
        runs[n], runs[n + 1] = starts[row + begin], starts[row + end]
        n += 2
        if wraps_x and x == nx - 1:
            runs[n], runs[n + 1] = starts[row], starts[row + 1]
            n += 2
    return n


@row_routine
def copied(many, first, x, y, z, near_x, near_y, near_z, who):
    for k in range(many):
        near_x[k], near_y[k], near_z[k], who[k] = x[k], y[k], z[k], np.int32(first + k)


@routine
def gathered(k, begin, end, capacity, place, near_x, near_y, near_z, who):
    """Copy the positions `begin` to before `end` to index k on. Returns the new number of gathered particles."""
    first = np.int64(begin)
    copied(
        end - begin, first, row_at(place, first), row_at(place, capacity + first), row_at(place, 2 * capacity + first),
        row_at(near_x, k), row_at(near_y, k), row_at(near_z, k), row_at(who, k),
    )  # fmt: skip
    return k + np.int64(end - begin)


@routine
def pad_gathered(many, near_x):
    """Pad the gathered particles with `nobody` to a multiple of WORD."""
    for k in range(many, (many + WORD - 1) // WORD * WORD):
        near_x[k] = FAR


@row_routine
def pad_lists(longest, nobody, neighbours, entries):
    """Pad the lists of a slice with `nobody`."""
    shortest = longest
    for lane in range(LANES):
        shortest = min(shortest, np.int64(neighbours[lane]))
    for k in range(shortest, longest):
        for lane in range(LANES):
            here = np.uint64(k * LANES + lane)
            entries[here] = nobody if neighbours[lane] <= k else entries[here]


@routine
def find_neighbours(first, last, world, cells, sides, parameters, around):
    """Build the lists of the slices `first` to before `last`. Return the number of neighbours that did not fit.

    `cells`: counts along x, y, z. `around`: Around of arrays.py.
    """
    count, capacity, table = world.sizes.particles, world.sizes.capacity, world.table
    place, neighbours, longest = world.in_order.position, world.lists.neighbours, world.lists.longest
    near_x, near_y, near_z, _, who, runs = around
    limit, missed = squared(parameters.support, 0.0, 0.0), 0
    nx, ny, nz = cells
    known, ends, many, self_offset, holds = np.int64(-1), 0, np.int64(0), np.int64(0), True
    for s in range(first, last):
        entry_row = row_at(world.lists.entries, np.int64(s) * (LANES * FEATURE.neighbours))
        longest[s] = 0
        for lane in range(LANES):
            i, neighbour_count = np.int64(s) * LANES + lane, 0
            neighbours[i] = 0
            if i >= count:
                continue
            c = np.int64(table.cell[table.order[i]])
            if c != known:
                known, ends, total = c, runs_around(c, nx, ny, nz, table.starts, sides, runs), np.int64(0)
                for n in range(0, ends, 2):
                    total += runs[n + 1] - runs[n]
                many, holds = np.int64(0), bool(total <= AROUND)
                if holds:
                    for n in range(0, ends, 2):
                        if runs[n] <= i and i < runs[n + 1]:
                            self_offset = many - np.int64(runs[n])
                        many = gathered(many, runs[n], runs[n + 1], capacity, place, near_x, near_y, near_z, who)
                    pad_gathered(many, near_x)
            if holds:
                neighbour_count = picked(
                    i, i + self_offset, lane, neighbour_count, many, around, limit, sides, entry_row, world
                )
            else:  # in batches of AROUND particles
                for n in range(0, ends, 2):
                    for begin in range(runs[n], runs[n + 1], AROUND):
                        end = min(begin + AROUND, runs[n + 1])
                        many = gathered(np.int64(0), begin, end, capacity, place, near_x, near_y, near_z, who)
                        pad_gathered(many, near_x)
                        neighbour_count = picked(
                            i, i - np.int64(begin), lane, neighbour_count, many, around, limit, sides, entry_row, world
                        )
            missed += max(neighbour_count - FEATURE.neighbours, 0)
            neighbours[i] = np.int32(min(neighbour_count, FEATURE.neighbours))
            longest[s] = max(longest[s], neighbours[i])
        pad_lists(
            np.int64(longest[s]), np.int32(world.sizes.nobody), row_at(neighbours, np.int64(s) * LANES), entry_row
        )
    return missed
