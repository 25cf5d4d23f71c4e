"""Number of active particles of a fluid on CUDA. With emitters or sinks, integer arrays have one more entry at the end,
which is that number; it is copied along with the particles' numbers."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, inlined_routine


@inlined_routine
def extent(array):
    """Return (particles, active particles), of an array with one integer per particle."""
    if FEATURE.flow:
        particles = np.int32(np.int32(array.size) - 1)
        return particles, np.int32(array[particles])
    return np.int32(array.size), np.int32(array.size)
