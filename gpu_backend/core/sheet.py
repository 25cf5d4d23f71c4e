"""Blocks of threads over the rows and columns of a sheet."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import SIZE, load_quad
from softlab.gpu_backend.core.world import Cell
from softlab.model.formulas import cloth, lengths

BLOCK = (32, 8)  # threads along a row, down the columns
MAX_BLOCKS_DOWN = 65535  # CUDA's limit of a grid's second dimension


@cache
def make_place(math: str) -> Any:
    """Make place() -> (i, j) of the thread in the lattice of its launch."""

    @inlined(math)
    def place():
        return (
            np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y),
            np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x),
        )

    return place


@cache
def make_cloth_tools(real: Any) -> SimpleNamespace:
    """Compile small kernels around the passes: count steps, find bad masses, write positions and normals for
    drawing."""
    cross, unit = device_formulas(lengths, real, "exact").cross, device_formulas(cloth, real, "exact").unit
    inline = inlined("exact")
    one = np.int32(1)

    def count(counter, steps):
        if cuda.grid(1) == 0:
            counter[0] += steps

    def first_diverged(position, velocity, bound, x, y, z, result):
        """Find the lowest index of a mass that is not finite, or farther than `bound` from (x, y, z) along an axis, by
        an atomic minimum of integers."""
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v = load_quad(position, k), load_quad(velocity, k)
            inside = abs(p[0] - x) <= bound and abs(p[1] - y) <= bound and abs(p[2] - z) <= bound  # false for NaN
            still = v[0] - v[0] == v[1] - v[1] and v[1] - v[1] == v[2] - v[2]  # false for NaN and infinity
            if not (inside and still):
                cuda.atomic.min(result, 0, k)

    def write_position(position, out):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p = load_quad(position, k)
            out[k, 0] = p[0]
            out[k, 1] = p[1]
            out[k, 2] = p[2]

    @inline
    def triangle(position, a, b, c):
        """Return the normal of the triangle of masses a, b, c, with the length of twice its area."""
        p, q, r = load_quad(position, a), load_quad(position, b), load_quad(position, c)
        return cross(q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2])

    @inline
    def cell_sum(position, k, cell):
        """Return the sum of the normals of the up to six triangles at mass k, as in mass_spring/cloth/point.py."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        right, below = k if last else k + one, k if bottom else k + columns
        left, above = k if first else k - one, k if top else k - columns
        below_right = k if bottom or last else k + columns + one
        above_left = k if top or first else k - columns - one
        a = triangle(position, k, below, below_right)
        b = triangle(position, k, below_right, right)
        c = triangle(position, k if bottom else left, below, k)
        d = triangle(position, k if last else above, k, right)
        e = triangle(position, above_left, left, k)
        f = triangle(position, above_left, k, above)
        return (
            (a[0] + b[0]) + (c[0] + d[0]) + (e[0] + f[0]),
            (a[1] + b[1]) + (c[1] + d[1]) + (e[1] + f[1]),
            (a[2] + b[2]) + (c[2] + d[2]) + (e[2] + f[2]),
        )

    def write_normal(position, out, rows, columns):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            rows, columns = np.int32(rows), np.int32(columns)
            cell = Cell(np.int32(k // columns), np.int32(k % columns), rows, columns)
            x, y, z = cell_sum(position, k, cell)
            out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)

    tools = (count, first_diverged, write_position, write_normal)
    return make_kernels(tools, f"cloth_{variant_name(real)}")


@cache
def make_mesh_tools(real: Any) -> SimpleNamespace:
    """Compile `write_normal(position, out, offsets, at_vertex, corners)`: unit normals (vertices, 3) for drawing, of
    the triangles at each vertex, weighted by area."""
    cross, unit = device_formulas(lengths, real, "exact").cross, device_formulas(cloth, real, "exact").unit
    zero, one, two, three = real(0), np.int32(1), np.int32(2), np.int32(3)

    @inlined("exact")
    def triangle(position, ia, ib, ic):
        p, q, r = load_quad(position, ia), load_quad(position, ib), load_quad(position, ic)
        return cross(q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2])

    def write_normal(position, out, offsets, at_vertex, corners):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            x, y, z = zero, zero, zero
            for n in range(offsets[k], offsets[k + one]):
                place = three * at_vertex[n]
                fx, fy, fz = triangle(position, corners[place], corners[place + one], corners[place + two])
                x, y, z = x + fx, y + fy, z + fz
            out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)

    return SimpleNamespace(write_normal=make_kernel(write_normal, f"mesh_{variant_name(real)}"))
