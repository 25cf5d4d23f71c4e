"""Neighbour search of a fluid on CUDA: one thread per particle traverses the nine runs of three cells around its own
(three in a plane), in the order of places, and visits its neighbours.

It first stores one bit per candidate, WORD of them in a word: no branch, no store, four loads in flight at a time. Then
it visits the set bits. All threads of a warp visit their neighbour number s together, so their lists are written
contiguously, and sums over neighbours are computed in the same pass.

A particle's cell is the key under which it was sorted; it is not computed again, so this may be part of a kernel in
fast math.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, simulated
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.sort_kernels import DEPTH, HEIGHT, WIDTH, WRAPS
from softlab.model.base.variant import FEATURE, Open, inlined_routine, open_constant
from softlab.model.formulas.fluid.density import squared, within, wrapped

WORD = 32  # candidates per word of bits
TOGETHER = 4  # candidates whose loads are in flight at a time
SLOTS = 2 if simulated() else 9  # words that a thread stores before it visits them: one for each run in space
LANES = 128  # threads per block at most: each has a column of slots
WORDS = SLOTS * LANES  # of a block
ALL_BITS = np.uint32(0xFFFFFFFF)

begun = open_constant("the sums without any neighbour")
visit = Open("visit(sums, k, p, j, position, fluids, parameters): the sums with neighbour j")


class Grid(NamedTuple):
    """The cell of a particle in the grid: its key, counts of cells, and the first particle of each cell."""

    key: Any
    numbers: DeviceArray
    begins: DeviceArray


class Scales(NamedTuple):
    """Constants of a visit, in registers: after a store to a list they would be loaded again."""

    support: float
    inverse_support: float
    gradient_scale: float
    sampled: float
    side_x: float
    half_x: float
    side_y: float
    half_y: float
    side_z: float
    half_z: float


@inlined_routine
def scales_of(p):
    return Scales(
        p.support, p.inverse_support, p.gradient_scale, p.sampled, p.side_x, p.half_x, p.side_y, p.half_y, p.side_z,
        p.half_z,
    )  # fmt: skip


@inlined_routine
def offset(p, q, parameters):
    """Return the vector from q to p (quads) [m], the shortest along periodic axes."""
    dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    if FEATURE.periodic_x:
        dx = wrapped(dx, parameters.side_x, parameters.half_x)
    if FEATURE.periodic_y:
        dy = wrapped(dy, parameters.side_y, parameters.half_y)
    if FEATURE.periodic_z:
        dz = wrapped(dz, parameters.side_z, parameters.half_z)
    return dx, dy, dz


@inlined_routine
def beside(place, direction, count, wraps):
    """Return the index `direction` (-1, 0, 1) cells on from `place` of `count`, or -1 if there is none."""
    neighbour = np.int32(place + direction)
    if neighbour < 0:
        return np.int32(count - 1) if wraps else np.int32(-1)
    if neighbour >= count:
        return np.int32(0) if wraps else np.int32(-1)
    return neighbour


@inlined_routine
def first_piece(place, count, wraps):
    """Return (first cell, count) of the cells around `place` along a row, up to the end of the row."""
    if place == 0:
        if wraps:
            return np.int32(count - 1), np.int32(1)
        return np.int32(0), np.int32(min(count, 2))
    return np.int32(place - 1), np.int32(min(count - place + 1, 3))


@inlined_routine
def second_piece(place, count, wraps):
    """Return (first cell, count) of those beyond the end of a periodic row; a count of 0 otherwise."""
    if wraps and place == 0:
        return np.int32(0), np.int32(2)
    return np.int32(0), np.int32(wraps and place == count - 1)


@inlined_routine
def bit_of(p, q, bit, parameters):
    dx, dy, dz = offset(p, q, parameters)
    if FEATURE.solids and p[3] == parameters.sampled and q[3] == parameters.sampled:
        return np.uint32(0)
    return bit if within(squared(dx, dy, dz), parameters.support) else np.uint32(0)


@inlined_routine
def bits_within(k, p, e, end, position, parameters):
    """Return (bits, first): the bits mark which particles from e to before `end`, WORD at most, are neighbours of
    particle k at p, one bit each from particle `first` on. Two samples of solids are no neighbours."""
    # the last TOGETHER before `end` are loaded unshifted, so that loads are at fixed offsets from each other
    last = np.int32(max(end - TOGETHER, 0))
    first, bits = np.int32(min(e, last)), np.uint32(0)
    begin = first
    while begin < end:
        g = min(begin, last)
        q, r = load_quad(position, g), load_quad(position, np.int32(g + 1))
        s, t = load_quad(position, np.int32(g + 2)), load_quad(position, np.int32(g + 3))
        bits_here = np.uint32(
            bit_of(p, q, np.uint32(1), parameters) | bit_of(p, r, np.uint32(2), parameters)
            | bit_of(p, s, np.uint32(4), parameters) | bit_of(p, t, np.uint32(8), parameters)
        )  # fmt: skip
        bits = np.uint32(bits | bits_here << np.uint32(g - first))
        begin = np.int32(begin + TOGETHER)
    # bits before e or behind the run, if it is shorter than TOGETHER, belong to another run
    bits = np.uint32(bits & (ALL_BITS << np.uint32(e - first)))
    bits = np.uint32(bits & (ALL_BITS >> np.uint32(max(WORD - (end - first), 0))))
    if first <= k and k < end:
        bits = np.uint32(bits & ~(np.uint32(1) << np.uint32(k - first)))
    return bits, first


@inlined_routine
def run(piece, x, y, z, numbers, begins):
    """Return (first, end) of the particles of a piece of the rows of cells around (x, y, z)."""
    width, height = numbers[WIDTH], numbers[HEIGHT]
    row = np.int32(piece >> 1) if FEATURE.periodic_x else np.int32(piece)
    cz, cy = z, beside(y, np.int32(row % 3 - 1), height, numbers[WRAPS + 1] > 0)
    if FEATURE.axes == 3:
        cz = beside(z, np.int32(row // 3 - 1), numbers[DEPTH], numbers[WRAPS + 2] > 0)
    cell, cells = first_piece(x, width, FEATURE.periodic_x)
    if FEATURE.periodic_x and piece & 1:
        cell, cells = second_piece(x, width, FEATURE.periodic_x)
    if cy < 0 or cz < 0 or cells < 1:
        return np.int32(0), np.int32(0)
    cell = np.uint32((cz * height + cy) * width + cell)
    return np.int32(begins[cell]), np.int32(begins[cell + np.uint32(cells)])


@inlined_routine
def search(k, p, position, parameters, grid, table, particles, lost, fluids):
    """Return (number of neighbours in the list of particle k at p, at most FEATURE.neighbours; sums over them).

    The others are counted in `lost`. In exact math the lists equal the CPU's. For blocks of LANES threads at most.
    """
    words = cuda.shared.array(WORDS, np.uint32)  # a line each: the simulator identifies arrays by it
    firsts = cuda.shared.array(WORDS, np.int32)
    key, numbers, begins = grid
    lane, line = np.uint32(cuda.threadIdx.x), np.int32(key // numbers[WIDTH])
    x, z = np.int32(key - line * numbers[WIDTH]), np.int32(line // numbers[HEIGHT])
    y = np.int32(line - z * numbers[HEIGHT])
    count, at, sums, scales = np.int32(0), np.uint64(k), begun, scales_of(parameters)
    piece, e, end = np.int32(0), np.int32(0), np.int32(0)
    pieces = (9 if FEATURE.axes == 3 else 3) * (2 if FEATURE.periodic_x else 1)
    while piece < pieces or e < end:
        stored, place = np.int32(0), lane
        while stored < SLOTS and (piece < pieces or e < end):
            if e >= end:
                e, end = run(piece, x, y, z, numbers, begins)
                piece = np.int32(piece + 1)
            if e < end:
                stop = min(np.int32(e + WORD), end)
                bits, first = bits_within(k, p, e, stop, position, scales)
                e = stop
                if bits != 0:
                    words[place], firsts[place] = bits, first
                    stored, place = np.int32(stored + 1), np.uint32(place + np.uint32(LANES))
        place, bits, first = lane, np.uint32(0), np.int32(0)
        while stored > 0:
            if bits == 0:
                bits, first = words[place], firsts[place]
            j = np.int32(first + cuda.ffs(bits) - 1)
            bits = np.uint32(bits & (bits - np.uint32(1)))
            if bits == 0:
                stored, place = np.int32(stored - 1), np.uint32(place + np.uint32(LANES))
            if count < FEATURE.neighbours:
                table[at] = j
                at = np.uint64(at + np.uint64(particles))
                sums = visit(sums, k, p, j, position, fluids, scales)
            count = np.int32(count + 1)
    if count > FEATURE.neighbours:
        cuda.atomic.add(lost, 0, np.int64(count - FEATURE.neighbours))
        count = np.int32(FEATURE.neighbours)
    return count, sums
