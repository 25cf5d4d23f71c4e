"""A small grid in one block: thousands of steps in one launch, the grid in shared memory, one thread per mass.

Positions lie twice in shared memory, old and new in turn; each thread keeps its own position and velocity in registers.
A pass reads the neighbours from one copy and writes the other, and the block's barrier is the only synchronisation: a
step costs what its arithmetic and one barrier take, not a launch. Grids of up to 1024 masses fit, the lab grid exactly.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.device import simulated
from gpu_backend.pairs import load_pair, store_pair
from gpu_backend.point import kernel_options, make_moves, make_point_functions

MOST_MASSES = 1024  # the most threads of a block
REGISTERS = 64  # a thread's share of the 65 536 registers when 1024 threads run


@cache
def make_one_block(real: Any, math: str, integrator: str, parts: frozenset[str]) -> Any:
    """kernel(position, velocity, record, integers, counter, passes, pinned, rows, columns), launched with one block.

    Moves the state of at most MOST_MASSES masses in place by `passes` passes, numbered from the step counter: as many
    as steps, one more for velocity Verlet.
    """
    current_step = make_point_functions(real, math, integrator, parts).current_step
    moves = make_moves(real, math, integrator, parts)
    verlet = "middle" in moves
    middle = moves["middle"] if verlet else moves["step"]
    opening, closing = moves.get("opening", middle), moves.get("closing", middle)
    has_pins = "pins" in parts
    pair = np.complex64 if real is np.float32 else np.complex128
    places = 2 * MOST_MASSES
    half = np.int32(MOST_MASSES)
    options = kernel_options(math)
    zero = real(0)

    @cuda.jit(device=True, **options)
    def advance(both, position, velocity, record, integers, counter, passes, pinned, rows, columns):
        rows = np.int32(rows)
        columns = np.int32(columns)
        k = np.int32(cuda.threadIdx.x)
        inside = k < rows * columns
        i = np.int32(k // columns)
        j = np.int32(k - i * columns)
        held = False
        p, v = load_pair(position, 0), load_pair(velocity, 0)
        if inside:
            p, v = load_pair(position, k), load_pair(velocity, k)
            store_pair(both, k, p.real, p.imag)
            if has_pins:
                held = pinned[k] != 0
        px, py, vx, vy = p.real, p.imag, v.real, v.imag
        cuda.syncthreads()
        for number in range(passes):
            turn = np.int32(number % 2) * half
            old = both[turn : turn + half]
            if inside:
                p, v = pair(complex(px, py)), pair(complex(vx, vy))
                step = current_step(counter, number)
                if verlet and number == 0:
                    px, py, vx, vy = opening(k, i, j, old, p, v, record, integers, step, rows, columns)
                elif verlet and number == passes - 1:
                    px, py, vx, vy = closing(k, i, j, old, p, v, record, integers, step, rows, columns)
                else:
                    px, py, vx, vy = middle(k, i, j, old, p, v, record, integers, step, rows, columns)
                if held:
                    px, py, vx, vy = p.real, p.imag, zero, zero
                store_pair(both, half - turn + k, px, py)
            cuda.syncthreads()
        if inside:
            store_pair(position, k, px, py)
            store_pair(velocity, k, vx, vy)

    if simulated():  # which knows no alignment

        @cuda.jit
        def one_block(position, velocity, record, integers, counter, passes, pinned, rows, columns):
            both = cuda.shared.array(places, pair)
            advance(both, position, velocity, record, integers, counter, passes, pinned, rows, columns)

    else:

        @cuda.jit(max_registers=REGISTERS, **options)
        def one_block(position, velocity, record, integers, counter, passes, pinned, rows, columns):
            both = cuda.shared.array(places, pair, alignment=16)
            advance(both, position, velocity, record, integers, counter, passes, pinned, rows, columns)

    return one_block
