"""Cell sort of particles on CUDA: a counting sort whose launches all have sizes fixed at the start.

`hash_particles` takes a slot from a counter of its cell, in the arbitrary order of threads. The counters are summed up,
and `fill` writes each particle's number into a slot of its cell. The order of atomics does not matter in the end:
`arrange` counts, for each particle, the lower numbers in its cell, which are about six, and 1/27 of those that the
search tests anyway. So the particles of a cell are in the order of their numbers, and the whole order depends on
positions alone and is the same in every run. All operations are on integers, except for the box, whose minima and
maxima do not depend on the order.

The number of cells is known on the device only (`numbers[CELLS]`): a launch covers the maximum, and blocks beyond the
end return at once.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.scan import before, strips
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine
from softlab.model.fluid.plan import periodic_axes
from softlab.model.formulas.fluid.cells import cell_of, cells_along, fits, halved

THREADS = 32 if simulated() else 256  # of a block that reduces; the simulator runs each one as a Python thread
EACH = 4 if simulated() else 8  # cells per thread of a scan
CHUNK = THREADS * EACH  # cells per block of a scan
AXES = 3
BOX = 2 * AXES  # numbers of a box: the lowest coordinate along each axis, then the highest
BOXES = BOX * THREADS  # numbers of the boxes of a block's threads
# integers of the grid: cells along x, y, z; 1 for each axis that is periodic; all cells
WIDTH, HEIGHT, DEPTH, WRAPS, CELLS = 0, 1, 2, 3, 6
ACTIVE_CELLS = 7  # with sinks, how many particles have a cell
NUMBERS = 8
LOW, INVERSE = 0, AXES  # reals of the grid, one per axis: the corner [m], cells per metre
REALS = 2 * AXES
UNBOUNDED = np.inf  # m


@inlined_routine
def store_box(lx, ly, lz, hx, hy, hz, boxes):
    """Write the bounding box of a block's threads as a row of `boxes`; every thread of the block must call it."""
    memory = cuda.shared.array(BOXES, real)
    t = np.int32(cuda.threadIdx.x)
    memory[t], memory[t + THREADS], memory[t + 2 * THREADS] = lx, ly, lz
    memory[t + 3 * THREADS], memory[t + 4 * THREADS], memory[t + 5 * THREADS] = hx, hy, hz
    cuda.syncthreads()
    stride = np.int32(THREADS // 2)
    while stride > 0:
        if t < stride:
            for axis in range(AXES):
                at = np.int32(axis * THREADS + t)
                memory[at] = min(memory[at], memory[at + stride])
                at = np.int32(at + AXES * THREADS)
                memory[at] = max(memory[at], memory[at + stride])
        cuda.syncthreads()
        stride = np.int32(stride // 2)
    if t < BOX:
        boxes[BOX * cuda.blockIdx.x + t] = memory[t * THREADS]


@inlined_routine
def set_axis(axis, boxes, inverse, reals, numbers):
    """Set the grid along an axis that is not periodic."""
    low, high = boxes[axis], boxes[AXES + axis]
    if not low <= high:
        low, high = 0.0, 0.0
    reals[LOW + axis], reals[INVERSE + axis] = low, inverse
    numbers[axis], numbers[WRAPS + axis] = cells_along(low, high, inverse), 0


@inlined_routine
def set_periodic_axis(axis, low, inverse, count, reals, numbers):
    """Set the grid along a periodic axis."""
    reals[LOW + axis], reals[INVERSE + axis] = low, inverse
    numbers[axis], numbers[WRAPS + axis] = np.int32(count), 1


@routine
def bound(position, limit, boxes):
    """Write, for each block, the bounding box of its quads within `limit` of the origin, as a row of `boxes`."""
    lx, ly, lz, hx, hy, hz = UNBOUNDED, UNBOUNDED, UNBOUNDED, -UNBOUNDED, -UNBOUNDED, -UNBOUNDED
    for k in range(np.int32(cuda.grid(1)), position.size // SIZE, np.int32(cuda.gridsize(1))):
        p = load_quad(position, k)
        if abs(p[0]) <= limit and abs(p[1]) <= limit and abs(p[2]) <= limit:  # false for NaN
            lx, ly, lz = min(lx, p[0]), min(ly, p[1]), min(lz, p[2])
            hx, hy, hz = max(hx, p[0]), max(hy, p[1]), max(hz, p[2])
    store_box(lx, ly, lz, hx, hy, hz, boxes)


@routine
def span(boxes, record, most, reals, numbers):
    """Compute the grid of at most `most` cells over all boxes: one block."""
    t = np.int32(cuda.threadIdx.x)
    lx, ly, lz, hx, hy, hz = UNBOUNDED, UNBOUNDED, UNBOUNDED, -UNBOUNDED, -UNBOUNDED, -UNBOUNDED
    for row in range(t, boxes.size // BOX, THREADS):
        at = np.int32(row * BOX)
        lx, ly, lz = min(lx, boxes[at]), min(ly, boxes[at + 1]), min(lz, boxes[at + 2])
        hx, hy, hz = max(hx, boxes[at + 3]), max(hy, boxes[at + 4]), max(hz, boxes[at + 5])
    cuda.syncthreads()
    store_box(lx, ly, lz, hx, hy, hz, boxes)  # as row 0: this is block 0
    cuda.syncthreads()
    if t == 0:
        parameters = record[0]
        for axis in range(AXES):
            set_axis(axis, boxes, parameters.inverse_cell, reals, numbers)
        if FEATURE.periodic_x:
            set_periodic_axis(0, parameters.low_x, parameters.inverse_side_x, parameters.cells_x, reals, numbers)
        if FEATURE.periodic_y:
            set_periodic_axis(1, parameters.low_y, parameters.inverse_side_y, parameters.cells_y, reals, numbers)
        if FEATURE.periodic_z:
            set_periodic_axis(2, parameters.low_z, parameters.inverse_side_z, parameters.cells_z, reals, numbers)
        while not fits(numbers[WIDTH], numbers[HEIGHT], numbers[DEPTH], most):
            widest, count = np.int32(-1), np.int32(1)
            for axis in range(AXES):
                if numbers[WRAPS + axis] == 0 and numbers[axis] > count:
                    widest, count = np.int32(axis), numbers[axis]
            if widest < 0:
                break
            inverse = halved(reals[INVERSE + widest])
            reals[INVERSE + widest] = inverse
            numbers[widest] = cells_along(boxes[widest], boxes[AXES + widest], inverse)
        numbers[CELLS] = np.int32(numbers[WIDTH] * numbers[HEIGHT] * numbers[DEPTH])


@inlined_routine
def cell_key(p, reals, numbers):
    """Return the number of the cell of a particle at p (a quad)."""
    x = cell_of(p[0], reals[LOW], reals[INVERSE], numbers[WIDTH])
    y = cell_of(p[1], reals[LOW + 1], reals[INVERSE + 1], numbers[HEIGHT])
    z = cell_of(p[2], reals[LOW + 2], reals[INVERSE + 2], numbers[DEPTH])
    return (z * numbers[HEIGHT] + y) * numbers[WIDTH] + x


@routine
def hash_particles(position, reals, numbers, keys, slots, counts):
    k = np.int32(cuda.grid(1))
    if k < keys.size:
        key = np.int32(cell_key(load_quad(position, k), reals, numbers))
        keys[k], slots[k] = key, cuda.atomic.add(counts, key, np.int32(1))


@routine
def chunks(counts, numbers, starts, totals):
    """Write starts[k], the chunk's sum of counts before k, and totals[b], that of a chunk. One block per chunk."""
    cells = numbers[CELLS]
    if np.int32(cuda.blockIdx.x) * CHUNK < cells:
        first = np.int32(cuda.grid(1) * EACH)
        last, total = min(np.int32(first + EACH), cells), np.int32(0)
        for k in range(first, last):
            total = np.int32(total + counts[k])
        start = before(total)
        for k in range(first, last):
            count = counts[k]
            starts[k] = start
            start = np.int32(start + count)
        if cuda.threadIdx.x == THREADS - 1:
            totals[cuda.blockIdx.x] = start


@routine
def totals(numbers, sums):
    """Replace the total of each chunk by the sum of those before it: one block."""
    active = strips(sums, np.int32((numbers[CELLS] + CHUNK - 1) // CHUNK))
    if FEATURE.flow and cuda.threadIdx.x == THREADS - 1:
        numbers[ACTIVE_CELLS] = active


@routine
def fill(keys, slots, number, starts, sums, numbers, counts, begins, filled):
    """Write filled[...], the numbers of each cell's particles in any order, and begins[k], the start of cell k.

    `begins` has one more number than there are cells. The counts are set to 0.
    """
    cells, stride = numbers[CELLS], np.int32(cuda.gridsize(1))
    for k in range(np.int32(cuda.grid(1)), keys.size, stride):
        key = keys[k]
        if FEATURE.flow and key < 0:
            continue
        filled[starts[key] + sums[key // CHUNK] + slots[k]] = number[k]
    for k in range(np.int32(cuda.grid(1)), cells, stride):
        begins[k], counts[k] = np.int32(starts[k] + sums[k // CHUNK]), 0
    if cuda.grid(1) == 0:
        begins[cells] = numbers[ACTIVE_CELLS] if FEATURE.flow else np.int32(keys.size)


@routine
def arrange(
    keys, begins, filled, position, before_, velocity, number, sorted_position, sorted_before, sorted_velocity,
    sorted_number, sorted_keys,
):  # fmt: skip
    """Write particles in the order of their cells, and of their numbers within a cell."""
    k = np.int32(cuda.grid(1))
    if k < keys.size and (not FEATURE.flow or keys[k] >= 0):
        key, particle = keys[k], number[k]
        place = begins[key]
        for e in range(begins[key], begins[key + 1]):
            if filled[e] < particle:
                place = np.int32(place + 1)
        p, b, v = load_quad(position, k), load_quad(before_, k), load_quad(velocity, k)
        store_quad(sorted_position, place, p[0], p[1], p[2], p[3])
        store_quad(sorted_before, place, b[0], b[1], b[2], b[3])
        store_quad(sorted_velocity, place, v[0], v[1], v[2], v[3])
        sorted_number[place], sorted_keys[place] = particle, key


@cache
def make_cell_sort(precision: Real, repeats: frozenset[str], flows: bool = False) -> SimpleNamespace:
    """Compile `bound`, `span`, `hash_particles`, `chunks`, `totals`, `fill` and `arrange`, for blocks of THREADS.

    `repeats`: axes that are periodic; `flows`: particles with the key -1 are left out.
    """
    variant = device_variant(precision, "exact", periodic_axes(repeats) | {"flow": flows, "threads": int(THREADS)})
    kernels = bound, span, hash_particles, chunks, totals, fill, arrange
    label = variant_name(precision, repeats | {"flow"} if flows else repeats)
    return kernels_of(variant, "exact", kernels, f"fluid_cells_{label}")
