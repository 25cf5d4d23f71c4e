"""The kernels that carry borders of a grid between windows. A border is neighbouring rows: one run of masses.

`pull`: a window reads its halo from its neighbour's state, once events say that it is there. `push`: it writes its border
into the neighbour's inbox and raises a flag there; `take`: it waits for its own flags and reads its inbox. Block b of `take`
reads what block b of `push` wrote, since both are launched alike, so that each block has a flag of its own.

Two halves of an inbox in turn are enough: a window pushes number n + 2 only after it took number n + 1, which the neighbour
pushed after it had taken number n.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.blocks import load_fresh_pair
from gpu_backend.core.compile import make_kernels, variant_name
from gpu_backend.core.pairs import load_pair, store_pair
from gpu_backend.domains.system_flags import nanoseconds, raise_system_flag, read_system_flag

FLAG_STRIDE = 32  # int32 between two flags: a 128-byte line each
BLOCKS, THREADS = 32, 256  # of push and take: few enough to run beside all else
PATIENCE = 20_000_000_000  # ns that a block waits for a neighbour
LOOKS = 255  # at a flag between two at the clock; of a binary number, all ones


@cache
def make_border_kernels(real: Any) -> SimpleNamespace:
    """`pull`, `push`, `take`, `count_on`; see the inner functions. Positions and velocities are complex (masses,)."""

    def pull(position, velocity, first, new_position, new_velocity, to, count):
        """Masses `first` ... of a neighbour's state become masses `to` ... of one's own."""
        k = np.int32(cuda.grid(1))
        if k < count:
            p, v = load_pair(position, np.int32(first + k)), load_pair(velocity, np.int32(first + k))
            store_pair(new_position, np.int32(to + k), p.real, p.imag)
            store_pair(new_velocity, np.int32(to + k), v.real, v.imag)

    def push(position, velocity, first, count, inbox, flags, epoch):
        """Masses `first` ... into the neighbour's `inbox` (4 x count,), its half told by the exchange's number."""
        number = np.int32(epoch[0] + 1)
        half = np.int32((number & 1) * 2 * count)
        k = np.int32(cuda.grid(1))
        while k < count:
            p, v = load_pair(position, np.int32(first + k)), load_pair(velocity, np.int32(first + k))
            store_pair(inbox, np.int32(half + k), p.real, p.imag)
            store_pair(inbox, np.int32(half + count + k), v.real, v.imag)
            k = np.int32(k + cuda.gridsize(1))
        cuda.threadfence_system()
        cuda.syncthreads()
        if cuda.threadIdx.x == 0:
            raise_system_flag(flags, np.int32(cuda.blockIdx.x * FLAG_STRIDE), number)

    def take(position, velocity, to, count, inbox, flags, epoch, failed):
        """What the neighbour pushed becomes masses `to` ...; `failed` (1,) is set to 1 where it never comes."""
        number = np.int32(epoch[0] + 1)
        half = np.int32((number & 1) * 2 * count)
        if cuda.threadIdx.x == 0:
            begin = nanoseconds()
            looks = np.int32(0)
            while np.int32(read_system_flag(flags, np.int32(cuda.blockIdx.x * FLAG_STRIDE)) - number) < 0:
                looks = np.int32(looks + 1)
                if (looks & LOOKS) == 0:
                    if failed[0] != 0 or nanoseconds() - begin > PATIENCE:
                        failed[0] = 1
                        break
        cuda.syncthreads()
        k = np.int32(cuda.grid(1))
        while k < count:
            p, v = load_fresh_pair(inbox, np.int32(half + k)), load_fresh_pair(inbox, np.int32(half + count + k))
            store_pair(position, np.int32(to + k), p.real, p.imag)
            store_pair(velocity, np.int32(to + k), v.real, v.imag)
            k = np.int32(k + cuda.gridsize(1))

    def count_on(epoch):
        """The exchange is over."""
        if cuda.grid(1) == 0:
            epoch[0] += 1

    return make_kernels((pull, push, take, count_on), variant_name(real))
