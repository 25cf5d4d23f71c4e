"""CUDA kernels of the effects of neighbours on a fluid's velocities, one thread per particle (model/fluid/plan.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.fluid.extent import extent
from softlab.gpu_backend.fluid.motion import limited
from softlab.gpu_backend.fluid.sums import pair, row
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.fluid.parameters import F_COHESION, F_CONFINEMENT, F_TENSION, F_VISCOSITY, F_WEIGHT
from softlab.model.formulas.fluid.density import gradient_added, near, slope
from softlab.model.formulas.fluid.motion import (
    confined,
    curl_added,
    pull,
    pull_added,
    rise_added,
    smooth_added,
    smoothed,
    smoothing_weight,
    speed_of,
    tension_added,
)


@inlined_routine
def add_shape(sums_so_far, p, q, v, w, offset, s):
    """Add a neighbour to a normal and a vorticity."""
    nx, ny, nz, cx, cy, cz = sums_so_far
    dx, dy, dz, _ = offset
    if FEATURE.surface_tension:
        nx, ny, nz = gradient_added(nx, s, dx), gradient_added(ny, s, dy), gradient_added(nz, s, dz)
    if FEATURE.vorticity:
        cx = curl_added(cx, s, dy, dz, v[1], v[2], w[1], w[2])
        cy = curl_added(cy, s, dz, dx, v[2], v[0], w[2], w[0])
        cz = curl_added(cz, s, dx, dy, v[0], v[1], w[0], w[1])
    return nx, ny, nz, cx, cy, cz


@routine
def shape(position, velocity, record, table, neighbour_counts, normals, curls):
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        parameters, p, v, at = record[0], load_quad(position, k), load_quad(velocity, k), np.int64(k)
        totals = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for _ in range(neighbour_counts[k]):
            j = table[at]
            at += particles
            q, w = load_quad(position, j), load_quad(velocity, j)
            if FEATURE.solids and q[3] == parameters.sampled:
                continue
            offset = pair(k, p, j, q, parameters)
            s = slope(offset[3], parameters.inverse_support, parameters.gradient_scale)
            totals = add_shape(totals, p, q, v, w, offset, s)
        nx, ny, nz, cx, cy, cz = totals
        store_quad(normals, k, nx, ny, nz, 0.0)
        store_quad(curls, k, cx, cy, cz, speed_of(cx, cy, cz))


@inlined_routine
def add_forces(f, offset, near_row, here_row, n, m, fluids, parameters):
    """Add cohesion and surface tension: `n`, `m`: normals of this particle and of its neighbour."""
    fx, fy, fz = f
    dx, dy, dz, r = offset
    if FEATURE.cohesion:
        a = pull(r, parameters.inverse_support, fluids[here_row + F_COHESION], fluids[near_row + F_COHESION])
        fx, fy, fz = pull_added(fx, a, dx), pull_added(fy, a, dy), pull_added(fz, a, dz)
    if FEATURE.surface_tension:
        one, other = fluids[here_row + F_TENSION], fluids[near_row + F_TENSION]
        fx = tension_added(fx, one, other, n[0], m[0])
        fy, fz = tension_added(fy, one, other, n[1], m[1]), tension_added(fz, one, other, n[2], m[2])
    return fx, fy, fz


@inlined_routine
def add_smooth(m, v, w, r, near_row, here_row, fluids, parameters):
    """Add XSPH viscosity: v, w: velocities of this particle and of its neighbour."""
    weight = smoothing_weight(
        near(r, parameters.inverse_support), fluids[here_row + F_VISCOSITY], fluids[near_row + F_VISCOSITY],
        fluids[here_row + F_WEIGHT], fluids[near_row + F_WEIGHT],
    )  # fmt: skip
    return (
        smooth_added(m[0], weight, v[0], w[0]), smooth_added(m[1], weight, v[1], w[1]),
        smooth_added(m[2], weight, v[2], w[2]),
    )  # fmt: skip


@routine
def smooth(position, velocity, record, table, neighbour_counts, constraints, fluids, normals, curls, into):
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        parameters, p, v, at = record[0], load_quad(position, k), load_quad(velocity, k), np.int64(k)
        m, f, rise, here_row = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), row(p[3])
        normal, curl = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
        if FEATURE.surface_tension:
            normal = load_quad(normals, k)
        if FEATURE.vorticity:
            curl = load_quad(curls, k)
        for _ in range(neighbour_counts[k]):
            j = table[at]
            at += particles
            q = load_quad(position, j)
            if FEATURE.solids and q[3] == parameters.sampled:
                continue
            offset, near_row, other = pair(k, p, j, q, parameters), row(q[3]), (0.0, 0.0, 0.0, 0.0)
            if FEATURE.viscosity:
                m = add_smooth(m, v, load_quad(velocity, j), offset[3], near_row, here_row, fluids, parameters)
            if FEATURE.surface_tension:
                other = load_quad(normals, j)
            f = add_forces(f, offset, near_row, here_row, normal, other, fluids, parameters)
            if FEATURE.vorticity:
                s = slope(offset[3], parameters.inverse_support, parameters.gradient_scale)
                length = load_quad(curls, j)[3]
                rise = (
                    rise_added(rise[0], s, offset[0], curl[3], length),
                    rise_added(rise[1], s, offset[1], curl[3], length),
                    rise_added(rise[2], s, offset[2], curl[3], length),
                )  # fmt: skip
        weight = fluids[here_row + F_WEIGHT]
        vx, vy, vz = (
            smoothed(v[0], m[0], weight, f[0]), smoothed(v[1], m[1], weight, f[1]), smoothed(v[2], m[2], weight, f[2]),
        )  # fmt: skip
        if FEATURE.vorticity:
            strength, steep = fluids[here_row + F_CONFINEMENT], speed_of(rise[0], rise[1], rise[2])
            vx = confined(vx, strength, steep, rise[1], rise[2], curl[1], curl[2])
            vy = confined(vy, strength, steep, rise[2], rise[0], curl[2], curl[0])
            vz = confined(vz, strength, steep, rise[0], rise[1], curl[0], curl[1])
        if FEATURE.limits:
            c = constraints[k] if FEATURE.drag else 0.0
            vx, vy, vz = limited(vx, vy, vz, c, fluids, here_row, parameters)
        store_quad(into, k, vx, vy, vz, 0.0)


@cache
def make_smoothing(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str], limits: bool
) -> SimpleNamespace:
    """Compile `shape` and `smooth`.

    `shape(position, velocity, record, table, found, normals, curls)`: normals [1/m], and vorticities [1/s] and their
    lengths. `smooth(position, velocity, record, table, found, constraints, fluids, normals, curls, into)`: velocities
    after all effects of neighbours; with `limits` also the limit.
    """
    variant = fluid_variant(real, math, parts, repeats, {"limits": limits})
    return kernels_of(variant, math, (shape, smooth), f"fluid_{variant_name(real, math, parts, repeats)}")
