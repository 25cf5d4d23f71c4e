"""The kernel `resident` of the cloth: the whole sheet on the chip, one tile per block, for thousands of steps.

In the last step of a round of `halo` steps (mass_spring/cloth/tiling.py) a thread sends each mass of its block's border
as soon as it is computed, as a message with its tag (core/messages.py). The block's threads then poll the masses around
those that the block owns until they have the tags of this round. No flags and no barrier of the whole sheet: a block
only waits for what it needs. All blocks must run at once, which a cooperative launch guarantees.

Two alternating message buffers are enough. A block needs masses of another one exactly if the other needs masses of it
(both depend on the distance between their own masses), and it sends round n + 2 only after it has round n + 1 of that
other block, which sent it after it had read round n.

Lower bounds of a step, by the data sheet of an H200 in float32 with 12 springs: a mass takes about 260 operations (of
67 TFLOP/s, half of which such a mixture reaches) and 20 to 39 accesses of 4 bytes to shared memory (132 x 128 bytes per
cycle), so 8 us for 1024 x 1024 masses and 0.5 us for 256 x 256. A launched pass moves 64 bytes per mass through memory,
17 us at 4 TB/s for the former. Below 256 x 256 the latency of a message counts: a store and a load, in sequence,
through the second-level cache, about 600 cycles or 0.35 us.
"""

from __future__ import annotations

from functools import cache
from math import prod
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.blocks import PATIENCE, raise_flag, read_flag
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.messages import make_messages, pause
from softlab.gpu_backend.core.planes import near
from softlab.gpu_backend.core.tiling import Tile
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.strips import Moment, Strip
from softlab.gpu_backend.mass_spring.cloth.tiles import cloth_blocks_together, make_tile_parts
from softlab.gpu_backend.mass_spring.cloth.tiling import fields, plane_shape

# Cycles between a block's own sending and its first check of others' messages. All blocks send at about the same time,
# and a check that comes a little too soon costs another memory access, about 600 cycles.
FIRST_CHECK = 0


@cache
def _make_publish(real: Any, math: str, keeps: bool) -> Any:
    send = make_messages(real).send

    @inlined(math)
    def publish(k, x, y, z, vx, vy, vz, post):
        border_position, border_velocity, turn, tag = post
        at = np.int32(turn + k)
        send(border_position, at, x, y, z, tag)
        if keeps:
            send(border_velocity, at, vx, vy, vz, tag)

    return publish


@cache
def _make_fetch(real: Any, math: str, keeps: bool, most: int, put: Any, first_check: int) -> Any:
    """Make fetch(border_position, border_velocity, turn, tag, shared, new, numbers, places, wanted, failed).

    It waits for the messages of the masses whose bit is set in `wanted`, and writes them into the copy of the planes at
    `new`.
    """
    receive = make_messages(real).receive
    zero = real(0)

    @inlined(math)
    def fetch(border_position, border_velocity, turn, tag, shared, new, numbers, places, wanted, failed):
        x, y, z = cuda.local.array(most, real), cuda.local.array(most, real), cuda.local.array(most, real)
        vx, vy, vz = cuda.local.array(most, real), cuda.local.array(most, real), cuda.local.array(most, real)
        checks = np.int32(0)
        if first_check > 0:
            pause(np.int32(first_check))
        while wanted != 0:
            come = np.int32(0)
            for m in range(most):  # all are loaded before the first is waited for
                if wanted & np.int32(1 << m):
                    at = np.int32(turn + numbers[m])
                    x[m], y[m], z[m], here = receive(border_position, at, tag)
                    vx[m], vy[m], vz[m] = zero, zero, zero
                    if keeps:
                        vx[m], vy[m], vz[m], also = receive(border_velocity, at, tag)
                        here = here and also
                    if here:
                        come = come | np.int32(1 << m)
            for m in range(most):
                if come & np.int32(1 << m):
                    put(shared, np.int32(new + places[m]), x[m], y[m], z[m], vx[m], vy[m], vz[m])
            wanted = wanted & ~come
            checks += np.int32(1)
            if checks > PATIENCE or ((checks & 1023) == 0 and read_flag(failed, 0) != 0):
                raise_flag(failed, 0, np.int32(1))
                break

    return fetch


@cache
def make_cloth_resident(real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile) -> Any:
    """Compile kernel(position, velocity, new_position, new_velocity, border_position, border_velocity, epoch, failed,
    record, bodies, integers, counter, passes, rows, columns): `passes` passes of the whole sheet, from the old state to
    the new one.

    `border_*` (2 * particles * message_size,): messages, two alternating rounds, with tags `epoch` + 1, + 2, ... (the
    caller increases `epoch` by the exchanges of each launch); that of velocities has 1 number if tiling.fields is 3.
    `failed` (1,) int32 is set to 1 by a block whose messages never arrive. Launched cooperatively, one block per tile,
    of tile.threads threads in a row, and tiling.tile_bytes of shared memory.
    """
    keeps = fields(tile, parts) == 6
    f = make_tile_parts(real, math, integrator, parts, tile, _make_publish(real, math, keeps))
    constants, sides, step, place_of, bits_between = f.constants, f.sides, f.step, f.place_of, f.bits_between
    clear, read, read_other, write, around = f.clear, f.read, f.read_other, f.write, f.around
    first_air, air_of, current_step = f.first_air, f.air_of, f.current_step
    half, most, pitch, border_bits = f.half, f.most, f.pitch, f.border_bits
    fetch = _make_fetch(real, math, keeps, most, f.put, FIRST_CHECK)
    area, renews = prod(plane_shape(tile, parts)), tile.halo > 1
    strip, threads, halo = tile.strip, np.int32(tile.threads), tile.halo
    scalar = np.dtype(real) if simulated() else real
    every, nothing = np.int32((1 << strip) - 1), np.int32(0)
    inline = inlined(math)

    @inline
    def renew(shared, at, strange, vx, vy, vz):
        """Load the velocities of masses that others own into registers."""
        for r in range(strip):
            if strange & np.int32(1 << r):
                place = np.int32(at + np.int32(r) * pitch)
                vx[r], vy[r] = near(shared, place, 3 * area), near(shared, place, 4 * area)
                vz[r] = near(shared, place, 5 * area)

    def cloth_resident(
        position, velocity, new_position, new_velocity, border_position, border_velocity, epoch, failed, record, bodies,
        integers, counter, passes, rows, columns,
    ):  # fmt: skip
        parameters = record[0]
        shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
        vx, vy, vz = cuda.local.array(strip, real), cuda.local.array(strip, real), cuda.local.array(strip, real)
        numbers, places = cuda.local.array(most, np.int32), cuda.local.array(most, np.int32)
        rows, columns, thread = np.int32(rows), np.int32(columns), np.int32(cuda.threadIdx.x)
        i, j, k, place, extent = place_of(rows, columns)
        _, row_first, row_end, _, column_first, column_end = extent
        owned_rows = nothing
        if j >= column_first and j < column_end:
            owned_rows = bits_between(row_first, row_end, i)
        border = border_bits(owned_rows, i, j, extent, rows, columns)
        values, where = constants(parameters), sides(Cell(i, j, rows, columns))
        world = World(values, bodies, integers)
        first = current_step(counter, np.int64(0))
        clear(shared, thread)
        cuda.syncthreads()
        pin_bits = read(position, velocity, shared, place, (vx, vy, vz), k, columns)
        wanted = nothing
        for m in range(most):
            numbers[m], places[m] = around(np.int32(thread + np.int32(m) * threads), extent, rows, columns)
            if numbers[m] >= 0:
                wanted = wanted | np.int32(1 << m)
                read_other(position, velocity, shared, numbers[m], places[m])
        first_air(values, integers, first, shared, thread)
        cuda.syncthreads()
        old, turn, tag, left = np.int32(0), np.int32(0), np.int32(epoch), np.int32(halo)
        particles = np.int32(rows * columns)
        for number in range(passes):
            new, now = np.int32(half - old), first + number
            left = np.int32(left - 1)
            exchange = left == 0 and number + 1 < passes
            active, sending = every, nothing
            if exchange:
                active, sending, left = owned_rows, border, np.int32(halo)
                tag = np.int32(tag + 1)
            air = air_of(values, integers, now, shared, thread, number)
            masses = Strip(where, active, sending, pin_bits, vx, vy, vz)
            moment = Moment(position, world, now, air, (border_position, border_velocity, turn, tag))
            step(shared, old, new, place, masses, k, columns, moment)
            if exchange:
                fetch(border_position, border_velocity, turn, tag, shared, new, numbers, places, wanted, failed)
                turn = np.int32(particles - turn)
            cuda.syncthreads()
            if renews:
                if exchange:
                    renew(shared, np.int32(new + place), every & ~owned_rows, vx, vy, vz)
            old = new
        write(position, new_position, new_velocity, owned_rows, shared, np.int32(old + place), (vx, vy, vz), k, columns)

    bounds = (tile.threads, cloth_blocks_together(real, tile, parts))
    variant = variant_name(real, math, integrator, parts, tile.name, FIRST_CHECK)
    return make_kernel(cloth_resident, variant, launch_bounds=bounds, **kernel_options(math))
