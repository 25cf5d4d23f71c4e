"""Sleeping vertices, which keep their positions while they and their neighbours are slow
(model/formulas/elastic/sleep.py), on CUDA."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import sleep


@cache
def make_sleep(real: Real, math: str) -> SimpleNamespace:
    """Compile `find_slow(velocity, earlier, slow, speed, record)`, which marks slow vertices, and
    `restore_resting(before, position, velocity, earlier, slow, offsets, neighbours)`, which resets positions and
    velocities.

    `slow` (particles,) int32; `earlier`: velocities at the end of the last substep.
    """
    is_slow = device_formulas(sleep, real, math).is_slow
    zero, next_one = real(0), np.int32(1)

    def find_slow(velocity, earlier, slow, speed, record):
        k, parameters = np.int32(cuda.grid(1)), record[0]
        if k < slow.size:
            v, w = load_quad(velocity, k), load_quad(earlier, k)
            slow[k] = 1 if is_slow(v, w, speed, parameters.gravity, parameters.dt) else 0

    def restore_resting(before, position, velocity, earlier, slow, offsets, neighbours):
        k = np.int32(cuda.grid(1))
        if k < slow.size:
            p, v = load_quad(position, k), load_quad(velocity, k)
            still = slow[k] == 1 and p[3] > zero
            for n in range(offsets[k], offsets[k + next_one]):
                still = still and slow[neighbours[n]] == 1
            if still:
                b = load_quad(before, k)
                store_quad(position, k, b[0], b[1], b[2], p[3])
                store_quad(velocity, k, zero, zero, zero, v[3])
                store_quad(earlier, k, zero, zero, zero, zero)
            else:
                store_quad(earlier, k, v[0], v[1], v[2], zero)

    return make_kernels((find_slow, restore_resting), f"sleep_{variant_name(real, math)}", **kernel_options(math))
