"""Sleeping vertices, which keep their positions while they and their neighbours are slow, on CPU threads
(formulas/elastic/sleep.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.sleep import is_slow


@routine
def find_slow(band, bands, velocity, earlier, slow, speed, parameters):
    """Mark slow vertices."""
    count = len(slow)
    for k in range(count * band // bands, count * (band + 1) // bands):
        v, w = (velocity[k, 0], velocity[k, 1], velocity[k, 2]), (earlier[k, 0], earlier[k, 1], earlier[k, 2])
        slow[k] = 1 if is_slow(v, w, speed, parameters.gravity, parameters.dt) else 0


@routine
def restore_resting(band, bands, before, position, velocity, earlier, slow, offsets, neighbours):
    """Reset positions and velocities of vertices that sleep."""
    count = len(slow)
    for k in range(count * band // bands, count * (band + 1) // bands):
        still = slow[k] == 1 and position[k, 3] > 0.0
        for n in range(offsets[k], offsets[k + 1]):
            still = still and slow[neighbours[n]] == 1
        for axis in range(3):
            if still:
                position[k, axis], velocity[k, axis] = before[k, axis], 0.0
            earlier[k, axis] = velocity[k, axis]


@cache
def make_sleep_stages(real: Real, math: str) -> SimpleNamespace:
    """Compile `find_slow` and `restore_resting`, each as a parallel loop: (bands, ...).

    `slow` (particles,) int32; `earlier`: velocities at the end of the last substep, (particles, 3).
    """
    compiler = Compiler(f"sleep_{np.dtype(real).name}_{math}", math)
    copied = compiler.variant_of(real).copied
    return SimpleNamespace(
        find_slow=compiler.banded(copied(find_slow)), restore_resting=compiler.banded(copied(restore_resting))
    )
