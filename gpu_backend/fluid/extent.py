"""Number of active particles of a fluid on CUDA. With emitters or sinks, integer arrays have one more entry at the end,
which is that number; it is copied along with the particles' numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.gpu_backend.core.compile import inlined

FLOWS = frozenset({"emitter", "sink"})


@cache
def make_extent(parts: frozenset[str]) -> Callable:
    """Make extent(array) -> (particles, active particles), of an array with one integer per particle."""
    flows, one = bool(parts & FLOWS), np.int32(1)

    def extent(array):
        if flows:
            particles = np.int32(np.int32(array.size) - one)
            return particles, np.int32(array[particles])
        return np.int32(array.size), np.int32(array.size)

    return inlined("exact")(extent)
