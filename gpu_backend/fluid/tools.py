"""Small kernels around a fluid's substeps: count steps, find bad particles, write positions in the scene's order."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.extent import extent
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.geometry.particle_row import PARKED


@routine
def count(counter, steps):
    if cuda.grid(1) == 0:
        counter[0] += steps


@routine
def first_diverged(position, velocity, particle, bound, x, y, z, result):
    """Find the lowest number of a particle that is not finite, or farther than `bound` from (x, y, z) along an
    axis, by an atomic minimum of integers."""
    k = np.int32(cuda.grid(1))
    if k < extent(particle)[1]:
        p, v = load_quad(position, k), load_quad(velocity, k)
        inside = abs(p[0] - x) <= bound and abs(p[1] - y) <= bound and abs(p[2] - z) <= bound  # false for NaN
        still = v[0] - v[0] == v[1] - v[1] and v[1] - v[1] == v[2] - v[2]  # false for NaN and infinity
        if not (inside and still):
            cuda.atomic.min(result, 0, particle[k])


@routine
def write_position(position, particle, out):
    k = np.int32(cuda.grid(1))
    if k < extent(particle)[1]:
        p, n = load_quad(position, k), particle[k]
        out[n, 0] = p[0]
        out[n, 1] = p[1]
        if FEATURE.axes == 3:
            out[n, 2] = p[2]


@routine
def park(there, out):
    k = np.int32(cuda.grid(1))
    if k < there.size and there[k] == 0:
        out[k, 0] = PARKED
        out[k, 1] = PARKED
        if FEATURE.axes == 3:
            out[k, 2] = PARKED


@cache
def make_fluid_tools(real: Real, axes: int, flows: frozenset[str]) -> SimpleNamespace:
    """Compile `count(counter, steps)`, `first_diverged(position, velocity, particle, bound, x, y, z, result)`,
    `write_position(position, particle, out)` and, for emitters and sinks, `park(there, out)`, which must run before it.
    `particle`: the particles' numbers; `flows`: of FLOWS."""
    variant = device_variant(real, "exact", {"axes": axes, "flow": bool(flows)})
    kernels = map(variant.copied, (count, first_diverged, write_position, park))
    return make_kernels(kernels, f"fluid_{variant_name(real, axes, flows)}")
