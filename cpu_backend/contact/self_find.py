"""Search of the triangles that a mass of a cloth may touch within a substep: the sheet's cells hashed by a counting
sort, and the nearest triangles of each mass. Parallel over rows, buckets and masses; the result does not depend on the
number of threads. What a cell and a mass do: model/contact/triangle_search.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.contact.triangle_search import cell_at, cell_box, extent_of, find_of_mass
from softlab.model.formulas.contact import bucket as bucket_of
from softlab.model.formulas.contact import key as key_of

VALUES = 7  # values of a contact:
V_B, V_C, V_NX, V_NY, V_NZ, V_ENFORCED, V_DISTANCE = range(VALUES)
V_INSIDE = VALUES  # with a surface: not 0 if the vertex is inside
VALUES_OF_SURFACES = VALUES + 1


class Cells(NamedTuple):
    """Masses' positions before a substep and predicted; boxes, keys and buckets of the sheet's cells; largest extent of
    a cell in each row; first cell of each bucket among the sorted ones; number of cells in each band's buckets."""

    begin: np.ndarray
    end: np.ndarray
    boxes: np.ndarray
    keys: np.ndarray
    buckets: np.ndarray
    largest: np.ndarray
    starts: np.ndarray
    totals: np.ndarray
    sorted_cells: np.ndarray


class TriangleContacts(NamedTuple):
    """Contacts with triangles: their numbers (contacts,), their corners (contacts, 3), values (contacts, V_...)."""

    triangles: np.ndarray
    corners: np.ndarray
    values: np.ndarray


@inlined_routine
def point(points, k):
    return points[k, 0], points[k, 1], points[k, 2]


@inlined_routine
def corners_of_contact(contacts, slot):
    return contacts.corners[slot, 0], contacts.corners[slot, 1], contacts.corners[slot, 2]


@inlined_routine
def corners_of_surface(surface, triangle):
    return surface[triangle, 0], surface[triangle, 1], surface[triangle, 2]


@inlined_routine
def normal_of_contact(contacts, slot):
    values = contacts.values
    return values[slot, V_NX], values[slot, V_NY], values[slot, V_NZ], values[slot, V_ENFORCED]


@inlined_routine
def weights_of_contact(contacts, slot):
    return contacts.values[slot, V_B], contacts.values[slot, V_C], contacts.values[slot, V_DISTANCE]


@inlined_routine
def is_inside(contacts, slot):
    return contacts.values[slot, V_INSIDE] != 0.0


@routine
def copy(source, target, contacts):
    contacts.triangles[target] = contacts.triangles[source]
    for axis in range(3):
        contacts.corners[target, axis] = contacts.corners[source, axis]
    for value in range(VALUES_OF_SURFACES if FEATURE.closed else VALUES):
        contacts.values[target, value] = contacts.values[source, value]


@inlined_routine
def store(place, triangle, vertices, n, enforced, at, contacts):
    corners, values = contacts.corners, contacts.values
    contacts.triangles[place] = triangle
    corners[place, 0], corners[place, 1], corners[place, 2] = vertices
    values[place, V_B], values[place, V_C], values[place, V_DISTANCE] = at[0], at[1], at[2]
    values[place, V_NX], values[place, V_NY], values[place, V_NZ] = n
    values[place, V_ENFORCED] = enforced
    if FEATURE.closed:
        values[place, V_INSIDE] = at[3]


@inlined_routine
def box_of(boxes, q):
    return (boxes[q, 0], boxes[q, 1], boxes[q, 2]), (boxes[q, 3], boxes[q, 4], boxes[q, 5])


@inlined_routine
def cells_in(table, bucket):
    return table.starts[bucket], table.starts[bucket + 1]


ACCESS = {  # open names of model/contact/triangle_contacts.py
    "point": point, "corners_of_contact": corners_of_contact, "corners_of_surface": corners_of_surface,
    "normal_of_contact": normal_of_contact, "weights_of_contact": weights_of_contact,
}  # fmt: skip
SEARCH_ACCESS = ACCESS | {
    "copy": copy, "store": store, "is_inside": is_inside, "box_of": box_of, "cells_in": cells_in,
}  # fmt: skip


@routine
def hash_cells(team, member, bands, before, predicted, parameters, table_of):
    """Copy the state before and the prediction of (3, rows, columns) by masses, and sort the sheet's cells into buckets.

    The cells of bucket b are sorted_cells[starts[b] : starts[b + 1]], in ascending order. Each thread has a range
    of buckets and reads all cells. `table_of`: Cells.
    """
    begin, end_of, boxes, keys, buckets = table_of.begin, table_of.end, table_of.boxes, table_of.keys, table_of.buckets
    largest, starts, totals, sorted_cells = table_of.largest, table_of.starts, table_of.totals, table_of.sorted_cells
    rows, columns = before.shape[1], before.shape[2]
    for band in assigned(team, member, bands):
        for i in range(rows * band // bands, rows * (band + 1) // bands):
            for j in range(columns):
                for axis in range(3):
                    begin[i * columns + j, axis] = before[axis, i, j]
                    end_of[i * columns + j, axis] = predicted[axis, i, j]
    mask, cells = np.int64(starts.size - 2), (rows - 1) * (columns - 1)
    reference = (rows // 2) * columns + columns // 2
    for band in assigned(team, member, bands):
        for i in range((rows - 1) * band // bands, (rows - 1) * (band + 1) // bands):
            most = 0.0
            for j in range(columns - 1):
                q = i * (columns - 1) + j
                low, high, center = cell_box(i * columns + j, columns, begin, end_of, reference)
                for axis in range(3):
                    boxes[q, axis], boxes[q, 3 + axis] = low[axis], high[axis]
                most = max(most, extent_of(low, high, center))
                x, y, z = cell_at(center[0], center[1], center[2], parameters.inverse_cell)
                keys[q], buckets[q] = key_of(x, y, z), bucket_of(x, y, z, mask)
            largest[i] = most
    table = mask + 1
    for band in assigned(team, member, bands):
        low, high = table * band // bands, table * (band + 1) // bands
        starts[low:high] = 0
        inside = 0
        for q in range(cells):
            if low <= buckets[q] < high:
                starts[buckets[q]] += 1
                inside += 1
        totals[band] = inside
    for band in assigned(team, member, bands):
        low, high = table * band // bands, table * (band + 1) // bands
        end = np.int64(0)
        for before_it in range(band):
            end += totals[before_it]
        if band == bands - 1:
            starts[table] = cells
        for bucket in range(low, high):
            end += starts[bucket]
            starts[bucket] = end
        for k in range(cells):
            q = cells - 1 - k
            if low <= buckets[q] < high:
                starts[buckets[q]] -= 1
                sorted_cells[starts[buckets[q]]] = q


@routine
def find_contacts(band, bands, rows, columns, parameters, cells, contacts, contact_counts):
    """Write contact_counts (particles,): how many triangles each mass may touch; MAX_CONTACTS of them are stored."""
    extent, mask = 0.0, np.int64(cells.starts.size - 2)
    for i in range(rows - 1):
        extent = max(extent, cells.largest[i])
    for k in range(rows * band // bands * columns, rows * (band + 1) // bands * columns):
        contact_counts[k] = find_of_mass(
            k, rows, columns, cells.begin, cells.end, cells, mask, extent, parameters, contacts
        )


@cache
def make_find(real: Real, math: str) -> SimpleNamespace:
    """Compile `hash_cells` and `find_contacts`; the arrays are those of cpu_backend/contact/self_contact.py."""
    compiler = Compiler(f"{np.dtype(real).name}_{math}", math)
    variant = compiler.variant_of(real, {"closed": False})
    return SimpleNamespace(
        hash_cells=compiler.team(variant.copied(filled(hash_cells, SEARCH_ACCESS))),
        find_contacts=compiler.banded(variant.copied(filled(find_contacts, SEARCH_ACCESS))),
    )
