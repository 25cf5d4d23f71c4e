"""Small kernels around a fluid's substeps: count steps, find bad particles, write positions in the scene's order."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import make_kernels, variant_name
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.extent import FLOWS, make_extent
from softlab.model.base.types import Real
from softlab.model.geometry.particle_row import PARKED


@cache
def make_fluid_tools(real: Real, axes: int, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `count(counter, steps)`, `first_diverged(position, velocity, particle, bound, x, y, z, result)`,
    `write_position(position, particle, out)` and, for emitters and sinks, `park(there, out)`, which must run before it.
    `particle`: the particles' numbers."""
    solid, extent, parked, zero = axes == 3, make_extent(parts), np.float32(PARKED), np.int32(0)

    def count(counter, steps):
        if cuda.grid(1) == 0:
            counter[0] += steps

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

    def write_position(position, particle, out):
        k = np.int32(cuda.grid(1))
        if k < extent(particle)[1]:
            p, n = load_quad(position, k), particle[k]
            out[n, 0] = p[0]
            out[n, 1] = p[1]
            if solid:
                out[n, 2] = p[2]

    def park(there, out):
        k = np.int32(cuda.grid(1))
        if k < there.size and there[k] == zero:
            out[k, 0] = parked
            out[k, 1] = parked
            if solid:
                out[k, 2] = parked

    flows = frozenset(parts & FLOWS)
    return make_kernels((count, first_diverged, write_position, park), f"fluid_{variant_name(real, axes, flows)}")
