"""Sums of Newton's method on CUDA, in the CPU's order: SUMMED tetrahedra or particles one after the other, then their sums.

`shared` is a block's memory of ROOM numbers. A team is a warp; under the simulator, which has none, a whole block.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined
from gpu_backend.core.device import simulated
from model.tetrahedra.newton import SUMMED

TEAM = 32  # threads
THREADS = TEAM if simulated() else 256  # of a block; the simulator's are threads of Python
UNIT = max(THREADS, SUMMED)  # tetrahedra that a block takes at once
TEAMS = THREADS // TEAM
ROOM = 2560  # numbers


@cache
def make_sums(real: Any, math: str) -> SimpleNamespace:
    """`meet_team()`: a barrier of a team; `add_groups(shared, sums, width, group, count, parts)`: of the `sums` x UNIT
    numbers in `shared`, of which `width` count, those of each SUMMED become parts[s count + group], + 1, ...;
    `total(shared, sums, count, parts)`: those of all `count`, in shared[0], shared[1]; `add_team(shared, base, columns, lane,
    running)`: of `columns` x TEAM numbers from `base` on, lane c adds those of column c to what it has."""
    inline, zero, warps = inlined(math), real(0), not simulated()
    summed, unit, team, room = np.int32(SUMMED), np.int32(UNIT), np.int32(TEAM), np.int32(ROOM // 2)

    @inline
    def meet_team():
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
        for first in range(0, count, room):
            many = np.int32(min(room, np.int32(count - first)))
            cuda.syncthreads()
            for s in range(sums):
                for n in range(t, many, threads):
                    shared[s * room + n] = parts[s * count + first + n]
            cuda.syncthreads()
            if t < sums:
                for n in range(many):
                    running = running + shared[t * room + n]
        cuda.syncthreads()
        if t < sums:
            shared[t] = running
        cuda.syncthreads()

    @inline
    def add_team(shared, base, columns, lane, running):
        meet_team()
        if lane < columns:
            first = np.int32(base + lane * team)
            for n in range(team):
                running = running + shared[first + n]
        meet_team()
        return running

    return SimpleNamespace(meet_team=meet_team, add_groups=add_groups, total=total, add_team=add_team)
