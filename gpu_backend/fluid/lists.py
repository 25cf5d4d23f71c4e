"""Who is within a fluid's support of whom, on CUDA: a thread a particle walks the nine runs of three cells around its own (in
a plane three), in the order of places, and keeps whom it finds.

A particle's cell is the key under which it was sorted, not asked again: so this may be part of a kernel in fast math.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad
from gpu_backend.fluid.sort_kernels import DEPTH, HEIGHT, WIDTH, WRAPS
from model.formulas.fluid import density


@cache
def make_ways(real: Any, math: str, repeats: frozenset[str]) -> Any:
    """way(p, q, parameters) -> (dx, dy, dz): from q to p (quads) [m], the shortest along axes that repeat."""
    wrapped, inline = device_formulas(density.make, real, math).wrapped, inlined(math)
    along_x, along_y, along_z = "x" in repeats, "y" in repeats, "z" in repeats

    @inline
    def way(p, q, parameters):
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        if along_x:
            dx = wrapped(dx, parameters.side_x, parameters.half_x)
        if along_y:
            dy = wrapped(dy, parameters.side_y, parameters.half_y)
        if along_z:
            dz = wrapped(dz, parameters.side_z, parameters.half_z)
        return dx, dy, dz

    return way


@cache
def _make_steps() -> SimpleNamespace:
    """From a cell's place along an axis of `count` to those beside it: `beside`, and pieces of a row of cells."""
    inline = inlined("exact")

    @inline
    def beside(place, way, count, wraps):
        """The place `way` (-1, 0, 1) cells on, or -1 where there is none."""
        found = np.int32(place + way)
        if found < 0:
            return np.int32(count - 1) if wraps else np.int32(-1)
        if found >= count:
            return np.int32(0) if wraps else np.int32(-1)
        return found

    @inline
    def first_piece(place, count, wraps):
        """(first cell, how many) of those around `place` along a row, up to where the row ends and begins anew."""
        if place == 0:
            if wraps:
                return np.int32(count - 1), np.int32(1)
            return np.int32(0), np.int32(min(count, 2))
        return np.int32(place - 1), np.int32(min(count - place + 1, 3))

    @inline
    def second_piece(place, count, wraps):
        """(first cell, how many) of those behind the row's end; none where the row does not wrap, or goes on."""
        if wraps and place == 0:
            return np.int32(0), np.int32(2)
        return np.int32(0), np.int32(wraps and place == count - 1)

    return SimpleNamespace(beside=beside, first_piece=first_piece, second_piece=second_piece)


@cache
def make_search(real: Any, axes: int, neighbours: int, repeats: frozenset[str], solids: bool = False) -> Any:
    """search(k, p, position, parameters, key, numbers, begins, table, lost) -> how many neighbours particle k at p has in its
    list now, `neighbours` at most; the others are counted in `lost`; with `solids`, two
    samples of solids are none. In exact math, so that lists are the CPU's."""
    whole, way = _make_steps(), make_ways(real, "exact", repeats)
    beside, first_piece, second_piece = whole.beside, whole.first_piece, whole.second_piece
    formulas = device_formulas(density.make, real, "exact")
    squared, within = formulas.squared, formulas.within
    most, one, rows, solid, together = np.int32(neighbours), np.int32(1), 3 ** (axes - 1), axes == 3, np.int32(4)

    @inlined("exact")
    def keep(k, p, e, q, end, parameters, table, particles, count, at):
        """The list with particle e at q, if that is a neighbour and before the run's end: how many there are, and where the
        next one belongs."""
        dx, dy, dz = way(p, q, parameters)
        if solids and p[3] == parameters.sampled and q[3] == parameters.sampled:
            return count, at
        if within(squared(dx, dy, dz), parameters.support) and e != k and e < end:
            if count < most:
                table[at] = e
                at += particles
            count = np.int32(count + one)
        return count, at

    @inlined("exact")
    def search(k, p, position, parameters, key, numbers, begins, table, particles, lost):
        width, height, wraps = numbers[WIDTH], numbers[HEIGHT], numbers[WRAPS] > 0
        line = np.int32(key // width)
        x, z = np.int32(key - line * width), np.int32(line // height)
        y = np.int32(line - z * height)
        first_run, last_run = first_piece(x, width, wraps), second_piece(x, width, wraps)
        count, at = np.int32(0), np.int64(k)
        for row in range(rows):
            cz, cy = z, beside(y, np.int32(row % 3 - 1), height, numbers[WRAPS + 1] > 0)
            if solid:
                cz = beside(z, np.int32(row // 3 - 1), numbers[DEPTH], numbers[WRAPS + 2] > 0)
            if cy >= 0 and cz >= 0:
                base = np.int32((cz * height + cy) * width)
                cell, cells = np.int32(base + first_run[0]), first_run[1]
                while cells > 0:
                    end = np.int32(begins[cell + cells])
                    for e in range(np.int32(begins[cell]), end, together):
                        # four loads are on their way before the first is waited for: none may pass a store to the list
                        e, last = np.int32(e), np.int32(end - one)
                        f, g, h = min(np.int32(e + 1), last), min(np.int32(e + 2), last), min(np.int32(e + 3), last)
                        q, r, s, t = (
                            load_quad(position, e), load_quad(position, f), load_quad(position, g), load_quad(position, h),
                        )  # fmt: skip
                        count, at = keep(k, p, e, q, end, parameters, table, particles, count, at)
                        count, at = keep(k, p, np.int32(e + 1), r, end, parameters, table, particles, count, at)
                        count, at = keep(k, p, np.int32(e + 2), s, end, parameters, table, particles, count, at)
                        count, at = keep(k, p, np.int32(e + 3), t, end, parameters, table, particles, count, at)
                    # what is left of the three cells lies at the row's other end
                    cells = last_run[1] if cell == base + first_run[0] else np.int32(0)
                    cell = np.int32(base + last_run[0])
        if count > most:
            cuda.atomic.add(lost, 0, np.int64(count - most))
            count = most
        return count

    return search
