"""Neighbour search among particles of bodies on CUDA: one thread per particle hashes it, sorts it into the order of
cells, and tests the particles around it.

Buckets are numbered along x: a row of cells is contiguous in the table, and so are its particles, whose order wraps
around at the end of the table. So the 27 cells around a particle are nine runs. Only rows are hashed, after M. Teschner
et al., "Optimized Spatial Hashing for Collision Detection of Deformable Objects", VMV 2003. Nothing here is compiled in
fast math, where a cell might differ between two kernels: a NaN, or a particle too far from the origin, is in no cell.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    H_INVERSE_CELL,
    MAX_NEIGHBOURS,
    PAIR_FIELDS,
    PAIRS,
)
from softlab.model.formulas import contact, particle_contact

FARTHEST = 2**30  # cells from the origin
MIN_TABLE = 8  # buckets: a row's three cells are three different buckets, and no fourth one is among them


@cache
def make_pairs(self_contact: bool, many: bool) -> Callable:
    """Make pair_of(i, j, body, kind, kinds) -> (offset of the row of particles i and j in the record, true if they are
    of one body).

    `self_contact`: some body has self-contact; `many`: the scene has more than one kind of bodies.
    """
    pairs, fields = np.int32(PAIRS), np.int32(PAIR_FIELDS)

    @cuda.jit(device=True)
    def pair_of(i, j, body, kind, kinds):
        row, same = pairs, False
        if self_contact or many:
            one, other = body[i], body[j]
            if self_contact:
                same = one == other
            if many:
                row = np.int32(pairs + fields * (kind[one] * kinds + kind[other]))
        return row, same

    return pair_of


@cache
def _make_cells(real: Real) -> SimpleNamespace:
    """Make functions of cells: `cell_of` and `is_near` of a coordinate, `bucket_of` of a cell."""
    device = cuda.jit(device=True, **kernel_options("exact"))
    scaled = device_formulas(particle_contact, real, "exact").scaled
    (_, prime_y, prime_z), farthest, one = contact.PRIMES, real(FARTHEST), np.int32(1)

    @device
    def cell_of(x, inverse_cell):
        place = scaled(x, inverse_cell)
        whole = np.int32(place)
        return np.int32(whole - one) if place < real(whole) else whole

    @device
    def is_near(x, inverse_cell):
        """Return True if a coordinate has a cell; false for NaN."""
        return abs(scaled(x, inverse_cell)) <= farthest

    @device
    def bucket_of(x, y, z, mask):
        return np.int32((((y * prime_y) ^ (z * prime_z)) + x) & mask)

    return SimpleNamespace(cell_of=cell_of, is_near=is_near, bucket_of=bucket_of)


def _sort(real: Real) -> tuple[Callable, ...]:
    cells, zero, one = _make_cells(real), real(0), np.int32(1)
    cell_of, is_near, bucket_of = cells.cell_of, cells.is_near, cells.bucket_of

    def hash_particles(position, record, buckets, counts):
        i = np.int32(cuda.grid(1))
        if i < buckets.size:
            p, inverse, bucket = load_quad(position, i), record[H_INVERSE_CELL], np.int32(-1)
            if p[3] > zero and is_near(p[0], inverse) and is_near(p[1], inverse) and is_near(p[2], inverse):
                x, y, z = cell_of(p[0], inverse), cell_of(p[1], inverse), cell_of(p[2], inverse)
                bucket = bucket_of(x, y, z, np.int64(counts.size - 2))
                cuda.atomic.add(counts, bucket, one)
            buckets[i] = bucket

    def fill_buckets(buckets, starts, counts, filled):
        i = np.int32(cuda.grid(1))
        if i < buckets.size:
            bucket = buckets[i]
            if bucket >= 0:
                filled[starts[bucket] + cuda.atomic.sub(counts, bucket, one) - one] = i

    def arrange(position, buckets, starts, filled, body, sorted_position, sorted_particles, sorted_bodies):
        i = np.int32(cuda.grid(1))
        if i < buckets.size:
            bucket = buckets[i]
            if bucket >= 0:
                place = starts[bucket]
                for e in range(starts[bucket], starts[bucket + one]):
                    if filled[e] < i:
                        place = np.int32(place + one)
                p = load_quad(position, i)
                store_quad(sorted_position, place, p[0], p[1], p[2], zero)
                sorted_particles[place], sorted_bodies[place] = i, body[i]

    return hash_particles, fill_buckets, arrange


def _make_search(real: Real, self_contact: bool, many: bool) -> Callable:
    formulas, cells = device_formulas(particle_contact, real, "exact"), _make_cells(real)
    squared, within, cell_of, bucket_of = formulas.squared, formulas.within, cells.cell_of, cells.bucket_of
    device, pair_of = cuda.jit(device=True, **kernel_options("exact")), make_pairs(self_contact, many)
    zero, one, three, most = real(0), np.int32(1), np.int32(3), np.int32(MAX_NEIGHBOURS)

    @device
    def take(i, j, p, q, record, body, kind, kinds, rest):
        """Return True if particle j at q, in a cell next to that of particle i at p, is a neighbour of i."""
        row, same = pair_of(i, j, body, kind, kinds)
        if not within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), record[row + G_SEARCH_RADIUS]):
            return False
        if not same:
            return record[row + G_DISTANCE] > zero
        if i == j or not record[row + G_SELF_DISTANCE] > zero:
            return False
        a, b = load_quad(rest, i), load_quad(rest, j)
        return not within(squared(a[0] - b[0], a[1] - b[1], a[2] - b[2]), record[row + G_NEIGHBOURS])

    def find_neighbours(
        position, record, buckets, starts, sorted_position, sorted_particles, sorted_bodies, body, kind, kinds, rest,
        neighbours, neighbour_counts, lost,
    ):  # fmt: skip
        i = np.int32(cuda.grid(1))
        if i < neighbour_counts.size:
            count, particles = np.int32(0), np.int64(neighbour_counts.size)
            if buckets[i] >= 0:
                p, inverse, longest = load_quad(position, i), record[H_INVERSE_CELL], record[record.size - 1]
                x, y, z = cell_of(p[0], inverse), cell_of(p[1], inverse), cell_of(p[2], inverse)
                here, table, kinds = body[i], np.int32(starts.size - 1), np.int32(kinds)
                entries = starts[table]
                for row in range(9):
                    cy, cz = np.int32(y + row % 3 - 1), np.int32(z + row // 3 - 1)
                    bucket = bucket_of(x - one, cy, cz, np.int64(table - one))
                    first, end = starts[bucket], np.int32(bucket + three)
                    last = starts[min(end, table)]
                    if end > table:
                        last = np.int32(last + starts[end - table])
                    for n in range(first, last):
                        e = np.int32(n - entries) if n >= entries else np.int32(n)
                        if self_contact or sorted_bodies[e] != here:
                            q = load_quad(sorted_position, e)
                            if within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), longest):
                                if cell_of(q[1], inverse) == cy and cell_of(q[2], inverse) == cz:
                                    j = sorted_particles[e]
                                    if take(i, j, p, q, record, body, kind, kinds, rest):
                                        if count < most:
                                            neighbours[count * particles + i] = j
                                        count = np.int32(count + one)
                if count > most:
                    cuda.atomic.add(lost, 0, np.int64(count - most))
            neighbour_counts[i] = count

    return find_neighbours


@cache
def make_find(real: Real, self_contact: bool, many: bool) -> SimpleNamespace:
    """Compile `hash_particles`, `fill_buckets`, `arrange` and `find_neighbours`.

    `hash_particles(position, record, buckets, counts)`: each particle's bucket, and the number of particles in a
    bucket. `fill_buckets(buckets, starts, counts, filled)`: a bucket's particles in any order; zeroes the counts.
    `arrange(position, buckets, starts, filled, body, sorted_position, sorted_particles, sorted_bodies)`: in ascending
    order. `find_neighbours(position, record, buckets, starts, sorted_position, sorted_particles, sorted_bodies, body,
    kind, kinds, rest, neighbours, found, lost)`. `starts` has one number more than there are buckets, `record` one more
    than elsewhere: the largest contact distance. Neighbour s of particle i is neighbours[s * particles + i].
    """
    variant = f"particle_contacts_{variant_name(real, f'own{self_contact:d}', f'many{many:d}')}"
    return make_kernels((*_sort(real), _make_search(real, self_contact, many)), variant, **kernel_options("exact"))
