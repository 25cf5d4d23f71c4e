"""Search of the triangles that a mass of a cloth may touch within a substep: the sheet's cells hashed by a counting
sort, and the nearest triangles of each mass. Parallel over rows, buckets and masses; the result does not depend on the
number of threads."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine
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

VALUES = 7  # values of a contact:
V_B, V_C, V_NX, V_NY, V_NZ, V_ENFORCED, V_DISTANCE = range(VALUES)
V_INSIDE = VALUES  # with a surface: not 0 if the vertex is inside
VALUES_OF_SURFACES = VALUES + 1


class Cells(NamedTuple):
    """Masses' positions and displacements in a substep; boxes, keys and buckets of the sheet's cells; largest extent of a
    cell in each row; first cell of each bucket among the sorted ones; number of cells in each band's buckets."""

    begin: np.ndarray
    move: np.ndarray
    boxes: np.ndarray
    keys: np.ndarray
    buckets: np.ndarray
    largest: np.ndarray
    starts: np.ndarray
    totals: np.ndarray
    sorted_cells: np.ndarray


@routine
def place_of(first, last, distance, triangle, triangles, values):
    """Return the place of a new contact, sorted by distance, then by number."""
    place = last
    while place > first and (
        distance < values[place - 1, V_DISTANCE]
        or (distance == values[place - 1, V_DISTANCE] and triangle < triangles[place - 1])
    ):
        place -= 1
    return place


@routine
def copy(source, target, triangles, corners, values):
    triangles[target] = triangles[source]
    for axis in range(3):
        corners[target, axis] = corners[source, axis]
    for value in range(VALUES_OF_SURFACES if FEATURE.closed else VALUES):
        values[target, value] = values[source, value]


@inlined_routine
def make_place(place, first, last, contacts):
    """Move the contacts of a mass from `place` on by one; the last of MAX_CONTACTS is lost."""
    triangles, corners, values = contacts
    for slot in range(min(last, first + MAX_CONTACTS - 1), place, -1):
        copy(slot - 1, slot, triangles, corners, values)


@inlined_routine
def store(place, triangle, vertices, at, n, enforced, contacts):
    """Write a contact with a triangle of three `vertices`, without V_INSIDE. `at`: (b, c, distance)."""
    triangles, corners, values = contacts
    triangles[place] = triangle
    corners[place, 0], corners[place, 1], corners[place, 2] = vertices
    values[place, V_B], values[place, V_C], values[place, V_DISTANCE] = at
    values[place, V_NX], values[place, V_NY], values[place, V_NZ] = n
    values[place, V_ENFORCED] = enforced


@routine
def difference(points, a, b):
    return points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]


@routine
def seen_from(points, k, a, b, c):
    """Return point k and the second and third corner of a triangle, seen from its first one."""
    return difference(points, a, k), difference(points, a, b), difference(points, a, c)


@routine
def floor(x):
    """Return the largest integer up to x."""
    whole = np.int64(x)
    return whole - 1 if x < real(whole) else whole


@routine
def relative(move, k, reference):
    """Return the length of the displacement of mass k relative to that of another one."""
    return length(move[k, 0] - move[reference, 0], move[k, 1] - move[reference, 1], move[k, 2] - move[reference, 2])


@routine
def add_contact(mass, triangle, begin, move, columns, parameters, contacts, contact_count):
    """Insert the triangle among the nearest of a mass (its number, row and column), if they may touch.

    Sorted by distance, then by number. Returns `contact_count`, plus 1 if they may touch. `contacts`: (triangles,
    corners, values).
    """
    (k, i, j), (triangles, _, values) = mass, contacts
    second, cell = triangle % 2 == 1, triangle // 2
    a, b, c = corners_of(triangle, columns)
    if a == k or b == k or c == k:
        return contact_count
    (px, py, pz), (ux, uy, uz), (vx, vy, vz) = seen_from(begin, k, a, b, c)
    feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
    cell_i = cell // (columns - 1)
    if not owns(second, feature, cell_i, cell - cell_i * (columns - 1)):
        return contact_count
    rx, ry, rz = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
    distance = length(rx, ry, rz)
    nearer = max(relative(move, k, a), max(relative(move, k, b), relative(move, k, c)))
    if not distance < parameters.thickness + parameters.margin + nearer:
        return contact_count
    first, last = k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, triangles, values)
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
    gap = dot(n[0], n[1], n[2], rx, ry, rz)
    enforced = enforced_distance(parameters.thickness, rest, gap, parameters.push)
    store(place, triangle, (a, b, c), (s, t, distance), n, enforced, contacts)
    return contact_count + 1


@routine
def enclose(q, a, columns, begin, move, reference, boxes, center):
    """Write the box of the four corners of cell q during the substep, relative to the motion of `reference`.

    Returns its largest extent from the cell's middle along an axis. Boxes are used because those of a flat sheet
    are thin, which balls are not.
    """
    b, c, d = a + 1, a + columns, a + columns + 1
    moved, extent = 0.0, 0.0
    for corner in (a, b, c, d):
        moved = max(moved, relative(move, corner, reference))
    for axis in range(3):
        w, x, y, z = begin[a, axis], begin[b, axis], begin[c, axis], begin[d, axis]
        low, high = min(min(w, x), min(y, z)) - moved, max(max(w, x), max(y, z)) + moved
        boxes[q, axis], boxes[q, 3 + axis] = low, high
        extent = max(extent, max(center[axis] - low, high - center[axis]))
    return extent


@routine
def center_of(a, columns, begin, axis):
    return middle(begin[a, axis], begin[a + 1, axis], begin[a + columns, axis], begin[a + columns + 1, axis])


@routine
def hash_cells(team, member, bands, before, predicted, parameters, table_of):
    """Copy the state before and the displacement of (3, rows, columns) by masses, and sort the sheet's cells into
    buckets.

    The cells of bucket b are sorted_cells[starts[b] : starts[b + 1]], in ascending order. Each thread has a range
    of buckets and reads all cells. `table_of`: Cells.
    """
    begin, move, boxes, keys, buckets = table_of.begin, table_of.move, table_of.boxes, table_of.keys, table_of.buckets
    largest, starts, totals, sorted_cells = table_of.largest, table_of.starts, table_of.totals, table_of.sorted_cells
    rows, columns = before.shape[1], before.shape[2]
    for band in assigned(team, member, bands):
        for i in range(rows * band // bands, rows * (band + 1) // bands):
            for j in range(columns):
                for axis in range(3):
                    begin[i * columns + j, axis] = before[axis, i, j]
                    move[i * columns + j, axis] = predicted[axis, i, j] - before[axis, i, j]
    mask, cells = np.int64(starts.size - 2), (rows - 1) * (columns - 1)
    reference = (rows // 2) * columns + columns // 2
    for band in assigned(team, member, bands):
        for i in range((rows - 1) * band // bands, (rows - 1) * (band + 1) // bands):
            most = 0.0
            for j in range(columns - 1):
                q = i * (columns - 1) + j
                a = i * columns + j
                center = (
                    center_of(a, columns, begin, 0), center_of(a, columns, begin, 1), center_of(a, columns, begin, 2)
                )  # fmt: skip
                most = max(most, enclose(q, a, columns, begin, move, reference, boxes, center))
                x = floor(scaled(center[0], parameters.inverse_cell))
                y = floor(scaled(center[1], parameters.inverse_cell))
                z = floor(scaled(center[2], parameters.inverse_cell))
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
def beside(x, y, z, radius, boxes, q):
    """Return True if a point is farther than `radius` from the box of cell q along an axis."""
    return (
        x < boxes[q, 0] - radius or x > boxes[q, 3] + radius or y < boxes[q, 1] - radius or y > boxes[q, 4] + radius
        or z < boxes[q, 2] - radius or z > boxes[q, 5] + radius
    )  # fmt: skip


@routine
def find_contacts(
    rows, columns, record, begin, move, boxes, keys, largest, starts, sorted_cells, triangles, corners, values,
    contact_counts,
):  # fmt: skip
    """Write found (particles,): how many triangles each mass may touch; MAX_CONTACTS of them are stored."""
    extent, mask = 0.0, np.int64(starts.size - 2)
    for i in range(rows - 1):
        extent = max(extent, largest[i])
    reference = (rows // 2) * columns + columns // 2
    for row in prange(rows):
        i = np.int64(row)
        for j in range(columns):
            k, count = i * columns + j, np.int64(0)
            x, y, z = begin[k, 0], begin[k, 1], begin[k, 2]
            radius = record[0].thickness + record[0].margin + relative(move, k, reference)
            search_radius = min(radius + extent, record[0].reach)
            lowest = (
                floor(scaled(x - search_radius, record[0].inverse_cell)),
                floor(scaled(y - search_radius, record[0].inverse_cell)),
                floor(scaled(z - search_radius, record[0].inverse_cell)),
            )
            span_x = min(floor(scaled(x + search_radius, record[0].inverse_cell)) - lowest[0] + 1, SPAN)
            span_y = min(floor(scaled(y + search_radius, record[0].inverse_cell)) - lowest[1] + 1, SPAN)
            span_z = min(floor(scaled(z + search_radius, record[0].inverse_cell)) - lowest[2] + 1, SPAN)
            for place in range(span_x * span_y * span_z):
                cx = lowest[0] + place % span_x
                cy = lowest[1] + place // span_x % span_y
                cz = lowest[2] + place // (span_x * span_y)
                key, bucket = key_of(cx, cy, cz), bucket_of(cx, cy, cz, mask)
                for entry in range(starts[bucket], starts[bucket + 1]):
                    q = np.int64(sorted_cells[entry])
                    if keys[q] == key and not beside(x, y, z, radius, boxes, q):
                        for second in range(2):
                            count = add_contact(
                                (k, i, np.int64(j)), 2 * q + second, begin, move, columns, record[0],
                                (triangles, corners, values), count,
                            )  # fmt: skip
            contact_counts[k] = count


@cache
def make_find(real: Real, math: str) -> SimpleNamespace:
    """Compile `hash_cells` and `find_contacts`; the arrays are those of cpu_backend/contact/self_contact.py."""
    compiler = Compiler(f"{np.dtype(real).name}_{math}", math)
    variant = compiler.variant_of(real, {"closed": False})
    return SimpleNamespace(
        hash_cells=compiler.team(variant.copied(hash_cells)),
        find_contacts=compiler.kernel(variant.copied(find_contacts)),
    )
