"""Search of the triangles that a particle may touch within a substep: what a cell, a triangle and a particle do.

A mass of a cloth searches the cells of its sheet, hashed by their middles; a vertex of a surface tests the triangles at
its neighbouring vertices. A particle stores its MAX_CONTACTS nearest triangles, sorted by distance, then by number, so
that the order of the search does not matter. `begin`, `end`: positions before the substep and predicted.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, Open, inlined_routine, real, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS, SPAN
from softlab.model.contact.triangle_contacts import (
    between,
    corners_of_contact,
    corners_of_surface,
    offset,
    point,
    weights_of_contact,
)
from softlab.model.formulas.contact import (
    SHEET,
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
from softlab.model.formulas.surface_contact import outward, scaled_length

copy = Open("copy(source, target, contacts): copy a contact")
store = Open(
    "store(place, triangle, corners, normal, stored distance, (b, c, distance, 1 if inside), contacts): write a contact"
)
is_inside = Open("is_inside(contacts, slot) -> True if the vertex of a contact with a surface is inside")
box_of = Open("box_of(boxes, q) -> (lowest corner, highest corner) of a cell's box")
cells_in = Open("cells_in(table, bucket) -> (first, last + 1) of its cells in table.sorted_cells")


@routine
def floor(x):
    """Return the largest integer up to x."""
    whole = np.int64(x)
    return whole - 1 if x < real(whole) else whole


@inlined_routine
def relative(moved, k, begin, end, p):
    """Return the length of the displacement `moved` relative to that of particle k, which was at p."""
    other = between(p, point(end, k))
    return length(moved[0] - other[0], moved[1] - other[1], moved[2] - other[2])


# ---------------------------------------------------------------------- the contacts of a particle


@routine
def place_of(first, last, distance, triangle, contacts):
    """Return the place of a new contact, sorted by distance, then by number."""
    place = last
    while place > first:
        other = weights_of_contact(contacts, place - 1)[2]
        if not (distance < other or (distance == other and triangle < contacts.triangles[place - 1])):
            break
        place -= 1
    return place


@routine
def make_place(place, first, last, contacts):
    """Move the contacts of a particle from `place` on by one; the last of MAX_CONTACTS is lost."""
    slot = min(last, first + MAX_CONTACTS - 1)
    while slot > place:
        copy(slot - 1, slot, contacts)
        slot -= 1


@inlined_routine
def nearest_point(p, a, b, c):
    """Return (feature, s, t, vector from there to p, both edges) of the point of a triangle that is nearest to p."""
    (px, py, pz), (ux, uy, uz), (vx, vy, vz) = between(a, p), between(a, b), between(a, c)
    feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
    r = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
    return feature, s, t, r, (ux, uy, uz), (vx, vy, vz)


@inlined_routine
def nearer_by(moved, corners, begin, end, a, b, c):
    """Return how much nearer a particle that moves by `moved` may come to a triangle: the largest relative
    displacement of a corner."""
    nearer = max(relative(moved, corners[0], begin, end, a), relative(moved, corners[1], begin, end, b))
    return max(nearer, relative(moved, corners[2], begin, end, c))


# ---------------------------------------------------------------------- a mass of a cloth


@routine
def add_of_sheet(mass, triangle, begin, end, columns, parameters, contacts, contact_count):
    """Insert the triangle among the nearest of a mass, if they may touch. Returns `contact_count`, plus 1 if so.

    `mass`: its number, row and column, position and displacement.
    """
    (k, i, j, p, moved), second, cell = mass, triangle % 2 == 1, triangle // 2
    a, b, c = corners_of(triangle, columns)
    if a == k or b == k or c == k:
        return contact_count
    qa, qb, qc = point(begin, a), point(begin, b), point(begin, c)
    feature, s, t, r, u, v = nearest_point(p, qa, qb, qc)
    cell_i = cell // (columns - 1)
    if not owns(second, feature, cell_i, cell - cell_i * (columns - 1)):
        return contact_count
    distance = length(r[0], r[1], r[2])
    if not distance < parameters.thickness + parameters.margin + nearer_by(moved, (a, b, c), begin, end, qa, qb, qc):
        return contact_count
    first = k * MAX_CONTACTS
    last = first + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, contacts)
    if place == first + MAX_CONTACTS:
        return contact_count + 1
    make_place(place, first, last, contacts)
    row_a, column_a = a // columns, a % columns
    rest = rest_distance(
        real(i - row_a), real(b // columns - row_a), real(c // columns - row_a),
        real(j - column_a), real(b % columns - column_a), real(c % columns - column_a), s, t, parameters.spacing,
    )  # fmt: skip
    n = normal(r, distance, u, v, parameters.normal_distance, parameters.coincident, k > a)
    enforced = enforced_distance(parameters.thickness, rest, dot(n[0], n[1], n[2], r[0], r[1], r[2]), parameters.push)
    store(place, triangle, (a, b, c), n, enforced, (s, t, distance, 0.0), contacts)
    return contact_count + 1


@routine
def cell_box(a, columns, begin, end, reference):
    """Return (lowest corner, highest corner, middle) of a cell's four corners during the substep, relative to the motion
    of `reference`. a: its first corner.

    Boxes are used because those of a flat sheet are thin, which balls are not.
    """
    b, c, d, p = a + 1, a + columns, a + columns + 1, point(begin, reference)
    qa, qb, qc, qd = point(begin, a), point(begin, b), point(begin, c), point(begin, d)
    by = between(p, point(end, reference))
    moved = max(relative(by, a, begin, end, qa), relative(by, b, begin, end, qb))
    moved = max(max(moved, relative(by, c, begin, end, qc)), relative(by, d, begin, end, qd))
    low = (
        min(min(qa[0], qb[0]), min(qc[0], qd[0])) - moved, min(min(qa[1], qb[1]), min(qc[1], qd[1])) - moved,
        min(min(qa[2], qb[2]), min(qc[2], qd[2])) - moved,
    )  # fmt: skip
    high = (
        max(max(qa[0], qb[0]), max(qc[0], qd[0])) + moved, max(max(qa[1], qb[1]), max(qc[1], qd[1])) + moved,
        max(max(qa[2], qb[2]), max(qc[2], qd[2])) + moved,
    )  # fmt: skip
    center = (
        middle(qa[0], qb[0], qc[0], qd[0]), middle(qa[1], qb[1], qc[1], qd[1]), middle(qa[2], qb[2], qc[2], qd[2])
    )  # fmt: skip
    return low, high, center


@inlined_routine
def extent_of(low, high, center):
    """Return the largest extent of a box from the cell's middle along an axis."""
    x, y = max(center[0] - low[0], high[0] - center[0]), max(center[1] - low[1], high[1] - center[1])
    return max(max(x, y), max(center[2] - low[2], high[2] - center[2]))


@inlined_routine
def cell_at(x, y, z, inverse_cell):
    """Return the cell of space of a point."""
    return floor(scaled(x, inverse_cell)), floor(scaled(y, inverse_cell)), floor(scaled(z, inverse_cell))


@inlined_routine
def is_beside(p, radius, box):
    """Return True if a point is farther than `radius` from a box along an axis."""
    low, high = box
    return (
        p[0] < low[0] - radius or p[0] > high[0] + radius or p[1] < low[1] - radius or p[1] > high[1] + radius
        or p[2] < low[2] - radius or p[2] > high[2] + radius
    )  # fmt: skip


@routine
def find_of_mass(k, rows, columns, begin, end, table, mask, extent, parameters, contacts):
    """Return how many triangles mass k may touch; MAX_CONTACTS of them are stored.

    `table`: the cells of the sheet, in buckets up to `mask`; `extent`: the largest one of a cell (`extent_of`).
    """
    i, count, reference = k // columns, np.int64(0), (rows // 2) * columns + columns // 2
    p = point(begin, k)
    moved = between(p, point(end, k))
    mass = k, i, k - i * columns, p, moved
    radius = parameters.thickness + parameters.margin + relative(moved, reference, begin, end, point(begin, reference))
    search_radius, scale = min(radius + extent, parameters.reach), parameters.inverse_cell
    x, y, z = cell_at(p[0] - search_radius, p[1] - search_radius, p[2] - search_radius, scale)
    last_x, last_y, last_z = cell_at(p[0] + search_radius, p[1] + search_radius, p[2] + search_radius, scale)
    span_x, span_y, span_z = min(last_x - x + 1, SPAN), min(last_y - y + 1, SPAN), min(last_z - z + 1, SPAN)
    for place in range(span_x * span_y * span_z):
        cx, cy, cz = x + place % span_x, y + place // span_x % span_y, z + place // (span_x * span_y)
        key, (first, last) = key_of(cx, cy, cz), cells_in(table, bucket_of(cx, cy, cz, mask))
        for entry in range(first, last):
            q = np.int64(table.sorted_cells[entry])
            if table.keys[q] == key and not is_beside(p, radius, box_of(table.boxes, q)):
                for second in range(2):
                    count = add_of_sheet(mass, 2 * q + second, begin, end, columns, parameters, contacts, count)
    return count


# ---------------------------------------------------------------------- a vertex of a surface


@routine
def add_of_surface(vertex, triangle, begin, end, at_rest, surface, parameters, ratio, contacts, contact_count):
    """Insert the triangle among the nearest of a vertex if they may touch. Returns `contact_count`, plus 1 if so.

    `vertex`: its number, position and displacement; `at_rest`: positions and bodies of vertices; `surface`: (corners,
    owned features) of triangles.
    """
    (k, p, moved), (rest, body), (corners, owned) = vertex, at_rest, surface
    a, b, c = corners_of_surface(corners, triangle)
    if a == k or b == k or c == k:
        return contact_count
    qa, qb, qc = point(begin, a), point(begin, b), point(begin, c)
    feature, s, t, r, u, v = nearest_point(p, qa, qb, qc)
    if (owned[triangle] >> feature) & 1 == 0:
        return contact_count
    distance = length(r[0], r[1], r[2])
    thickness, margin, flat = parameters.thickness, parameters.margin, parameters.normal_distance
    if FEATURE.balls:
        thickness, margin = scaled_length(ratio[k], thickness), scaled_length(ratio[k], margin)
        flat = scaled_length(ratio[k], flat)
    if not distance < thickness + margin + nearer_by(moved, (a, b, c), begin, end, qa, qb, qc):
        return contact_count
    first = k * MAX_CONTACTS
    last = first + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, contacts)
    if place > first and contacts.triangles[place - 1] == triangle:  # each of its corners may lead to it
        return contact_count
    if place == first + MAX_CONTACTS:
        return contact_count + 1
    make_place(place, first, last, contacts)
    rest_gap = thickness
    if body[a] == body[k]:
        x, y, z = offset(rest, k, (a, b, c), s, t)
        rest_gap = length(x, y, z)
    inside, nx, ny, nz = outward(r, distance, u, v, flat)
    if inside and (owned[triangle] >> SHEET) & 1 != 0:
        inside, nx, ny, nz = False, -nx, -ny, -nz
    enforced = enforced_distance(thickness, rest_gap, dot(nx, ny, nz, r[0], r[1], r[2]), parameters.push)
    store(place, triangle, (a, b, c), (nx, ny, nz), enforced, (s, t, distance, 1.0 if inside else 0.0), contacts)
    return contact_count + 1


@routine
def one_side(first, last, body, contacts):
    """Remove contacts on the wrong side of a body, and return how many are left.

    The nearest triangle of each body decides on which side of it the vertex is. If inside, only that contact
    remains; if outside, triangles seen from behind are removed.
    """
    end = first
    for slot in range(first, last):
        on_one_side, first_body = True, body[corners_of_contact(contacts, slot)[0]]
        for lead in range(first, end):
            if body[corners_of_contact(contacts, lead)[0]] == first_body:
                on_one_side = not is_inside(contacts, lead) and not is_inside(contacts, slot)
                break
        if on_one_side:
            if end != slot:
                copy(slot, end, contacts)
            end += 1
    return end - first
