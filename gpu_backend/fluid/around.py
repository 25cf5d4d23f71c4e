"""What lies around the particles of a block, in the block's shared memory: there each neighbour is a load of its own, while
of the caches eight threads that ask for 16 bytes each are served a line of 128 bytes at a time, and ask for five of them.

Particles that follow each other lie in cells that do; and so do, in each of the rows around (nine, in a plane three), the
cells that they ask. So what a block may ask for are as many runs of places, which it reads once. Where that is more than
there is room for, or sides repeat, all is read from where it lies.

An entry of a list is a place and, in its highest bits, the row around in which it was found, so that it is known where it
lies among what was read.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined
from gpu_backend.core.device import simulated
from gpu_backend.core.quads import SIZE, load_quad, store_quad
from gpu_backend.fluid.sort_kernels import CELLS, HEIGHT, WIDTH

ROW_BIT = 28  # of an entry, from which on its row is told
PLACE = (1 << ROW_BIT) - 1
TOGETHER = 4  # candidates whose loads are on their way at a time
BYTES = 24 * 1024  # of shared memory for quads
SIMULATED_ROOM = 200  # quads: some blocks of small scenes find room, and some do not
ALIGNMENT = None if simulated() else 16  # of a quad in one access; the simulator knows none
WARP = 32


class Around(NamedTuple):
    """`position`: all quads; where `fits`, what lies around the block is in `quads`, and place i of row r is i +
    shifts[r]."""

    position: Any
    quads: Any
    shifts: Any
    fits: Any


def rows_around(axes: int) -> int:
    """How many rows of cells there are around one, itself among them."""
    return int(3 ** (axes - 1))


@inlined("exact")
def place_of(entry):
    """Of a list."""
    return np.int32(entry & np.uint32(PLACE))


@inlined("exact")
def read_in_place(position):
    """What lies around, where it lies."""
    return Around(position, None, None, False)


@cache
def make_around(real: Any, axes: int, staged: bool) -> SimpleNamespace:
    """`around(position, keys, numbers, begins, there)` -> Around, for a block of consecutive particles, to be called by all
    of its threads; `quad_of(around, entry)`; `four_of(around, place, row)`: quads of four places that
    follow each other. Not `staged`: everything is read from where it lies."""
    row_bit, inline = np.uint32(ROW_BIT), inlined("exact")

    @inline
    def around_nobody(position, keys, numbers, begins, there):
        return read_in_place(position)

    @inline
    def quad_of(around, entry):
        if staged and around.fits:
            return load_quad(around.quads, np.int32(place_of(entry) + around.shifts[entry >> row_bit]))
        return load_quad(around.position, place_of(entry))

    @inline
    def four_of(around, place, row):
        if staged and around.fits:
            at, quads = np.int32(place + around.shifts[np.uint32(row)]), around.quads
            return (
                load_quad(quads, at), load_quad(quads, np.int32(at + 1)), load_quad(quads, np.int32(at + 2)),
                load_quad(quads, np.int32(at + 3)),
            )  # fmt: skip
        quads = around.position
        return (
            load_quad(quads, place), load_quad(quads, np.int32(place + 1)), load_quad(quads, np.int32(place + 2)),
            load_quad(quads, np.int32(place + 3)),
        )  # fmt: skip

    around = _make_block(real, axes) if staged else around_nobody
    return SimpleNamespace(around=around, quad_of=quad_of, four_of=four_of)


def _make_block(real: Any, axes: int) -> Any:
    """`around` of a block that reads what lies around."""
    rows, room = rows_around(axes), SIMULATED_ROOM if simulated() else BYTES // (SIZE * np.dtype(real).itemsize)
    scalars, row_count, rows_and_one = SIZE * room, np.uint32(rows), rows + 1
    inline, margin, one, width_of = inlined("exact"), np.int32(TOGETHER), np.int32(1), np.int32(3)
    warp, warp_bits, most, centre = np.int32(WARP), np.uint32(5), np.int32(room - TOGETHER), np.int32(axes == 3)

    @inline
    def run_of(row, first, last, numbers, begins):
        """(begin, end) of the places that particles in the cells `first` to `last` ask in a row around them."""
        offset = np.int32((row // width_of - centre) * numbers[HEIGHT] + (row % width_of) - one) * numbers[WIDTH]
        low, high = max(first + offset - 1, 0), min(last + offset + 2, numbers[CELLS])
        if low >= high:
            return np.int32(0), np.int32(0)
        return np.int32(begins[np.uint64(low)]), np.int32(begins[np.uint64(high)])

    @inline
    def read_row(position, quads, at, end, shift):
        """A row's quads, those from `at` to before `end` among `quads`, by a warp: five of each lane on their way at a
        time, which is what a block of LANES threads usually has in a row."""
        last = np.int32(end - one)
        while at < end:
            b, c = min(np.int32(at + warp), last), min(np.int32(at + 2 * warp), last)
            d, e = min(np.int32(at + 3 * warp), last), min(np.int32(at + 4 * warp), last)
            p, q = load_quad(position, np.int32(at - shift)), load_quad(position, np.int32(b - shift))
            r, s = load_quad(position, np.int32(c - shift)), load_quad(position, np.int32(d - shift))
            t = load_quad(position, np.int32(e - shift))
            store_quad(quads, at, p[0], p[1], p[2], p[3])
            store_quad(quads, b, q[0], q[1], q[2], q[3])
            store_quad(quads, c, r[0], r[1], r[2], r[3])
            store_quad(quads, d, s[0], s[1], s[2], s[3])
            store_quad(quads, e, t[0], t[1], t[2], t[3])
            at = np.int32(at + 5 * warp)

    @inline
    def around_block(position, keys, numbers, begins, there):
        quads = cuda.shared.array(scalars, real, alignment=ALIGNMENT)
        shifts = cuda.shared.array(rows, np.int32)
        bounds = cuda.shared.array(rows_and_one, np.int32)  # where rows begin among `quads`, and the last one ends
        t, threads = np.uint32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        first = np.int32(cuda.blockIdx.x * threads)
        last, begin, end, before = min(np.int32(first + threads), there), np.int32(0), np.int32(0), margin
        if t < row_count and first < last:
            begin, end = run_of(np.int32(t), keys[first], keys[np.int32(last - one)], numbers, begins)
        if t < row_count:
            shifts[t] = np.int32(end - begin)
        cuda.syncthreads()
        for row in range(rows):
            if row < t:
                before += shifts[np.uint32(row)]
        cuda.syncthreads()
        if t < row_count:
            shifts[t] = np.int32(before - begin)
        if t <= row_count:
            bounds[t] = before
        cuda.syncthreads()
        fits = bounds[row_count] <= most
        if fits:
            row, lane = np.uint32(t >> warp_bits), np.int32(t & (np.uint32(warp) - np.uint32(1)))
            while row < row_count:
                begin, end = bounds[row], bounds[np.uint32(row + np.uint32(1))]
                read_row(position, quads, np.int32(begin + lane), end, shifts[row])
                row = np.uint32(row + np.uint32(max(threads // warp, 1)))
        cuda.syncthreads()
        return Around(position, quads, shifts, fits)

    return around_block
