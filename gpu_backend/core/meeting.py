"""Barrier of all blocks of a cooperative launch."""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.blocks import read_flag
from softlab.model.base.variant import inlined_routine


@inlined_routine
def barrier(flags, wanted):
    """Wait for all blocks: every thread of each must call it, and everything written before is visible after it.

    `flags` (1,) int32, 0 before the launch; `wanted`: the number of blocks at first, then the last returned value.
    """
    cuda.syncthreads()
    if cuda.gridDim.x > 1:
        if cuda.threadIdx.x == 0:
            cuda.threadfence()
            cuda.atomic.add(flags, 0, 1)
            while np.int32(read_flag(flags, 0) - wanted) < 0:
                pass
            cuda.threadfence()
        cuda.syncthreads()
    return np.int32(wanted + np.int32(cuda.gridDim.x))
