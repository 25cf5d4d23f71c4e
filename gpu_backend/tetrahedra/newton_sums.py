"""Sums of Newton's method on CUDA. In `exact` math in the CPU's order: SUMMED tetrahedra or particles one after the
other, then their sums. In `fast` math over warps, in another order that is always the same.

`shared` is a block's memory of CAPACITY numbers. A team is a warp; under the simulator, which has none, a whole block.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.tetrahedra.newton import SUMMED

TEAM = 32  # threads
WARPS = not simulated()
THREADS = TEAM if simulated() else 256  # per block; the simulator's are Python threads
UNIT = max(THREADS, SUMMED)  # tetrahedra that a block processes at once
TEAMS = THREADS // TEAM
CAPACITY = 2560  # numbers
SLOTS = THREADS if simulated() else TEAMS  # partial sums of a block's threads, if teams have no shuffles
EVERY = 0xFFFFFFFF  # lanes of a warp


@inlined_routine
def synchronize_team():
    """Wait for all threads of a team."""
    if WARPS:
        cuda.syncwarp()
    else:
        cuda.syncthreads()


@inlined_routine
def of_team(shared, x):
    """Return the sum of a team's x, for its first lane."""
    if WARPS:
        x = x + cuda.shfl_down_sync(EVERY, x, 16)
        x = x + cuda.shfl_down_sync(EVERY, x, 8)
        x = x + cuda.shfl_down_sync(EVERY, x, 4)
        x = x + cuda.shfl_down_sync(EVERY, x, 2)
        x = x + cuda.shfl_down_sync(EVERY, x, 1)
    else:
        x = neighbours(shared, x, np.int32(TEAM))
    return x


@inlined_routine
def neighbours(shared, x, count):
    """Return the sum without shuffles."""
    t = np.int32(cuda.threadIdx.x)
    cuda.syncthreads()
    shared[CAPACITY - THREADS + t] = x
    cuda.syncthreads()
    if t % count == 0:
        for n in range(1, count):
            x = x + shared[CAPACITY - THREADS + t + n]
    cuda.syncthreads()
    return x


@inlined_routine
def of_four(shared, x):
    """Return the sum of four neighbours' x, for the first."""
    if WARPS:
        x = x + cuda.shfl_down_sync(EVERY, x, 2)
        x = x + cuda.shfl_down_sync(EVERY, x, 1)
    else:
        x = neighbours(shared, x, np.int32(4))
    return x


@inlined_routine
def put(shared, place, x):
    """Write x into the slots of a block at `place`, to be summed by `slots` after a barrier."""
    t = np.int32(cuda.threadIdx.x)
    if WARPS:
        x = of_team(shared, x)
        if t % TEAM == 0:
            shared[place * SLOTS + t // TEAM] = x
    else:
        shared[place * SLOTS + t] = x


@inlined_routine
def slots(shared, place):
    """Return the sum of a block's slots at `place`."""
    running = 0.0
    for n in range(SLOTS):
        running = running + shared[place * SLOTS + n]
    return running


@inlined_routine
def of_block(shared, base, x):
    """Return the sum of all threads' x, for each of them."""
    cuda.syncthreads()
    put(shared, base, x)
    cuda.syncthreads()
    return slots(shared, base)


@inlined_routine
def add_groups(shared, sums, width, group, count, parts):
    """Write the sums of groups. Of the `sums` x UNIT numbers in `shared`, of which `width` count, the sums of each SUMMED
    become parts[s count + group], + 1, ... In fast math the first of groups gets all of a block's, the others zero."""
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    if FEATURE.fast:
        cuda.syncthreads()
        for s in range(sums):
            running = 0.0
            for n in range(t, width, threads):
                running = running + shared[s * UNIT + n]
            running = of_block(shared, np.int32(2 * UNIT // SLOTS), running)
            groups = np.int32((width + SUMMED - 1) // SUMMED)
            for n in range(t, groups, threads):
                parts[s * count + group + n] = running if n == 0 else 0.0
        cuda.syncthreads()
    else:
        groups = np.int32((width + SUMMED - 1) // SUMMED)
        cuda.syncthreads()
        for one in range(t, sums * groups, threads):
            s, g = np.int32(one // groups), np.int32(one % groups)
            running, first = 0.0, np.int32(s * UNIT + g * SUMMED)
            for n in range(np.int32(SUMMED)):
                running = running + shared[first + n]
            parts[s * count + group + g] = running
        cuda.syncthreads()


@inlined_routine
def total(shared, sums, count, parts):
    """Write the sums of all `count` to shared[0], shared[1]."""
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    if FEATURE.fast:
        one, other = 0.0, 0.0
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
    else:
        running = 0.0
        for first in range(0, count, CAPACITY // 2):
            many = np.int32(min(np.int32(CAPACITY // 2), np.int32(count - first)))
            cuda.syncthreads()
            for s in range(sums):
                for n in range(t, many, threads):
                    shared[s * (CAPACITY // 2) + n] = parts[s * count + first + n]
            cuda.syncthreads()
            if t < sums:
                for n in range(many):
                    running = running + shared[t * (CAPACITY // 2) + n]
        cuda.syncthreads()
        if t < sums:
            shared[t] = running
        cuda.syncthreads()


@inlined_routine
def add_team(shared, base, columns, lane, running):
    """Return `running`, to which lane c adds column c of `columns` x TEAM numbers from `base` on."""
    synchronize_team()
    if lane < columns:
        first = np.int32(base + lane * TEAM)
        for n in range(np.int32(TEAM)):
            running = running + shared[first + n]
    synchronize_team()
    return running
