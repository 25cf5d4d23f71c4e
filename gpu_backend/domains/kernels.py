"""The kernels that carry borders of a sheet between windows. A border is neighbouring rows, and so one run of bytes of the
positions and one of the velocities: they are moved as they are, in units of 16 bytes, whatever numbers they hold.

`pull`: a window reads its halo from its neighbour's state, once events say that it is there; `pull_some`: the same of
particles of a mesh, which lie anywhere. `push`: it writes its border
into the neighbour's inbox, each block raises a flag of its own there, and counts its exchanges; `wait`: it waits for its own
flags; `take`, launched behind it: it reads its inbox.

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
THREADS = 512  # of a block of push and take
MOST_BLOCKS = 64  # of them: what is on its way at once fills the link, and few places are taken from all else
PATIENCE = 20_000_000_000  # ns that a block waits for a neighbour
LOOKS = 255  # at a flag between two at the clock; of a binary number, all ones


def unit_of(real: Any, dimensions: int, columns: int) -> Any:
    """The type as which a border's bytes are moved: 16 bytes, or 8 where rows of pairs of float32 are not whole ones."""
    return np.complex64 if dimensions == 2 and real is np.float32 and columns % 2 else np.complex128


def blocks_for(units: int) -> int:
    """Of push and take, for a border of so many units of each array."""
    return max(1, min(MOST_BLOCKS, -(-units // THREADS)))


@cache
def make_border_kernels(unit: Any) -> SimpleNamespace:
    """`pull`, `pull_some`, `push`, `wait`, `take`; see the inner functions. Arrays of positions and velocities are flat, of
    the complex type `unit` (see `unit_of`), in which all counts are; an inbox is too, for two exchanges both."""

    def pull(position, velocity, first, new_position, new_velocity, to, count):
        """Units `first` ... of a neighbour's state become units `to` ... of one's own."""
        k = np.int32(cuda.grid(1))
        if k < count:
            p, v = load_pair(position, np.int32(first + k)), load_pair(velocity, np.int32(first + k))
            store_pair(new_position, np.int32(to + k), p.real, p.imag)
            store_pair(new_velocity, np.int32(to + k), v.real, v.imag)

    def pull_some(position, velocity, places, new_position, new_velocity, new_places, count):
        """Unit `places[k]` of a neighbour's state becomes unit `new_places[k]` of one's own, k < count."""
        k = np.int32(cuda.grid(1))
        if k < count:
            p, v = load_pair(position, places[k]), load_pair(velocity, places[k])
            store_pair(new_position, new_places[k], p.real, p.imag)
            store_pair(new_velocity, new_places[k], v.real, v.imag)

    def push(position, velocity, first, count, inbox, flags, sent):
        """Units `first` ... into the neighbour's `inbox` (4 x count units), its half told by the exchange's number, which is
        one more than the block has `sent`."""
        block = np.int32(cuda.blockIdx.x)
        number = np.int32(sent[block] + 1)
        half = np.int32((number & 1) * 2 * count)
        k = np.int32(cuda.grid(1))
        while k < count:
            p, v = load_pair(position, np.int32(first + k)), load_pair(velocity, np.int32(first + k))
            store_pair(inbox, np.int32(half + k), p.real, p.imag)
            store_pair(inbox, np.int32(half + count + k), v.real, v.imag)
            k = np.int32(k + cuda.gridsize(1))
        cuda.syncthreads()  # the release that follows is of what all threads of the block wrote
        if cuda.threadIdx.x == 0:
            raise_system_flag(flags, np.int32(block * FLAG_STRIDE), number)
            sent[block] = number

    def wait(flags, count, taken, failed):
        """Until all `count` flags of the exchange after the last one `taken` are there, which it then is; `failed` (1,) is
        set to 1 where they never come. One block of as many threads, so that little is kept from what else could run."""
        number = np.int32(taken[0] + 1)
        flag = np.int32(cuda.threadIdx.x)
        if flag < count:
            begin = nanoseconds()
            looks = np.int32(0)
            while np.int32(read_system_flag(flags, np.int32(flag * FLAG_STRIDE)) - number) < 0:
                looks = np.int32(looks + 1)
                if (looks & LOOKS) == 0:
                    if failed[0] != 0 or nanoseconds() - begin > PATIENCE:
                        failed[0] = 1
                        break
        cuda.syncthreads()
        if flag == 0:
            taken[0] = number

    def take(position, velocity, to, count, inbox, taken):
        """What the neighbour pushed for the last exchange `taken` becomes units `to` ... of the state."""
        half = np.int32((taken[0] & 1) * 2 * count)
        k = np.int32(cuda.grid(1))
        while k < count:
            p, v = load_fresh_pair(inbox, np.int32(half + k)), load_fresh_pair(inbox, np.int32(half + count + k))
            store_pair(position, np.int32(to + k), p.real, p.imag)
            store_pair(velocity, np.int32(to + k), v.real, v.imag)
            k = np.int32(k + cuda.gridsize(1))

    return make_kernels((pull, pull_some, push, wait, take), variant_name(unit))
