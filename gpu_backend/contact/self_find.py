"""Search of the triangles that a mass of a cloth may touch within a substep, on CUDA: one thread per cell of the sheet
hashes it, one thread per mass searches. Cells are in a bucket in any order; a mass's nearest triangles do not depend on
that. What a cell and a mass do: model/contact/triangle_search.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, inlined_routine, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.triangle_search import cell_at, cell_box, extent_of, find_of_mass
from softlab.model.formulas.contact import bucket as bucket_of
from softlab.model.formulas.contact import key as key_of

# Contact s of mass k has the number MAX_CONTACTS k + s and, in flat arrays, three corners and two quads: (normal,
# stored distance) and (b, c, distance at the substep's start, 1 if a vertex is inside a surface).


class TriangleContacts(NamedTuple):
    """Contacts with triangles: their numbers, corners, quads of normals and quads of weights."""

    triangles: DeviceArray
    corners: DeviceArray
    normals: DeviceArray
    weights: DeviceArray


class Cells(NamedTuple):
    """The sheet's cells: boxes, keys, the first cell of each bucket and how many it has, cells by buckets."""

    boxes: DeviceArray
    keys: DeviceArray
    starts: DeviceArray
    counts: DeviceArray
    sorted_cells: DeviceArray


@inlined_routine
def point(points, k):
    p = load_quad(points, k)
    return p[0], p[1], p[2]


@inlined_routine
def corners_of_contact(contacts, slot):
    return contacts.corners[3 * slot], contacts.corners[3 * slot + 1], contacts.corners[3 * slot + 2]


@inlined_routine
def corners_of_surface(surface, triangle):
    return surface[3 * triangle], surface[3 * triangle + 1], surface[3 * triangle + 2]


@inlined_routine
def normal_of_contact(contacts, slot):
    return load_quad(contacts.normals, slot)


@inlined_routine
def weights_of_contact(contacts, slot):
    return load_quad(contacts.weights, slot)


@inlined_routine
def is_inside(contacts, slot):
    return load_quad(contacts.weights, slot)[3] != 0.0


@routine
def copy(source, target, contacts):
    contacts.triangles[target] = contacts.triangles[source]
    for axis in range(3):
        contacts.corners[3 * target + axis] = contacts.corners[3 * source + axis]
    n, w = load_quad(contacts.normals, source), load_quad(contacts.weights, source)
    store_quad(contacts.normals, target, n[0], n[1], n[2], n[3])
    store_quad(contacts.weights, target, w[0], w[1], w[2], w[3])


@routine
def store(place, triangle, vertices, n, enforced, at, contacts):
    corners = contacts.corners
    contacts.triangles[place] = triangle
    corners[3 * place], corners[3 * place + 1], corners[3 * place + 2] = vertices
    store_quad(contacts.normals, place, n[0], n[1], n[2], enforced)
    store_quad(contacts.weights, place, at[0], at[1], at[2], at[3])


@inlined_routine
def box_of(boxes, q):
    return load_quad(boxes, 2 * q), load_quad(boxes, 2 * q + 1)


@inlined_routine
def cells_in(table, bucket):
    return table.starts[bucket], table.starts[bucket] + table.counts[bucket]


ACCESS = {  # open names of model/contact/triangle_contacts.py
    "point": point, "corners_of_contact": corners_of_contact, "corners_of_surface": corners_of_surface,
    "normal_of_contact": normal_of_contact, "weights_of_contact": weights_of_contact,
}  # fmt: skip
SEARCH_ACCESS = ACCESS | {
    "copy": copy, "store": store, "is_inside": is_inside, "box_of": box_of, "cells_in": cells_in,
}  # fmt: skip


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
    q = np.int64(cuda.grid(1))
    rows, columns = np.int64(rows), np.int64(columns)
    if q < keys.size:
        reference = (rows // 2) * columns + columns // 2
        low, high, center = cell_box(q + q // (columns - 1), columns, before, predicted, reference)
        store_quad(boxes, 2 * q, low[0], low[1], low[2], 0.0)
        store_quad(boxes, 2 * q + 1, high[0], high[1], high[2], 0.0)
        x, y, z = cell_at(center[0], center[1], center[2], record[0].inverse_cell)
        bucket = bucket_of(x, y, z, np.int64(counts.size - 1))
        keys[q], buckets[q] = key_of(x, y, z), bucket
        cuda.atomic.add(counts, bucket, 1)
        cuda.atomic.max(largest, 0, extent_of(low, high, center))


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
    k = np.int64(cuda.grid(1))
    rows, columns = np.int64(rows), np.int64(columns)
    if k < contact_counts.size:
        table, contacts = (
            Cells(boxes, keys, starts, counts, sorted_cells), TriangleContacts(triangles, corners, normals, weights)
        )  # fmt: skip
        mask = np.int64(counts.size - 1)
        count = find_of_mass(k, rows, columns, before, predicted, table, mask, largest[0], record[0], contacts)
        contact_counts[k] = count
        if count > MAX_CONTACTS:
            cuda.atomic.add(lost, 0, np.int64(count - MAX_CONTACTS))
        for place in range(3 * MAX_CONTACTS * k, 3 * (MAX_CONTACTS * k + min(count, MAX_CONTACTS))):
            cuda.atomic.add(link_counts, corners[place], 1)


@cache
def make_find(real: Real, math: str) -> SimpleNamespace:
    """Compile `clear`, `hash_cells`, `fill_buckets`, `find_contacts`; `before`, `predicted`: quads of masses."""
    kernels = clear, filled(hash_cells, SEARCH_ACCESS), fill_buckets, filled(find_contacts, SEARCH_ACCESS)
    return kernels_of(device_variant(real, math), math, kernels, f"contacts_{variant_name(real, math)}")
