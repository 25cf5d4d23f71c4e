"""The CUDA kernel that turns deforming clusters, one thread each; `turn` of shape_matching/kernels.py is for the
others.

A cluster's constants (model/shape_matching/cluster_tables.py, `shape_table`) are three quads, as are its plastic
strain's rows.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import ROWS, load_quad, store_quad
from softlab.gpu_backend.shape_matching.kernels import MOMENTS_32
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, routine
from softlab.model.formulas.rotation import matrix_of, rotation_3d
from softlab.model.formulas.shape_matching.cluster import centre, corrected
from softlab.model.formulas.shape_matching.deformation import bent as bent_moments
from softlab.model.formulas.shape_matching.deformation import blended, crept, gradient, product, strain, undone


@routine
def turn(position, firsts, leans, sums, rotation, new_rotation, frames, shapes, plastic, bent):
    """Turn deforming clusters, as kernels.turn, with strains from `plastic` into `bent`, which may be the same."""
    c = np.int32(cuda.grid(1))
    if c < firsts.size:
        first, q, k = load_quad(position, firsts[c]), load_quad(rotation, c), np.int32(MOMENTS_32 * c)
        row = np.int32(ROWS * c)
        rest_offset, wx, wy, wz = load_quad(leans, c), sums[k], sums[k + 1], sums[k + 2]
        g, h, s = load_quad(shapes, row), load_quad(shapes, row + 1), load_quad(shapes, row + 2)
        a = (
            corrected(sums[k + 3], wx, rest_offset[0]), corrected(sums[k + 4], wx, rest_offset[1]),
            corrected(sums[k + 5], wx, rest_offset[2]), corrected(sums[k + 6], wy, rest_offset[0]),
            corrected(sums[k + 7], wy, rest_offset[1]), corrected(sums[k + 8], wy, rest_offset[2]),
            corrected(sums[k + 9], wz, rest_offset[0]), corrected(sums[k + 10], wz, rest_offset[1]),
            corrected(sums[k + 11], wz, rest_offset[2]),
        )  # fmt: skip
        f = gradient(a, (g[0], g[1], g[2], g[3], h[0], h[1]))
        if FEATURE.plastic:
            p, m, t = load_quad(plastic, row), load_quad(plastic, row + 1), load_quad(plastic, row + 2)
            p = p[0], p[1], p[2], m[0], m[1], m[2], t[0], t[1], t[2]
            f = undone(f, p)
            a = bent_moments(a, p)
        w, x, y, z = rotation_3d(a, (q[0], q[1], q[2], q[3]))
        store_quad(new_rotation, c, w, x, y, z)
        r = matrix_of(w, x, y, z)
        goal = r
        if FEATURE.linear:
            goal = blended(f, r, h[2])
        if FEATURE.plastic:
            goal = product(goal, p)
            bxx, bxy, bxz, byx, byy, byz, bzx, bzy, bzz = crept(strain(f, r), p, h[3], s[0], s[1])
            store_quad(bent, row, bxx, bxy, bxz, 0.0)
            store_quad(bent, row + 1, byx, byy, byz, 0.0)
            store_quad(bent, row + 2, bzx, bzy, bzz, 0.0)
        xx, xy, xz, yx, yy, yz, zx, zy, zz = goal
        mass, a, b, d = rest_offset[3], rest_offset[0], rest_offset[1], rest_offset[2]
        store_quad(frames, row, xx, xy, xz, centre(first[0], wx, mass, xx, xy, xz, a, b, d))
        store_quad(frames, row + 1, yx, yy, yz, centre(first[1], wy, mass, yx, yy, yz, a, b, d))
        store_quad(frames, row + 2, zx, zy, zz, centre(first[2], wz, mass, zx, zy, zz, a, b, d))


@cache
def make_shaped_turn(real: Real, math: str, shaping: frozenset[str]) -> Kernel:
    """Compile turn(position, firsts, leans, sums, rotation, new_rotation, frames, shapes, plastic, bent). `shaping`: which of
    `linear` and `plastic` there are."""
    kernel = device_variant(real, math, features_of(shaping)).copied(turn)
    return make_kernel(kernel, f"bodies_{variant_name(real, math, shaping)}", **kernel_options(math))
