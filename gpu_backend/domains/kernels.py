"""The kernels that transfer halos between windows: bytes of positions and velocities are copied unchanged, in units of
16 bytes, whatever numbers they are. A border of a sheet is neighbouring rows, and so one run of bytes of each.

`pull_some`: a window of a mesh reads particles of its neighbour's state, once events mark it as complete. `push`: a
window of a sheet writes its border into the neighbour's inbox, each block sets its own flag there, and counts its
exchanges; `wait`: it waits for its own flags; `take`, launched behind it: it reads its inbox.

Two alternating halves of an inbox are enough: a window pushes number n + 2 only after it took number n + 1, which the
neighbour pushed after it had taken number n.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.blocks import load_fresh_pair
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.pairs import load_pair, store_pair
from softlab.gpu_backend.domains.system_flags import nanoseconds, raise_system_flag, read_system_flag
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

FLAG_STRIDE = 32  # int32 between two flags: a 128-byte line each
THREADS = 512  # per block of push and take
MOST_BLOCKS = 64  # maximum number: the bytes in flight fill the link, and few multiprocessors are occupied
PATIENCE = 20_000_000_000  # ns that a block waits for a neighbour
CHECKS = 255  # checks of a flag between two of the clock; all binary digits are ones


def unit_of(real: Real, dimensions: int, columns: int) -> type:
    """Return the type in which a border's bytes are copied: 16 bytes, or 8 if rows of pairs of float32 are not a
    multiple."""
    return np.complex64 if dimensions == 2 and real is np.float32 and columns % 2 else np.complex128


def blocks_for(units: int) -> int:
    """Return the blocks of push and take, for a border of so many units of each array."""
    return max(1, min(MOST_BLOCKS, -(-units // THREADS)))


@routine
def pull_some(position, velocity, places, new_position, new_velocity, new_places, count):
    """Copy unit `places[k]` of a neighbour's state to unit `new_places[k]` of the local state, k < count."""
    k = np.int32(cuda.grid(1))
    if k < count:
        p, v = load_pair(position, places[k]), load_pair(velocity, places[k])
        store_pair(new_position, new_places[k], p.real, p.imag)
        store_pair(new_velocity, new_places[k], v.real, v.imag)


@routine
def push(position, velocity, first, count, inbox, flags, sent):
    """Copy units `first` ... into the neighbour's `inbox` (4 x count units), into the half given by the exchange's
    number, which is one more than the block has `sent`."""
    block = np.int32(cuda.blockIdx.x)
    number = np.int32(sent[block] + 1)
    half = np.int32((number & 1) * 2 * count)
    k = np.int32(cuda.grid(1))
    while k < count:
        p, v = load_pair(position, np.int32(first + k)), load_pair(velocity, np.int32(first + k))
        store_pair(inbox, np.int32(half + k), p.real, p.imag)
        store_pair(inbox, np.int32(half + count + k), v.real, v.imag)
        k = np.int32(k + cuda.gridsize(1))
    cuda.syncthreads()  # the following release covers the writes of all threads of the block
    if cuda.threadIdx.x == 0:
        raise_system_flag(flags, np.int32(block * FLAG_STRIDE), number)
        sent[block] = number


@routine
def wait(flags, count, taken, failed):
    """Wait until all `count` flags of the exchange after the last one `taken` are set, and increment `taken`.

    `failed` (1,) is set to 1 on a timeout. One block of as many threads, so that most of the GPU stays free for
    other work.
    """
    number = np.int32(taken[0] + 1)
    flag = np.int32(cuda.threadIdx.x)
    if flag < count:
        begin = nanoseconds()
        checks = np.int32(0)
        while np.int32(read_system_flag(flags, np.int32(flag * FLAG_STRIDE)) - number) < 0:
            checks = np.int32(checks + 1)
            if (checks & CHECKS) == 0:
                if failed[0] != 0 or nanoseconds() - begin > PATIENCE:
                    failed[0] = 1
                    break
    cuda.syncthreads()
    if flag == 0:
        taken[0] = number


@routine
def take(position, velocity, to, count, inbox, taken):
    """Copy the data of the last exchange `taken` to units `to` ... of the state."""
    half = np.int32((taken[0] & 1) * 2 * count)
    k = np.int32(cuda.grid(1))
    while k < count:
        p, v = load_fresh_pair(inbox, np.int32(half + k)), load_fresh_pair(inbox, np.int32(half + count + k))
        store_pair(position, np.int32(to + k), p.real, p.imag)
        store_pair(velocity, np.int32(to + k), v.real, v.imag)
        k = np.int32(k + cuda.gridsize(1))


@cache
def make_border_kernels(unit: type) -> SimpleNamespace:
    """Compile `pull_some`, `push`, `wait`, `take`.

    Arrays of positions and velocities are flat, of the complex type `unit` (see `unit_of`), in which all counts are; so
    is an inbox, for two exchanges of both.
    """
    return kernels_of(device_variant(np.float64, "exact"), "exact", (pull_some, push, wait, take), variant_name(unit))
