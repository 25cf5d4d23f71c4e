"""Neighbour search among particles of bodies on CUDA: one thread per particle hashes it, sorts it into the order of
cells, and tests the particles around it.

Buckets are numbered along x: a row of cells is contiguous in the table, and so are its particles, whose order wraps
around at the end of the table. So the 27 cells around a particle are nine runs. Only rows are hashed, after M. Teschner
et al., "Optimized Spatial Hashing for Collision Detection of Deformable Objects", VMV 2003. Nothing here is compiled in
fast math, where a cell might differ between two kernels: a NaN, or a particle too far from the origin, is in no cell.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, real, routine
from softlab.model.contact.particle_parameters import (
    FARTHEST,
    G_DISTANCE,
    G_NEIGHBOURS,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    H_INVERSE_CELL,
    MAX_NEIGHBOURS,
    PAIR_FIELDS,
    PAIRS,
)
from softlab.model.formulas.contact import PRIMES
from softlab.model.formulas.particle_contact import scaled, squared, within

LIMIT = float(FARTHEST)
MIN_TABLE = 8  # buckets: a row's three cells are three different buckets, and no fourth one is among them
_, PRIME_Y, PRIME_Z = PRIMES
ONE, THREE, CAPACITY = np.int32(1), np.int32(3), np.int32(MAX_NEIGHBOURS)
ROW, FIELDS = np.int32(PAIRS), np.int32(PAIR_FIELDS)


@routine
def pair_of(i, j, body, kind, kinds):
    """Return (offset of the row of particles i and j in the record, true if they are of one body)."""
    row, same = ROW, False
    if FEATURE.self_contact or FEATURE.kinds:
        one, other = body[i], body[j]
        if FEATURE.self_contact:
            same = one == other
        if FEATURE.kinds:
            row = np.int32(ROW + FIELDS * (kind[one] * kinds + kind[other]))
    return row, same


@routine
def cell_of(x, inverse_cell):
    """Return the cell of a coordinate."""
    place = scaled(x, inverse_cell)
    whole = np.int32(place)
    return np.int32(whole - ONE) if place < real(whole) else whole


@routine
def is_near(x, inverse_cell):
    """Return True if a coordinate has a cell; false for NaN."""
    return abs(scaled(x, inverse_cell)) <= LIMIT


@routine
def bucket_of(x, y, z, mask):
    """Return the bucket of a cell."""
    return np.int32((((y * PRIME_Y) ^ (z * PRIME_Z)) + x) & mask)


@routine
def hash_particles(position, record, buckets, counts):
    """Write each particle's bucket, and count the particles of a bucket."""
    i = np.int32(cuda.grid(1))
    if i < buckets.size:
        p, inverse, bucket = load_quad(position, i), record[H_INVERSE_CELL], np.int32(-1)
        if p[3] > 0.0 and is_near(p[0], inverse) and is_near(p[1], inverse) and is_near(p[2], inverse):
            x, y, z = cell_of(p[0], inverse), cell_of(p[1], inverse), cell_of(p[2], inverse)
            bucket = bucket_of(x, y, z, np.int64(counts.size - 2))
            cuda.atomic.add(counts, bucket, ONE)
        buckets[i] = bucket


@routine
def fill_buckets(buckets, starts, counts, filled):
    """List a bucket's particles in any order; zero the counts."""
    i = np.int32(cuda.grid(1))
    if i < buckets.size:
        bucket = buckets[i]
        if bucket >= 0:
            filled[starts[bucket] + cuda.atomic.sub(counts, bucket, ONE) - ONE] = i


@routine
def arrange(position, buckets, starts, filled, body, sorted_position, sorted_particles, sorted_bodies):
    """Write a bucket's particles in ascending order."""
    i = np.int32(cuda.grid(1))
    if i < buckets.size:
        bucket = buckets[i]
        if bucket >= 0:
            place = starts[bucket]
            for e in range(starts[bucket], starts[bucket + ONE]):
                if filled[e] < i:
                    place = np.int32(place + ONE)
            p = load_quad(position, i)
            store_quad(sorted_position, place, p[0], p[1], p[2], 0.0)
            sorted_particles[place], sorted_bodies[place] = i, body[i]


@routine
def take(i, j, p, q, record, body, kind, kinds, rest):
    """Return True if particle j at q, in a cell next to that of particle i at p, is a neighbour of i."""
    row, same = pair_of(i, j, body, kind, kinds)
    if not within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), record[row + G_SEARCH_RADIUS]):
        return False
    if not same:
        return record[row + G_DISTANCE] > 0.0
    if i == j or not record[row + G_SELF_DISTANCE] > 0.0:
        return False
    a, b = load_quad(rest, i), load_quad(rest, j)
    return not within(squared(a[0] - b[0], a[1] - b[1], a[2] - b[2]), record[row + G_NEIGHBOURS])


@routine
def find_neighbours(
    position, record, buckets, starts, sorted_position, sorted_particles, sorted_bodies, body, kind, kinds, rest,
    neighbours, neighbour_counts, lost,
):  # fmt: skip
    """Write neighbour s of particle i to neighbours[s * particles + i]. `record` has one number more than elsewhere, the
    largest contact distance; `starts` one more than there are buckets."""
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
                bucket = bucket_of(x - ONE, cy, cz, np.int64(table - ONE))
                first, end = starts[bucket], np.int32(bucket + THREE)
                last = starts[min(end, table)]
                if end > table:
                    last = np.int32(last + starts[end - table])
                for n in range(first, last):
                    e = np.int32(n - entries) if n >= entries else np.int32(n)
                    if FEATURE.self_contact or sorted_bodies[e] != here:
                        q = load_quad(sorted_position, e)
                        if within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), longest):
                            if cell_of(q[1], inverse) == cy and cell_of(q[2], inverse) == cz:
                                j = sorted_particles[e]
                                if take(i, j, p, q, record, body, kind, kinds, rest):
                                    if count < CAPACITY:
                                        neighbours[count * particles + i] = j
                                    count = np.int32(count + ONE)
            if count > CAPACITY:
                cuda.atomic.add(lost, 0, np.int64(count - CAPACITY))
        neighbour_counts[i] = count


@cache
def make_find(real: Real, self_contact: bool, many: bool) -> SimpleNamespace:
    """Compile `hash_particles`, `fill_buckets`, `arrange` and `find_neighbours`.

    `self_contact`: some body has self-contact; `many`: the scene has more than one kind of bodies.
    """
    variant = device_variant(real, "exact", {"self_contact": self_contact, "kinds": many})
    label = f"particle_contacts_{variant_name(real, f'own{self_contact:d}', f'many{many:d}')}"
    return kernels_of(variant, "exact", (hash_particles, fill_buckets, arrange, find_neighbours), label)
