"""How many particles of a fluid are there, on CUDA: where they come and go, arrays of whole numbers have one more at their
end, which says so; it travels with the particles' numbers."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gpu_backend.core.compile import inlined

FLOWS = frozenset({"emitter", "sink"})


@cache
def make_extent(parts: frozenset[str]) -> Any:
    """extent(array) -> (particles, how many of them are there): of an array of a whole number a particle."""
    flows, one = bool(parts & FLOWS), np.int32(1)

    def extent(array):
        if flows:
            particles = np.int32(np.int32(array.size) - one)
            return particles, np.int32(array[particles])
        return np.int32(array.size), np.int32(array.size)

    return inlined("exact")(extent)
