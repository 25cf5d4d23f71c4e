"""Neighbour search of a fluid on CUDA: one thread per particle traverses the nine runs of three cells around its own
(three in a plane), in the order of places, and visits its neighbours.

It first stores one bit per candidate, WORD of them in a word: no branch, no store, four loads in flight at a time. Then
it visits the set bits. All threads of a warp visit their neighbour number s together, so their lists are written
contiguously, and sums over neighbours are computed in the same pass.

A particle's cell is the key under which it was sorted; it is not computed again, so this may be part of a kernel in
fast math.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.sort_kernels import DEPTH, HEIGHT, WIDTH, WRAPS
from softlab.model.base.types import Real
from softlab.model.formulas.fluid import density

WORD = 32  # candidates per word of bits
TOGETHER = 4  # candidates whose loads are in flight at a time
SLOTS = 2 if simulated() else 9  # words that a thread stores before it visits them: one for each run in space
LANES = 128  # threads per block at most: each has a column of slots


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


@cache
def _make_scales_of() -> Callable:
    @inlined("exact")
    def scales_of(p):
        return Scales(
            p.support, p.inverse_support, p.gradient_scale, p.sampled, p.side_x, p.half_x, p.side_y, p.half_y, p.side_z,
            p.half_z,
        )  # fmt: skip

    return scales_of


@cache
def make_offset(real: Real, math: str, repeats: frozenset[str]) -> Callable:
    """Make offset(p, q, parameters) -> (dx, dy, dz): vector from q to p (quads) [m], the shortest along periodic axes."""
    wrapped, inline = device_formulas(density, real, math).wrapped, inlined(math)
    along_x, along_y, along_z = "x" in repeats, "y" in repeats, "z" in repeats

    @inline
    def offset(p, q, parameters):
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        if along_x:
            dx = wrapped(dx, parameters.side_x, parameters.half_x)
        if along_y:
            dy = wrapped(dy, parameters.side_y, parameters.half_y)
        if along_z:
            dz = wrapped(dz, parameters.side_z, parameters.half_z)
        return dx, dy, dz

    return offset


@cache
def _make_steps() -> SimpleNamespace:
    """Make functions of the cells along an axis of `count`: `beside`, a neighbour, and pieces of a row of cells."""
    inline = inlined("exact")

    @inline
    def beside(place, direction, count, wraps):
        """Return the index `direction` (-1, 0, 1) cells on, or -1 if there is none."""
        neighbour = np.int32(place + direction)
        if neighbour < 0:
            return np.int32(count - 1) if wraps else np.int32(-1)
        if neighbour >= count:
            return np.int32(0) if wraps else np.int32(-1)
        return neighbour

    @inline
    def first_piece(place, count, wraps):
        """Return (first cell, count) of the cells around `place` along a row, up to the end of the row."""
        if place == 0:
            if wraps:
                return np.int32(count - 1), np.int32(1)
            return np.int32(0), np.int32(min(count, 2))
        return np.int32(place - 1), np.int32(min(count - place + 1, 3))

    @inline
    def second_piece(place, count, wraps):
        """Return (first cell, count) of those beyond the end of a periodic row; a count of 0 otherwise."""
        if wraps and place == 0:
            return np.int32(0), np.int32(2)
        return np.int32(0), np.int32(wraps and place == count - 1)

    return SimpleNamespace(beside=beside, first_piece=first_piece, second_piece=second_piece)


@cache
def _make_bits_within(real: Real, math: str, repeats: frozenset[str], solids: bool) -> Callable:
    """Make bits_within(k, p, e, end, position, parameters) -> (bits, first).

    The bits mark which particles from e to before `end`, WORD at most, are neighbours of particle k at p, one bit each
    from particle `first` on. With `solids`, two samples of solids are no neighbours.
    """
    formulas, offset = device_formulas(density, real, math), make_offset(real, math, repeats)
    squared, within, inline = formulas.squared, formulas.within, inlined(math)
    word, all_bits, together = np.int32(WORD), np.uint32(0xFFFFFFFF), np.int32(TOGETHER)
    none, one, two, four, eight = (np.uint32(bit) for bit in (0, 1, 2, 4, 8))

    @inline
    def bit_of(p, q, bit, parameters):
        dx, dy, dz = offset(p, q, parameters)
        if solids and p[3] == parameters.sampled and q[3] == parameters.sampled:
            return none
        return bit if within(squared(dx, dy, dz), parameters.support) else none

    @inline
    def bits_within(k, p, e, end, position, parameters):
        # the last TOGETHER before `end` are loaded unshifted, so that loads are at fixed offsets from each other
        last = np.int32(max(end - together, 0))
        first, bits = np.int32(min(e, last)), none
        begin = first
        while begin < end:
            g = min(begin, last)
            q, r = load_quad(position, g), load_quad(position, np.int32(g + 1))
            s, t = load_quad(position, np.int32(g + 2)), load_quad(position, np.int32(g + 3))
            bits_here = np.uint32(
                bit_of(p, q, one, parameters) | bit_of(p, r, two, parameters) | bit_of(p, s, four, parameters)
                | bit_of(p, t, eight, parameters)
            )  # fmt: skip
            bits = np.uint32(bits | bits_here << np.uint32(g - first))
            begin = np.int32(begin + together)
        # bits before e or behind the run, if it is shorter than TOGETHER, belong to another run
        bits = np.uint32(bits & (all_bits << np.uint32(e - first)))
        bits = np.uint32(bits & (all_bits >> np.uint32(max(word - (end - first), 0))))
        if first <= k and k < end:
            bits = np.uint32(bits & ~(one << np.uint32(k - first)))
        return bits, first

    return bits_within


@cache
def make_search(
    real: Real,
    math: str,
    axes: int,
    neighbours: int,
    repeats: frozenset[str],
    visit: Callable,
    begun: Callable,
    solids: bool = False,
) -> Callable:
    """Make search(k, p, position, parameters, key, numbers, begins, table, particles, lost, fluids).

    It returns (number of neighbours in the list of particle k at p, at most `neighbours`; sums over them); the others
    are counted in `lost`. `begun`: initial sums; visit(sums, k, p, j, position, fluids, parameters) returns the sums
    with neighbour j. In exact math the lists equal the CPU's. For blocks of LANES threads at most.
    """
    whole, bits_within, scales_of = _make_steps(), _make_bits_within(real, math, repeats, solids), _make_scales_of()
    beside, first_piece, second_piece = whole.beside, whole.first_piece, whole.second_piece
    most, one, rows, solid, goes_round = np.int32(neighbours), np.int32(1), 3 ** (axes - 1), axes == 3, "x" in repeats
    pieces = np.int32(rows * (2 if goes_round else 1))
    slots, lanes, capacity, word = np.int32(SLOTS), np.int32(LANES), SLOTS * LANES, np.int32(WORD)

    @inlined("exact")
    def run(piece, x, y, z, numbers, begins):
        """Return (first, end) of the particles of a piece of the rows of cells around (x, y, z)."""
        width, height = numbers[WIDTH], numbers[HEIGHT]
        row = np.int32(piece >> 1) if goes_round else np.int32(piece)
        cz, cy = z, beside(y, np.int32(row % 3 - 1), height, numbers[WRAPS + 1] > 0)
        if solid:
            cz = beside(z, np.int32(row // 3 - 1), numbers[DEPTH], numbers[WRAPS + 2] > 0)
        cell, cells = first_piece(x, width, goes_round)
        if goes_round and piece & 1:
            cell, cells = second_piece(x, width, goes_round)
        if cy < 0 or cz < 0 or cells < 1:
            return np.int32(0), np.int32(0)
        cell = np.uint32((cz * height + cy) * width + cell)
        return np.int32(begins[cell]), np.int32(begins[cell + np.uint32(cells)])

    @inlined("exact")
    def search(k, p, position, parameters, key, numbers, begins, table, particles, lost, fluids):
        words = cuda.shared.array(capacity, np.uint32)  # a line each: the simulator identifies arrays by it
        firsts = cuda.shared.array(capacity, np.int32)
        lane, line = np.uint32(cuda.threadIdx.x), np.int32(key // numbers[WIDTH])
        x, z = np.int32(key - line * numbers[WIDTH]), np.int32(line // numbers[HEIGHT])
        y = np.int32(line - z * numbers[HEIGHT])
        count, at, sums, scales = np.int32(0), np.uint64(k), begun, scales_of(parameters)
        piece, e, end = np.int32(0), np.int32(0), np.int32(0)
        while piece < pieces or e < end:
            stored, place = np.int32(0), lane
            while stored < slots and (piece < pieces or e < end):
                if e >= end:
                    e, end = run(piece, x, y, z, numbers, begins)
                    piece = np.int32(piece + one)
                if e < end:
                    stop = min(np.int32(e + word), end)
                    bits, first = bits_within(k, p, e, stop, position, scales)
                    e = stop
                    if bits != 0:
                        words[place], firsts[place] = bits, first
                        stored, place = np.int32(stored + one), np.uint32(place + np.uint32(lanes))
            place, bits, first = lane, np.uint32(0), np.int32(0)
            while stored > 0:
                if bits == 0:
                    bits, first = words[place], firsts[place]
                j = np.int32(first + cuda.ffs(bits) - one)
                bits = np.uint32(bits & (bits - np.uint32(1)))
                if bits == 0:
                    stored, place = np.int32(stored - one), np.uint32(place + np.uint32(lanes))
                if count < most:
                    table[at] = j
                    at = np.uint64(at + np.uint64(particles))
                    sums = visit(sums, k, p, j, position, fluids, scales)
                count = np.int32(count + one)
        if count > most:
            cuda.atomic.add(lost, 0, np.int64(count - most))
            count = most
        return count, sums

    return search
