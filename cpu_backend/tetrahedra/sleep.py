"""Sleeping vertices, which keep their positions while they and their neighbours are slow, on CPU threads
(formulas/elastic/sleep.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import sleep


@cache
def make_sleep_stages(real: Real, math: str) -> SimpleNamespace:
    """Compile `find_slow(bands, velocity, earlier, slow, speed, parameters)`, which marks slow vertices, and
    `restore_resting(bands, before, position, velocity, earlier, slow, offsets, neighbours)`, which resets positions and
    velocities.

    `slow` (particles,) int32; `earlier`: velocities at the end of the last substep, (particles, 3).
    """
    compiler = Compiler(f"sleep_{np.dtype(real).name}_{math}", math)
    is_slow, zero = compiler.formulas(sleep, real).is_slow, real(0)

    def find_slow(band, bands, velocity, earlier, slow, speed, parameters):
        count = len(slow)
        for k in range(count * band // bands, count * (band + 1) // bands):
            v, w = (velocity[k, 0], velocity[k, 1], velocity[k, 2]), (earlier[k, 0], earlier[k, 1], earlier[k, 2])
            slow[k] = 1 if is_slow(v, w, speed, parameters.gravity, parameters.dt) else 0

    def restore_resting(band, bands, before, position, velocity, earlier, slow, offsets, neighbours):
        count = len(slow)
        for k in range(count * band // bands, count * (band + 1) // bands):
            still = slow[k] == 1 and position[k, 3] > zero
            for n in range(offsets[k], offsets[k + 1]):
                still = still and slow[neighbours[n]] == 1
            for axis in range(3):
                if still:
                    position[k, axis], velocity[k, axis] = before[k, axis], zero
                earlier[k, axis] = velocity[k, axis]

    return SimpleNamespace(find_slow=compiler.banded(find_slow), restore_resting=compiler.banded(restore_resting))
