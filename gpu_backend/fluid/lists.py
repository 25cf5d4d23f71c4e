"""Who is within a fluid's support of whom, on CUDA: a thread a particle walks the nine runs of three cells around its own (in
a plane three), in the order of places, and keeps whom it finds."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad
from gpu_backend.fluid.sort_kernels import DEPTH, HEIGHT, WIDTH, WRAPS, make_place
from model.formulas import fluid_cells, particle_contact


@cache
def make_lists(real: Any, axes: int, neighbours: int) -> SimpleNamespace:
    """`find(position, record, reals, numbers, begins, table, found, lost)`: at most `neighbours` of each."""
    place_of, whole = make_place(real), fluid_cells.make_numbers(inlined("exact"))
    beside, first_piece, second_piece = whole.beside, whole.first_piece, whole.second_piece
    formulas = device_formulas(particle_contact.make, real, "exact")
    squared, within = formulas.squared, formulas.within
    most, one, rows = np.int32(neighbours), np.int32(1), 3 ** (axes - 1)
    solid = axes == 3

    def find(position, record, reals, numbers, begins, table, found, lost):
        k, particles = np.int32(cuda.grid(1)), np.int32(found.size)
        if k < particles:
            support = record[0].support
            p = load_quad(position, k)
            x, y, z = place_of(p, reals, numbers)
            width, wraps = numbers[WIDTH], numbers[WRAPS] > 0
            count, at = np.int32(0), np.int64(k)
            for row in range(rows):
                cz, cy = z, beside(y, np.int32(row % 3 - 1), numbers[HEIGHT], numbers[WRAPS + 1] > 0)
                if solid:
                    cz = beside(z, np.int32(row // 3 - 1), numbers[DEPTH], numbers[WRAPS + 2] > 0)
                if cy >= 0 and cz >= 0:
                    base = np.int32((cz * numbers[HEIGHT] + cy) * width)
                    piece = first_piece(x, width, wraps)
                    for _ in range(2):
                        first = np.int32(base + piece[0])
                        if piece[1] > 0:
                            for e in range(begins[first], begins[first + piece[1]]):
                                q = load_quad(position, e)
                                if within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), support) and e != k:
                                    if count < most:
                                        table[at] = e
                                        at += particles
                                    count = np.int32(count + one)
                        piece = second_piece(x, width, wraps)
            if count > most:
                cuda.atomic.add(lost, 0, np.int64(count - most))
                count = most
            found[k] = count

    return make_kernels((find,), f"fluid_lists_{variant_name(real, axes)}", **kernel_options("exact"))
