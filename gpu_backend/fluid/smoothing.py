"""CUDA kernels of the effects of neighbours on a fluid's velocities, one thread per particle (model/fluid/plan.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.fluid.extent import make_extent
from softlab.gpu_backend.fluid.motion import make_ends
from softlab.gpu_backend.fluid.sums import make_pair, make_row
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_COHESION, F_CONFINEMENT, F_TENSION, F_VISCOSITY, F_WEIGHT
from softlab.model.formulas.fluid import density, motion


@cache
def make_smoothing(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str], ends_there: bool
) -> SimpleNamespace:
    """Compile `shape` and `smooth`.

    `shape(position, velocity, record, table, found, normals, curls)`: normals [1/m], and vorticities [1/s] and their
    lengths. `smooth(position, velocity, record, table, found, constraints, fluids, normals, curls, into)`: velocities
    after all effects of neighbours; with `ends_there` also the limit.
    """
    variant = real, math, parts, repeats
    return SimpleNamespace(shape=_make_shape(*variant), smooth=_make_smooth(*variant, ends_there))


@cache
def _make_shape(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> Kernel:
    formulas, sums = device_formulas(motion, real, math), device_formulas(density, real, math)
    inline, pair = inlined(math), make_pair(real, math, repeats)
    slope, gradient_added, speed_of, curl_added = (
        sums.slope, sums.gradient_added, formulas.speed_of, formulas.curl_added,
    )  # fmt: skip
    has_tension, has_curl, zero = "surface-tension" in parts, "vorticity" in parts, real(0)
    extent = make_extent(parts)
    has_solids = "solids" in parts

    @inline
    def add_shape(sums_so_far, p, q, v, w, offset, s):
        nx, ny, nz, cx, cy, cz = sums_so_far
        dx, dy, dz, _ = offset
        if has_tension:
            nx, ny, nz = gradient_added(nx, s, dx), gradient_added(ny, s, dy), gradient_added(nz, s, dz)
        if has_curl:
            cx = curl_added(cx, s, dy, dz, v[1], v[2], w[1], w[2])
            cy = curl_added(cy, s, dz, dx, v[2], v[0], w[2], w[0])
            cz = curl_added(cz, s, dx, dy, v[0], v[1], w[0], w[1])
        return nx, ny, nz, cx, cy, cz

    def shape(position, velocity, record, table, neighbour_counts, normals, curls):
        k = np.int32(cuda.grid(1))
        particles, there = extent(neighbour_counts)
        if k < there:
            parameters, p, v, at = record[0], load_quad(position, k), load_quad(velocity, k), np.int64(k)
            totals = zero, zero, zero, zero, zero, zero
            for _ in range(neighbour_counts[k]):
                j = table[at]
                at += particles
                q, w = load_quad(position, j), load_quad(velocity, j)
                if has_solids and q[3] == parameters.sampled:
                    continue
                offset = pair(k, p, j, q, parameters)
                s = slope(offset[3], parameters.inverse_support, parameters.gradient_scale)
                totals = add_shape(totals, p, q, v, w, offset, s)
            nx, ny, nz, cx, cy, cz = totals
            store_quad(normals, k, nx, ny, nz, zero)
            store_quad(curls, k, cx, cy, cz, speed_of(cx, cy, cz))

    return make_kernel(shape, f"fluid_{variant_name(real, math, parts, repeats)}", **kernel_options(math))


@cache
def _make_pair_terms(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `add_forces` and `add_smooth`: the contribution of one neighbour."""
    formulas, inline = device_formulas(motion, real, math), inlined(math)
    near = device_formulas(density, real, math).near
    smoothing_weight, smooth_added = formulas.smoothing_weight, formulas.smooth_added
    pull, pull_added, tension_added = formulas.pull, formulas.pull_added, formulas.tension_added
    has_cohesion, has_tension = "cohesion" in parts, "surface-tension" in parts

    @inline
    def add_forces(f, offset, near_row, here_row, n, m, fluids, parameters):
        """Add cohesion and surface tension: `n`, `m`: normals of this particle and of its neighbour."""
        fx, fy, fz = f
        dx, dy, dz, r = offset
        if has_cohesion:
            a = pull(r, parameters.inverse_support, fluids[here_row + F_COHESION], fluids[near_row + F_COHESION])
            fx, fy, fz = pull_added(fx, a, dx), pull_added(fy, a, dy), pull_added(fz, a, dz)
        if has_tension:
            one, other = fluids[here_row + F_TENSION], fluids[near_row + F_TENSION]
            fx = tension_added(fx, one, other, n[0], m[0])
            fy, fz = tension_added(fy, one, other, n[1], m[1]), tension_added(fz, one, other, n[2], m[2])
        return fx, fy, fz

    @inline
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

    return SimpleNamespace(add_forces=add_forces, add_smooth=add_smooth)


@cache
def _make_smooth(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str], ends_there: bool) -> Kernel:
    formulas, terms, row = (
        device_formulas(motion, real, math),
        _make_pair_terms(real, math, parts),
        make_row(parts),
    )
    pair, limited = make_pair(real, math, repeats), make_ends(real, math, parts).limited
    slope, add_forces, add_smooth = device_formulas(density, real, math).slope, terms.add_forces, terms.add_smooth
    rise_added, confined, smoothed = formulas.rise_added, formulas.confined, formulas.smoothed
    speed_of, zero, is_dragged, extent = formulas.speed_of, real(0), "drag" in parts, make_extent(parts)
    has_viscosity, has_tension, has_curl = (part in parts for part in ("viscosity", "surface-tension", "vorticity"))
    has_solids = "solids" in parts

    def smooth(position, velocity, record, table, neighbour_counts, constraints, fluids, normals, curls, into):
        k = np.int32(cuda.grid(1))
        particles, there = extent(neighbour_counts)
        if k < there:
            parameters, p, v, at = record[0], load_quad(position, k), load_quad(velocity, k), np.int64(k)
            m, f, rise, here_row = (zero, zero, zero), (zero, zero, zero), (zero, zero, zero), row(p[3])
            normal, curl = (zero, zero, zero, zero), (zero, zero, zero, zero)
            if has_tension:
                normal = load_quad(normals, k)
            if has_curl:
                curl = load_quad(curls, k)
            for _ in range(neighbour_counts[k]):
                j = table[at]
                at += particles
                q = load_quad(position, j)
                if has_solids and q[3] == parameters.sampled:
                    continue
                offset, near_row, other = pair(k, p, j, q, parameters), row(q[3]), (zero, zero, zero, zero)
                if has_viscosity:
                    m = add_smooth(m, v, load_quad(velocity, j), offset[3], near_row, here_row, fluids, parameters)
                if has_tension:
                    other = load_quad(normals, j)
                f = add_forces(f, offset, near_row, here_row, normal, other, fluids, parameters)
                if has_curl:
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
            if has_curl:
                strength, steep = fluids[here_row + F_CONFINEMENT], speed_of(rise[0], rise[1], rise[2])
                vx = confined(vx, strength, steep, rise[1], rise[2], curl[1], curl[2])
                vy = confined(vy, strength, steep, rise[2], rise[0], curl[2], curl[0])
                vz = confined(vz, strength, steep, rise[0], rise[1], curl[0], curl[1])
            if ends_there:
                c = constraints[k] if is_dragged else zero
                vx, vy, vz = limited(vx, vy, vz, c, fluids, here_row, parameters)
            store_quad(into, k, vx, vy, vz, zero)

    return make_kernel(smooth, f"fluid_{variant_name(real, math, parts, repeats)}", **kernel_options(math))
