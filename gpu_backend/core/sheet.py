"""Blocks of threads over the rows and columns of a sheet."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernel_options, kernels_of, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad
from softlab.gpu_backend.core.world import Cell
from softlab.model.base.types import Real
from softlab.model.base.variant import inlined_routine, routine
from softlab.model.formulas.cloth import unit
from softlab.model.formulas.lengths import cross

BLOCK = (32, 8)  # threads along a row, down the columns
MAX_BLOCKS_DOWN = 65535  # CUDA's limit of a grid's second dimension


@inlined_routine
def lattice_place():
    """Return (i, j) of the thread in the lattice of its launch."""
    return (
        np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y),
        np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x),
    )


@routine
def count(counter, steps):
    if cuda.grid(1) == 0:
        counter[0] += steps


@routine
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


@routine
def write_position(position, out):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        out[k, 0] = p[0]
        out[k, 1] = p[1]
        out[k, 2] = p[2]


@inlined_routine
def triangle_normal(position, a, b, c):
    """Return the normal of the triangle of masses a, b, c, with the length of twice its area."""
    p, q, r = load_quad(position, a), load_quad(position, b), load_quad(position, c)
    return cross(q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2])


@inlined_routine
def cell_sum(position, k, cell):
    """Return the sum of the normals of the up to six triangles at mass k, as in mass_spring/cloth/point.py."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
    right, below = k if last else k + np.int32(1), k if bottom else k + columns
    left, above = k if first else k - np.int32(1), k if top else k - columns
    below_right = k if bottom or last else k + columns + np.int32(1)
    above_left = k if top or first else k - columns - np.int32(1)
    a = triangle_normal(position, k, below, below_right)
    b = triangle_normal(position, k, below_right, right)
    c = triangle_normal(position, k if bottom else left, below, k)
    d = triangle_normal(position, k if last else above, k, right)
    e = triangle_normal(position, above_left, left, k)
    f = triangle_normal(position, above_left, k, above)
    return (
        (a[0] + b[0]) + (c[0] + d[0]) + (e[0] + f[0]),
        (a[1] + b[1]) + (c[1] + d[1]) + (e[1] + f[1]),
        (a[2] + b[2]) + (c[2] + d[2]) + (e[2] + f[2]),
    )


@routine
def write_normal(position, out, rows, columns):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        rows, columns = np.int32(rows), np.int32(columns)
        cell = Cell(np.int32(k // columns), np.int32(k % columns), rows, columns)
        x, y, z = cell_sum(position, k, cell)
        out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)


@routine
def write_mesh_normal(position, out, offsets, at_vertex, corners):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        x, y, z = 0.0, 0.0, 0.0
        for n in range(offsets[k], offsets[k + np.int32(1)]):
            place = np.int32(3) * at_vertex[n]
            a, b, c = corners[place], corners[place + np.int32(1)], corners[place + np.int32(2)]
            fx, fy, fz = triangle_normal(position, a, b, c)
            x, y, z = x + fx, y + fy, z + fz
        out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)


@cache
def make_cloth_tools(real: Real) -> SimpleNamespace:
    """Compile small kernels around the passes: count steps, find bad masses, write positions and normals for
    drawing."""
    tools = count, first_diverged, write_position, write_normal
    return kernels_of(device_variant(real, "exact"), "exact", tools, f"cloth_{variant_name(real)}")


@cache
def make_mesh_tools(real: Real) -> SimpleNamespace:
    """Compile `write_normal(position, out, offsets, at_vertex, corners)`: unit normals (vertices, 3) for drawing, of
    the triangles at each vertex, weighted by area."""
    kernel = device_variant(real, "exact").copied(write_mesh_normal)
    return SimpleNamespace(write_normal=make_kernel(kernel, f"mesh_{variant_name(real)}", **kernel_options("exact")))
