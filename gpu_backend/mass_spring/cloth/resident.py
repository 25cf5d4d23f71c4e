"""The kernel `resident` of the cloth: the whole sheet on the chip, one tile per block, for thousands of steps.

In the last step of a round of `halo` steps (mass_spring/cloth/tiling.py) a thread sends each mass of its block's border
as soon as it is computed, as a message with its tag (core/messages.py). The block's threads then poll the masses around
those that the block owns until they have the tags of this round. No flags and no barrier of the whole sheet: a block
waits only for the masses that it needs. All blocks must run at once, which a cooperative launch guarantees.

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

from collections import namedtuple
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.blocks import PATIENCE, raise_flag, read_flag
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.messages import pause, receive, send
from softlab.gpu_backend.core.planes import near
from softlab.gpu_backend.core.tiling import Tile
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.moves import kicks_of
from softlab.gpu_backend.mass_spring.cloth.point import cloth_features, current_step, of_scene
from softlab.gpu_backend.mass_spring.cloth.strips import Moment, Strip, put, sides, step_strip, strip_functions
from softlab.gpu_backend.mass_spring.cloth.tiles import (
    air_of,
    around,
    border_bits,
    clear,
    cloth_blocks_together,
    cloth_tile_features,
    first_air,
    place_of,
    read,
    read_other,
    write,
)
from softlab.gpu_backend.mass_spring.tile_bits import bits_between
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, real, routine, unrolled
from softlab.model.contact.cloth_parameters import CLOTH_PARAMETERS

# Cycles between a block's own sending and its first check of others' messages. All blocks send at about the same time,
# and a check that comes a little too soon costs another memory access, about 600 cycles.
FIRST_CHECK = 0
Values, NUMBERS = namedtuple("Values", CLOTH_PARAMETERS), len(CLOTH_PARAMETERS)
scalar = Open("scalar: type of a number, in the form for shared arrays")


@inlined_routine
def values_of(parameters):
    """Return the record's values. A loop keeps those in registers, and would read the record again after each barrier."""
    return Values(*tuple(parameters[CLOTH_PARAMETERS[n]] for n in unrolled(NUMBERS)))


@inlined_routine
def send_mass(k, x, y, z, vx, vy, vz, post):
    border_position, border_velocity, turn, tag = post
    at = np.int32(turn + k)
    send(border_position, at, x, y, z, tag)
    if FEATURE.fields == 6:
        send(border_velocity, at, vx, vy, vz, tag)


@inlined_routine
def fetch(border_position, border_velocity, turn, tag, shared, new, numbers, places, wanted, failed):
    """Wait for the messages of the masses whose bit is set in `wanted`, and write them into the copy of the planes at
    `new`."""
    x, y = cuda.local.array(FEATURE.fetched, real), cuda.local.array(FEATURE.fetched, real)
    z = cuda.local.array(FEATURE.fetched, real)
    vx, vy = cuda.local.array(FEATURE.fetched, real), cuda.local.array(FEATURE.fetched, real)
    vz = cuda.local.array(FEATURE.fetched, real)
    checks = np.int32(0)
    if FIRST_CHECK > 0:
        pause(np.int32(FIRST_CHECK))
    while wanted != 0:
        come = np.int32(0)
        for m in range(FEATURE.fetched):  # all are loaded before the first is waited for
            if wanted & np.int32(1 << m):
                at = np.int32(turn + numbers[m])
                x[m], y[m], z[m], here = receive(border_position, at, tag)
                vx[m], vy[m], vz[m] = 0.0, 0.0, 0.0
                if FEATURE.fields == 6:
                    vx[m], vy[m], vz[m], also = receive(border_velocity, at, tag)
                    here = here and also
                if here:
                    come = come | np.int32(1 << m)
        for m in range(FEATURE.fetched):
            if come & np.int32(1 << m):
                put(shared, np.int32(new + places[m]), x[m], y[m], z[m], vx[m], vy[m], vz[m])
        wanted = wanted & ~come
        checks += np.int32(1)
        if checks > PATIENCE or ((checks & 1023) == 0 and read_flag(failed, 0) != 0):
            raise_flag(failed, 0, np.int32(1))
            break


@inlined_routine
def renew(shared, at, strange, vx, vy, vz):
    """Load the velocities of masses of other threads into registers."""
    for r in range(FEATURE.strip):
        if strange & np.int32(1 << r):
            place = np.int32(at + np.int32(r) * np.int32(FEATURE.pitch))
            vx[r], vy[r] = near(shared, place, 3 * FEATURE.area), near(shared, place, 4 * FEATURE.area)
            vz[r] = near(shared, place, 5 * FEATURE.area)


@routine
def cloth_resident(
    position, velocity, new_position, new_velocity, border_position, border_velocity, epoch, failed, record, bodies,
    integers, counter, passes, rows, columns,
):  # fmt: skip
    parameters = record[0]
    shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
    vx, vy = cuda.local.array(FEATURE.strip, real), cuda.local.array(FEATURE.strip, real)
    vz = cuda.local.array(FEATURE.strip, real)
    numbers, places = cuda.local.array(FEATURE.fetched, np.int32), cuda.local.array(FEATURE.fetched, np.int32)
    rows, columns, thread = np.int32(rows), np.int32(columns), np.int32(cuda.threadIdx.x)
    i, j, k, place, extent = place_of(rows, columns)
    _, row_first, row_end, _, column_first, column_end = extent
    owned_rows = np.int32(0)
    if j >= column_first and j < column_end:
        owned_rows = bits_between(row_first, row_end, i)
    border = border_bits(owned_rows, i, j, extent, rows, columns)
    values, where = values_of(parameters), sides(Cell(i, j, rows, columns))
    world = World(values, bodies, integers)
    first = current_step(counter, np.int64(0))
    clear(shared, thread)
    cuda.syncthreads()
    pin_bits = read(position, velocity, shared, place, (vx, vy, vz), k, columns)
    wanted = np.int32(0)
    for m in range(FEATURE.fetched):
        other = np.int32(thread + np.int32(m) * np.int32(FEATURE.threads))
        numbers[m], places[m] = around(other, extent, rows, columns)
        if numbers[m] >= 0:
            wanted = wanted | np.int32(1 << m)
            read_other(position, velocity, shared, numbers[m], places[m])
    first_air(values, integers, first, shared, thread)
    cuda.syncthreads()
    old, turn, tag, left = np.int32(0), np.int32(0), np.int32(epoch), np.int32(FEATURE.halo)
    particles = np.int32(rows * columns)
    for number in range(passes):
        new, now = np.int32(np.int32(FEATURE.fields * FEATURE.area) - old), first + number
        left = np.int32(left - 1)
        exchange = left == 0 and number + 1 < passes
        active, sending = np.int32((1 << FEATURE.strip) - 1), np.int32(0)
        if exchange:
            active, sending, left = owned_rows, border, np.int32(FEATURE.halo)
            tag = np.int32(tag + 1)
        air = air_of(values, integers, now, shared, thread, number)
        masses = Strip(where, active, sending, pin_bits, vx, vy, vz)
        moment = Moment(position, world, now, air, (border_position, border_velocity, turn, tag))
        step_strip(shared, old, new, place, masses, k, columns, moment)
        if exchange:
            fetch(border_position, border_velocity, turn, tag, shared, new, numbers, places, wanted, failed)
            turn = np.int32(particles - turn)
        cuda.syncthreads()
        if FEATURE.halo > 1:
            if exchange:
                renew(shared, np.int32(new + place), np.int32((1 << FEATURE.strip) - 1) & ~owned_rows, vx, vy, vz)
        old = new
    write(position, new_position, new_velocity, owned_rows, shared, np.int32(old + place), (vx, vy, vz), k, columns)


@cache
def make_cloth_resident(real: Real, math: str, integrator: str, parts: frozenset[str], tile: Tile) -> Kernel:
    """Compile kernel(position, velocity, new_position, new_velocity, border_position, border_velocity, epoch, failed,
    record, bodies, integers, counter, passes, rows, columns): `passes` passes of the whole sheet, from the old state to
    the new one.

    `border_*` (2 * particles * message_size,): messages, two alternating rounds, with tags `epoch` + 1, + 2, ... (the
    caller increases `epoch` by the exchanges of each launch); that of velocities has 1 number if tiling.fields is 3.
    `failed` (1,) int32 is set to 1 by a block whose messages never arrive. Launched cooperatively, one block per tile,
    of tile.threads threads in a row, and tiling.tile_bytes of shared memory.
    """
    kicks = kicks_of(integrator)
    names = {
        **strip_functions(tile.strip, parts),
        "kick": kicks.get("middle", kicks.get("step")), "publish": send_mass,
        "scalar": np.dtype(real) if simulated() else real,
    }  # fmt: skip
    variant = device_variant(real, math, {**cloth_features(integrator, parts), **cloth_tile_features(tile, parts)})
    bounds = (tile.threads, cloth_blocks_together(real, tile, parts))
    label = variant_name(real, math, integrator, parts, tile.name, FIRST_CHECK)
    kernel = variant.copied(of_scene(filled(cloth_resident, names), integrator, parts))
    return make_kernel(kernel, label, launch_bounds=bounds, **kernel_options(math))
