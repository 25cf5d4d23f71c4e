"""Search of the triangles that a mass of a cloth may touch within a substep, on CUDA: one thread per cell of the sheet
hashes it, one thread per mass searches. Cells are in a bucket in any order; a mass's nearest triangles do not depend on
that."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import real, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS, SPAN
from softlab.model.formulas.contact import (
    away,
    dot,
    enforced_distance,
    length,
    middle,
    nearest,
    normal,
    owns,
    rest_distance,
    scaled,
)
from softlab.model.formulas.contact import bucket as bucket_of
from softlab.model.formulas.contact import corners as corners_of
from softlab.model.formulas.contact import key as key_of

# Contact s of mass k has the number MAX_CONTACTS k + s and, in flat arrays, three corners and two quads: (normal,
# stored distance) and (b, c, distance at the substep's start, unused).


@routine
def place_of(first, last, distance, triangle, triangles, weights):
    """Return the place of a new contact, sorted by distance, then by number."""
    place = last
    while place > first:
        other = load_quad(weights, place - 1)[2]
        if not (distance < other or (distance == other and triangle < triangles[place - 1])):
            break
        place -= 1
    return place


@routine
def copy(source, target, triangles, corners, normals, weights):
    triangles[target] = triangles[source]
    for axis in range(3):
        corners[3 * target + axis] = corners[3 * source + axis]
    n, w = load_quad(normals, source), load_quad(weights, source)
    store_quad(normals, target, n[0], n[1], n[2], n[3])
    store_quad(weights, target, w[0], w[1], w[2], w[3])


@routine
def make_place(place, first, last, contacts):
    """Move the contacts of a mass from `place` on by one; the last of MAX_CONTACTS is lost."""
    triangles, corners, normals, weights = contacts
    slot = min(last, first + MAX_CONTACTS - 1)
    while slot > place:
        copy(slot - 1, slot, triangles, corners, normals, weights)
        slot -= 1


@routine
def store(place, triangle, vertices, n, enforced, at, contacts):
    """Write a contact with a triangle of three `vertices`. `at`: (b, c, distance, 1 if the vertex is inside)."""
    triangles, corners, normals, weights = contacts
    triangles[place] = triangle
    corners[3 * place], corners[3 * place + 1], corners[3 * place + 2] = vertices
    store_quad(normals, place, n[0], n[1], n[2], enforced)
    store_quad(weights, place, at[0], at[1], at[2], at[3])


@routine
def motion(other, moved, was):
    """Return the length of a mass's displacement `moved` relative to that of another one, from `was` to `other`."""
    return length(moved[0] - (other[0] - was[0]), moved[1] - (other[1] - was[1]), moved[2] - (other[2] - was[2]))


@routine
def add_contact(mass, triangle, before, predicted, columns, parameters, contacts, contact_count):
    """Insert the triangle among the nearest of a mass, if they may touch; see cpu_backend/contact/self_find.py.

    `mass`: its number, row and column, position and displacement; `contacts`: (triangles, corners, normals, weights).
    """
    (k, i, j, p, moved), (triangles, _, _, weights) = mass, contacts
    second, cell = triangle % 2 == 1, triangle // 2
    a, b, c = corners_of(triangle, columns)
    if a == k or b == k or c == k:
        return contact_count
    qa, qb, qc = load_quad(before, a), load_quad(before, b), load_quad(before, c)
    ux, uy, uz = qb[0] - qa[0], qb[1] - qa[1], qb[2] - qa[2]
    vx, vy, vz = qc[0] - qa[0], qc[1] - qa[1], qc[2] - qa[2]
    px, py, pz = p[0] - qa[0], p[1] - qa[1], p[2] - qa[2]
    feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
    cell_i = cell // (columns - 1)
    if not owns(second, feature, cell_i, cell - cell_i * (columns - 1)):
        return contact_count
    rx, ry, rz = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
    distance = length(rx, ry, rz)
    nearer = max(motion(load_quad(predicted, a), moved, qa), motion(load_quad(predicted, b), moved, qb))
    nearer = max(nearer, motion(load_quad(predicted, c), moved, qc))
    if not distance < parameters.thickness + parameters.margin + nearer:
        return contact_count
    first = k * MAX_CONTACTS
    last = first + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, triangles, weights)
    if place == first + MAX_CONTACTS:
        return contact_count + 1
    make_place(place, first, last, contacts)
    row_a, column_a = a // columns, a % columns
    rest = rest_distance(
        real(i - row_a), real(b // columns - row_a), real(c // columns - row_a),
        real(j - column_a), real(b % columns - column_a), real(c % columns - column_a), s, t, parameters.spacing,
    )  # fmt: skip
    n = normal(
        (rx, ry, rz), distance, (ux, uy, uz), (vx, vy, vz), parameters.normal_distance, parameters.coincident, k > a
    )
    enforced = enforced_distance(parameters.thickness, rest, dot(n[0], n[1], n[2], rx, ry, rz), parameters.push)
    store(place, triangle, (a, b, c), n, enforced, (s, t, distance, 0.0), contacts)
    return contact_count + 1


@routine
def floor(x):
    """Return the largest integer up to x."""
    whole = np.int64(x)
    return whole - 1 if x < real(whole) else whole


@routine
def relative(was, now, was_reference, now_reference):
    """Return the length of the displacement of a mass relative to that of a reference."""
    return length(
        (now[0] - was[0]) - (now_reference[0] - was_reference[0]),
        (now[1] - was[1]) - (now_reference[1] - was_reference[1]),
        (now[2] - was[2]) - (now_reference[2] - was_reference[2]),
    )


@routine
def center_along(qa, qb, qc, qd, axis):
    return middle(qa[axis], qb[axis], qc[axis], qd[axis])


@routine
def least(a, b, c, d):
    return min(min(a, b), min(c, d))


@routine
def most(a, b, c, d):
    return max(max(a, b), max(c, d))


@routine
def clear(counts, link_counts, largest):
    k = cuda.grid(1)
    if k < counts.size:
        counts[k] = 0
    if k < link_counts.size:
        link_counts[k] = 0
    if k == 0:
        largest[0] = 0.0


@routine
def hash_cells(before, predicted, record, boxes, keys, buckets, counts, largest, rows, columns):
    parameters = record[0]
    q = np.int64(cuda.grid(1))
    rows, columns = np.int64(rows), np.int64(columns)
    if q < keys.size:
        i = q // (columns - 1)
        a = q + i
        b, c, d = a + 1, a + columns, a + columns + 1
        reference = (rows // 2) * columns + columns // 2
        r, r_now = load_quad(before, reference), load_quad(predicted, reference)
        qa, qb, qc, qd = load_quad(before, a), load_quad(before, b), load_quad(before, c), load_quad(before, d)
        moved = relative(qa, load_quad(predicted, a), r, r_now)
        moved = max(moved, relative(qb, load_quad(predicted, b), r, r_now))
        moved = max(moved, relative(qc, load_quad(predicted, c), r, r_now))
        moved = max(moved, relative(qd, load_quad(predicted, d), r, r_now))
        x0, x1 = least(qa[0], qb[0], qc[0], qd[0]) - moved, most(qa[0], qb[0], qc[0], qd[0]) + moved
        y0, y1 = least(qa[1], qb[1], qc[1], qd[1]) - moved, most(qa[1], qb[1], qc[1], qd[1]) + moved
        z0, z1 = least(qa[2], qb[2], qc[2], qd[2]) - moved, most(qa[2], qb[2], qc[2], qd[2]) + moved
        x, y, z = center_along(qa, qb, qc, qd, 0), center_along(qa, qb, qc, qd, 1), center_along(qa, qb, qc, qd, 2)
        extent = max(max(x - x0, x1 - x), max(max(y - y0, y1 - y), max(z - z0, z1 - z)))
        store_quad(boxes, 2 * q, x0, y0, z0, 0.0)
        store_quad(boxes, 2 * q + 1, x1, y1, z1, 0.0)
        cx, cy = floor(scaled(x, parameters.inverse_cell)), floor(scaled(y, parameters.inverse_cell))
        cz = floor(scaled(z, parameters.inverse_cell))
        bucket = bucket_of(cx, cy, cz, np.int64(counts.size - 1))
        keys[q], buckets[q] = key_of(cx, cy, cz), bucket
        cuda.atomic.add(counts, bucket, 1)
        cuda.atomic.max(largest, 0, extent)


@routine
def fill_buckets(buckets, cursors, sorted_cells):
    q = np.int32(cuda.grid(1))
    if q < buckets.size:
        sorted_cells[cuda.atomic.add(cursors, buckets[q], 1)] = q


@routine
def find_contacts(
    before, predicted, record, boxes, keys, starts, counts, sorted_cells, largest, triangles, corners, normals,
    weights, contact_counts, link_counts, lost, rows, columns,
):  # fmt: skip
    """Write contact_counts[k], the number of triangles that mass k may touch; store the first MAX_CONTACTS, and count by
    corner."""
    parameters = record[0]
    k = np.int64(cuda.grid(1))
    rows, columns = np.int64(rows), np.int64(columns)
    if k < contact_counts.size:
        i, count = k // columns, np.int64(0)
        j = k - i * columns
        reference = (rows // 2) * columns + columns // 2
        p, now = load_quad(before, k), load_quad(predicted, k)
        mass = k, i, j, p, (now[0] - p[0], now[1] - p[1], now[2] - p[2])
        contacts = triangles, corners, normals, weights
        radius = parameters.thickness + parameters.margin + relative(
            p, now, load_quad(before, reference), load_quad(predicted, reference)
        )  # fmt: skip
        search_radius, scale = min(radius + largest[0], parameters.reach), parameters.inverse_cell
        x, y = floor(scaled(p[0] - search_radius, scale)), floor(scaled(p[1] - search_radius, scale))
        z = floor(scaled(p[2] - search_radius, scale))
        span_x = min(floor(scaled(p[0] + search_radius, scale)) - x + 1, SPAN)
        span_y = min(floor(scaled(p[1] + search_radius, scale)) - y + 1, SPAN)
        span_z = min(floor(scaled(p[2] + search_radius, scale)) - z + 1, SPAN)
        for place in range(span_x * span_y * span_z):
            cx, cy, cz = x + place % span_x, y + place // span_x % span_y, z + place // (span_x * span_y)
            key, bucket = key_of(cx, cy, cz), bucket_of(cx, cy, cz, np.int64(counts.size - 1))
            for entry in range(starts[bucket], starts[bucket] + counts[bucket]):
                q = np.int64(sorted_cells[entry])
                if keys[q] == key:
                    low, high = load_quad(boxes, 2 * q), load_quad(boxes, 2 * q + 1)
                    if not (
                        p[0] < low[0] - radius or p[0] > high[0] + radius or p[1] < low[1] - radius
                        or p[1] > high[1] + radius or p[2] < low[2] - radius or p[2] > high[2] + radius
                    ):  # fmt: skip
                        for second in range(2):
                            count = add_contact(
                                mass, 2 * q + second, before, predicted, columns, parameters, contacts, count
                            )
        contact_counts[k] = count
        if count > MAX_CONTACTS:
            cuda.atomic.add(lost, 0, np.int64(count - MAX_CONTACTS))
        for place in range(3 * MAX_CONTACTS * k, 3 * (MAX_CONTACTS * k + min(count, MAX_CONTACTS))):
            cuda.atomic.add(link_counts, corners[place], 1)


@cache
def make_find(real: Real, math: str) -> SimpleNamespace:
    """Compile `clear`, `hash_cells`, `fill_buckets`, `find_contacts`; `before`, `predicted`: quads of masses."""
    kernels = clear, hash_cells, fill_buckets, find_contacts
    return kernels_of(device_variant(real, math), math, kernels, f"contacts_{variant_name(real, math)}")
