"""Sums of Newton's method on CUDA. In `exact` math in the CPU's order: SUMMED tetrahedra or particles one after the
other, then their sums. In `fast` math over warps, in another order that is always the same.

`shared` is a block's memory of ROOM numbers. A team is a warp; under the simulator, which has none, a whole block.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.device import simulated
from softlab.model.base.types import Real
from softlab.model.tetrahedra.newton import SUMMED

TEAM = 32  # threads
THREADS = TEAM if simulated() else 256  # per block; the simulator's are Python threads
UNIT = max(THREADS, SUMMED)  # tetrahedra that a block processes at once
TEAMS = THREADS // TEAM
CAPACITY = 2560  # numbers
SLOTS = THREADS if simulated() else TEAMS  # partial sums of a block's threads, if teams have no shuffles
EVERY = 0xFFFFFFFF  # lanes of a warp


@cache
def make_sums(real: Real, math: str) -> SimpleNamespace:
    """Make `synchronize_team`, `add_groups`, `total` and `add_team`.

    `synchronize_team()`: a barrier of a team. `add_groups(shared, sums, width, group, count, parts)`: of the `sums` x UNIT
    numbers in `shared`, of which `width` count, the sums of each SUMMED become parts[s count + group], + 1, ...
    `total(shared, sums, count, parts)`: the sums of all `count`, in shared[0], shared[1]. `add_team(shared, base,
    columns, lane, running)`: of `columns` x TEAM numbers from `base` on, lane c adds those of column c to `running`.
    """
    inline, zero, warps = inlined(math), real(0), not simulated()
    summed, unit, team, capacity = np.int32(SUMMED), np.int32(UNIT), np.int32(TEAM), np.int32(CAPACITY // 2)

    @inline
    def synchronize_team():
        if warps:
            cuda.syncwarp()
        else:
            cuda.syncthreads()

    @inline
    def add_groups(shared, sums, width, group, count, parts):
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        groups = np.int32((width + summed - 1) // summed)
        cuda.syncthreads()
        for one in range(t, sums * groups, threads):
            s, g = np.int32(one // groups), np.int32(one % groups)
            running, first = zero, np.int32(s * unit + g * summed)
            for n in range(summed):
                running = running + shared[first + n]
            parts[s * count + group + g] = running
        cuda.syncthreads()

    @inline
    def total(shared, sums, count, parts):
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        running = zero
        for first in range(0, count, capacity):
            many = np.int32(min(capacity, np.int32(count - first)))
            cuda.syncthreads()
            for s in range(sums):
                for n in range(t, many, threads):
                    shared[s * capacity + n] = parts[s * count + first + n]
            cuda.syncthreads()
            if t < sums:
                for n in range(many):
                    running = running + shared[t * capacity + n]
        cuda.syncthreads()
        if t < sums:
            shared[t] = running
        cuda.syncthreads()

    @inline
    def add_team(shared, base, columns, lane, running):
        synchronize_team()
        if lane < columns:
            first = np.int32(base + lane * team)
            for n in range(team):
                running = running + shared[first + n]
        synchronize_team()
        return running

    functions = {"synchronize_team": synchronize_team, "add_groups": add_groups, "total": total, "add_team": add_team}
    if math != "exact":
        quick = make_quick_totals(real, math)
        functions |= {"add_groups": quick.add_groups, "total": quick.total}
    return SimpleNamespace(**functions)


@cache
def make_quick_sums(real: Real, math: str) -> SimpleNamespace:
    """Make `of_block`, `of_team`, `of_four`, `put` and `slots`. All threads of a block must call them.

    `of_block(shared, base, x)`: the sum of all threads' x, for each of them; `of_team(shared, x)`: of a team's, for its
    first lane; `of_four(shared, x)`: of four neighbours', for the first. `put(shared, place, x)`: into the slots
    `place` SLOTS ... of a block, to be summed by `slots(shared, place)` after a barrier.
    """
    inline, zero, warps = inlined(math), real(0), not simulated()
    team, slot_count, scratch = np.int32(TEAM), np.int32(SLOTS), np.int32(CAPACITY - THREADS)

    @inline
    def of_team(shared, x):
        if warps:
            x = x + cuda.shfl_down_sync(EVERY, x, 16)
            x = x + cuda.shfl_down_sync(EVERY, x, 8)
            x = x + cuda.shfl_down_sync(EVERY, x, 4)
            x = x + cuda.shfl_down_sync(EVERY, x, 2)
            x = x + cuda.shfl_down_sync(EVERY, x, 1)
        else:
            x = neighbours(shared, x, team)
        return x

    @inline
    def neighbours(shared, x, count):
        """Return the sum without shuffles."""
        t = np.int32(cuda.threadIdx.x)
        cuda.syncthreads()
        shared[scratch + t] = x
        cuda.syncthreads()
        if t % count == 0:
            for n in range(1, count):
                x = x + shared[scratch + t + n]
        cuda.syncthreads()
        return x

    @inline
    def of_four(shared, x):
        if warps:
            x = x + cuda.shfl_down_sync(EVERY, x, 2)
            x = x + cuda.shfl_down_sync(EVERY, x, 1)
        else:
            x = neighbours(shared, x, np.int32(4))
        return x

    @inline
    def put(shared, place, x):
        t = np.int32(cuda.threadIdx.x)
        if warps:
            x = of_team(shared, x)
            if t % team == 0:
                shared[place * slot_count + t // team] = x
        else:
            shared[place * slot_count + t] = x

    @inline
    def slots(shared, place):
        running = zero
        for n in range(SLOTS):
            running = running + shared[place * slot_count + n]
        return running

    @inline
    def of_block(shared, base, x):
        cuda.syncthreads()
        put(shared, base, x)
        cuda.syncthreads()
        return slots(shared, base)

    return SimpleNamespace(of_team=of_team, of_four=of_four, put=put, slots=slots, of_block=of_block)


@cache
def make_quick_totals(real: Real, math: str) -> SimpleNamespace:
    """Make `add_groups` and `total` of `make_sums`, by warps; the first of groups gets all of a block's, the others
    zero."""
    inline, quick, zero = inlined(math), make_quick_sums(real, math), real(0)
    put, slots, of_block = quick.put, quick.slots, quick.of_block
    summed, unit, free = np.int32(SUMMED), np.int32(UNIT), np.int32(2 * UNIT // SLOTS)

    @inline
    def add_groups(shared, sums, width, group, count, parts):
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        cuda.syncthreads()
        for s in range(sums):
            running = zero
            for n in range(t, width, threads):
                running = running + shared[s * unit + n]
            running = of_block(shared, free, running)
            groups = np.int32((width + summed - 1) // summed)
            for n in range(t, groups, threads):
                parts[s * count + group + n] = running if n == 0 else zero
        cuda.syncthreads()

    @inline
    def total(shared, sums, count, parts):
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        one, other = zero, zero
        for n in range(t, count, threads):
            one = one + parts[n]
            if sums > 1:
                other = other + parts[count + n]
        cuda.syncthreads()
        put(shared, np.int32(1), one)
        put(shared, np.int32(2), other)
        cuda.syncthreads()
        one, other = slots(shared, np.int32(1)), slots(shared, np.int32(2))
        if t == 0:
            shared[0], shared[1] = one, other
        cuda.syncthreads()

    return SimpleNamespace(add_groups=add_groups, total=total)
