"""The kernels that carry borders of a sheet between windows. A border is neighbouring rows: one run of masses.

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
from gpu_backend.core.compile import inlined, make_kernels, variant_name
from gpu_backend.core.pairs import load_pair, store_pair
from gpu_backend.core.quads import load_quad, store_quad
from gpu_backend.domains.system_flags import nanoseconds, raise_system_flag, read_system_flag

FLAG_STRIDE = 32  # int32 between two flags: a 128-byte line each
BLOCKS, THREADS = 32, 256  # of push and take: few enough to run beside all else
PATIENCE = 20_000_000_000  # ns that a block waits for a neighbour
LOOKS = 255  # at a flag between two at the clock; of a binary number, all ones


@cache
def make_moves(axes: int) -> SimpleNamespace:
    """Device functions that copy one mass: `carry(source, i, target, j)` between states; `pack(source, i, inbox, j)`,
    `unpack(inbox, j, target, i)` to and from an inbox of pairs; `pairs`: of a mass. A state holds pairs in a plane (`axes`
    2), quads in space."""
    inline = inlined("exact")
    one, two = np.int32(1), np.int32(2)
    if axes == 2:

        @inline
        def carry(source, i, target, j):
            p = load_pair(source, i)
            store_pair(target, j, p.real, p.imag)

        @inline
        def unpack(inbox, j, target, i):
            p = load_fresh_pair(inbox, j)
            store_pair(target, i, p.real, p.imag)

        return SimpleNamespace(carry=carry, pack=carry, unpack=unpack, pairs=1)

    @inline
    def carry_quad(source, i, target, j):
        x, y, z, w = load_quad(source, i)
        store_quad(target, j, x, y, z, w)

    @inline
    def pack_quad(source, i, inbox, j):
        x, y, z, w = load_quad(source, i)
        store_pair(inbox, np.int32(two * j), x, y)
        store_pair(inbox, np.int32(two * j + one), z, w)

    @inline
    def unpack_quad(inbox, j, target, i):
        p, q = load_fresh_pair(inbox, np.int32(two * j)), load_fresh_pair(inbox, np.int32(two * j + one))
        store_quad(target, i, p.real, p.imag, q.real, q.imag)

    return SimpleNamespace(carry=carry_quad, pack=pack_quad, unpack=unpack_quad, pairs=2)


@cache
def make_border_kernels(real: Any, axes: int) -> SimpleNamespace:
    """`pull`, `push`, `take`, `count_on`; see the inner functions. Positions and velocities are complex (masses,) in a plane,
    flat quads in space; an inbox is complex, for two exchanges both."""
    moves = make_moves(axes)
    carry, pack, unpack = moves.carry, moves.pack, moves.unpack

    def pull(position, velocity, first, new_position, new_velocity, to, count):
        """Masses `first` ... of a neighbour's state become masses `to` ... of one's own."""
        k = np.int32(cuda.grid(1))
        if k < count:
            carry(position, np.int32(first + k), new_position, np.int32(to + k))
            carry(velocity, np.int32(first + k), new_velocity, np.int32(to + k))

    def push(position, velocity, first, count, inbox, flags, epoch):
        """Masses `first` ... into the neighbour's `inbox` (4 x count masses), its half told by the exchange's number."""
        number = np.int32(epoch[0] + 1)
        half = np.int32((number & 1) * 2 * count)
        k = np.int32(cuda.grid(1))
        while k < count:
            pack(position, np.int32(first + k), inbox, np.int32(half + k))
            pack(velocity, np.int32(first + k), inbox, np.int32(half + count + k))
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
            unpack(inbox, np.int32(half + k), position, np.int32(to + k))
            unpack(inbox, np.int32(half + count + k), velocity, np.int32(to + k))
            k = np.int32(k + cuda.gridsize(1))

    def count_on(epoch):
        """The exchange is over."""
        if cuda.grid(1) == 0:
            epoch[0] += 1

    return make_kernels((pull, push, take, count_on), variant_name(real, axes))
