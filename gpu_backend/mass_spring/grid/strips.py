"""The step of a block's tile: positions in shared memory, velocities in the registers of each mass's thread.

A thread owns `strip` masses below one another. Going down its strip it computes each vertical spring once, and passes
the pull to the next mass with its sign changed. Positions are stored twice in shared memory: a step reads one copy and
writes the other, so one barrier per step is enough. In `exact` math the sums are those of mass_spring/grid/point.py,
bit for bit.

Velocities are arrays of `strip` numbers in registers: the compiler unrolls every loop over a strip, and
tests/mass_spring/test_ptx.py checks that nothing is left in local memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.pairs import load_pair, store_pair
from softlab.gpu_backend.core.tiling import Tile
from softlab.gpu_backend.mass_spring.grid.point import pair
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, inlined_routine
from softlab.model.core.parameters import PARAMETERS
from softlab.model.formulas.springs import spring_acceleration_2d

ON_TILES = PARAMETERS[
    : PARAMETERS.index("stiff")
]  # without those of alternating springs, which no kernel on tiles supports
move = Open("move(k, ax, ay, p, v, parameters, integers, step): of point.moves_of")


class StripState(NamedTuple):
    """The strip of a thread: row and column of its first mass, that mass's index in shared memory and those of its
    neighbours to the left and right (relative), above, and below the strip; velocities in registers; bits of pinned
    masses."""

    i: int
    j: int
    place: int
    left: int
    right: int
    above: int
    below: int
    vx: np.ndarray
    vy: np.ndarray
    pinned: int


def pair_type(real: Real) -> np.dtype | type:
    """Return the complex type of both axes, in the form for shared arrays."""
    pair = np.complex64 if real is np.float32 else np.complex128
    return np.dtype(pair) if simulated() else pair


def shared_bytes(real: Real, tile: Tile) -> int:
    """Return the shared memory of a block [bytes]: two copies of the tile's positions. It is dynamic, with its size
    given at the launch: more than 48 KB are not available otherwise."""
    return 2 * tile.masses * 2 * np.dtype(real).itemsize


@inlined_routine
def read_strip(position, velocity, vx, vy, both, place, cell):
    """Read a thread's strip from device memory."""
    width = np.int32(FEATURE.tile_columns)
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    for r in range(FEATURE.strip):
        row = i + np.int32(r)
        p, v = pair(0), pair(0)
        if row < rows and j < columns:
            k = np.int32(row * columns + j)
            p, v = load_pair(position, k), load_pair(velocity, k)
        vx[r], vy[r] = v.real, v.imag
        store_pair(both, place + np.int32(r) * width, p.real, p.imag)


@inlined_routine
def pin_bits_of(pinned, cell):
    """Return bits: bit r is set if mass r of the strip is pinned."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    bits = np.int32(0)
    if FEATURE.pins:
        for r in range(FEATURE.strip):
            row = i + np.int32(r)
            if row < rows and j < columns:
                if pinned[np.int32(row * columns + j)] != 0:
                    bits = bits | np.int32(1 << r)
    return bits


@inlined_routine
def pin(both, old, new, state):
    """Reset pinned masses to their old positions."""
    width = np.int32(FEATURE.tile_columns)
    for r in range(FEATURE.strip):
        if state.pinned & np.int32(1 << r):
            here = state.place + np.int32(r) * width
            p = load_pair(both, old + here)
            state.vx[r], state.vy[r] = 0.0, 0.0
            store_pair(both, new + here, p.real, p.imag)


@inlined_routine
def step_strip(both, old, new, state, parameters, integers, number, rows, columns):
    """Do one pass of a strip, from the copy of the positions that starts at `old` into the one at `new`. FEATURE.cut: the
    grid's last row may be inside a strip."""
    width = np.int32(FEATURE.tile_columns)
    place, left, right, vx, vy = state.place, state.left, state.right, state.vx, state.vy
    stiffness, rest = parameters.stiffness, parameters.stiffness_rest
    p = load_pair(both, old + place)
    q, left_p, right_p = p, p, p
    up_x, up_y = 0.0, 0.0  # the pull between the mass above and this one, on the mass above
    if FEATURE.springs:
        over = load_pair(both, old + state.above)
        under = load_pair(both, old + state.below)
        left_p, right_p = load_pair(both, old + place + left), load_pair(both, old + place + right)
        up_x, up_y = spring_acceleration_2d(p.real - over.real, p.imag - over.imag, stiffness, rest)
    if FEATURE.strip > 1:
        q = load_pair(both, old + place + width)
    for r in range(FEATURE.strip):
        here = place + np.int32(r) * width
        row = state.i + np.int32(r)
        # Loaded before this mass is stored, since no load may overtake a store: the next ones' neighbours.
        next_left, next_right, next_q = left_p, right_p, q
        if r < FEATURE.strip - 1:
            if FEATURE.springs:
                next_left = load_pair(both, old + here + width + left)
                next_right = load_pair(both, old + here + width + right)
            if r < FEATURE.strip - 2:
                next_q = load_pair(both, old + here + np.int32(2) * width)
        ax, ay = 0.0, 0.0
        if FEATURE.springs:
            right_x, right_y = spring_acceleration_2d(right_p.real - p.real, right_p.imag - p.imag, stiffness, rest)
            left_x, left_y = spring_acceleration_2d(left_p.real - p.real, left_p.imag - p.imag, stiffness, rest)
            if r < FEATURE.strip - 1:
                down_x, down_y = spring_acceleration_2d(q.real - p.real, q.imag - p.imag, stiffness, rest)
                if FEATURE.cut:
                    if row == rows - 1:
                        down_x, down_y = 0.0, 0.0
            else:
                down_x, down_y = spring_acceleration_2d(under.real - p.real, under.imag - p.imag, stiffness, rest)
            ax, ay = (right_x + left_x) + (down_x - up_x), (right_y + left_y) + (down_y - up_y)
            up_x, up_y = down_x, down_y
        k = np.int32(row * columns + state.j)
        v = pair(complex(vx[r], vy[r]))
        px, py, vx[r], vy[r] = move(k, ax, ay, p, v, parameters, integers, number)
        store_pair(both, new + here, px, py)
        p, q, left_p, right_p = q, next_q, next_left, next_right
    if FEATURE.pins:
        if state.pinned != 0:
            pin(both, old, new, state)
