"""Sleeping vertices, which keep their positions while they and their neighbours are slow
(model/formulas/elastic/sleep.py), on CUDA."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.sleep import is_slow


@routine
def find_slow(velocity, earlier, slow, speed, record):
    """Mark slow vertices."""
    k, parameters = np.int32(cuda.grid(1)), record[0]
    if k < slow.size:
        v, w = load_quad(velocity, k), load_quad(earlier, k)
        slow[k] = 1 if is_slow(v, w, speed, parameters.gravity, parameters.dt) else 0


@routine
def restore_resting(before, position, velocity, earlier, slow, offsets, neighbours):
    """Reset positions and velocities of vertices that sleep."""
    k = np.int32(cuda.grid(1))
    if k < slow.size:
        p, v = load_quad(position, k), load_quad(velocity, k)
        still = slow[k] == 1 and p[3] > 0.0
        for n in range(offsets[k], offsets[k + 1]):
            still = still and slow[neighbours[n]] == 1
        if still:
            b = load_quad(before, k)
            store_quad(position, k, b[0], b[1], b[2], p[3])
            store_quad(velocity, k, 0.0, 0.0, 0.0, v[3])
            store_quad(earlier, k, 0.0, 0.0, 0.0, 0.0)
        else:
            store_quad(earlier, k, v[0], v[1], v[2], 0.0)


@cache
def make_sleep(real: Real, math: str) -> SimpleNamespace:
    """Compile `find_slow` and `restore_resting`. `slow` (particles,) int32; `earlier`: velocities at the end of the last
    substep."""
    label = f"sleep_{variant_name(real, math)}"
    return kernels_of(device_variant(real, math), math, (find_slow, restore_resting), label)
