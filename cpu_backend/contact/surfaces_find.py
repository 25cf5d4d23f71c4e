"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CPU threads: those at
its neighbouring vertices (contact/neighbours.py). The result does not depend on the number of threads."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.self_find import V_INSIDE, copy, make_place, place_of, seen_from, store
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas.contact import SHEET, away, dot, enforced_distance, length, mixed, nearest
from softlab.model.formulas.surface_contact import outward, scaled_length


@routine
def one_side(first, last, body, triangles, corners, values):
    """Remove contacts on the wrong side of a body, and return how many are left.

    The nearest triangle of each body decides on which side of it the vertex is. If inside, only that contact
    remains; if outside, triangles seen from behind are removed.
    """
    end = first
    for slot in range(first, last):
        on_one_side, first_body = True, body[corners[slot, 0]]
        for lead in range(first, end):
            if body[corners[lead, 0]] == first_body:
                on_one_side = values[lead, V_INSIDE] == 0.0 and values[slot, V_INSIDE] == 0.0
                break
        if on_one_side:
            if end != slot:
                copy(slot, end, triangles, corners, values)
            end += 1
    return end - first


@routine
def motion(before, predicted, k, m):
    """Return the length of the displacement of vertex k relative to that of another one."""
    return length(
        (predicted[k, 0] - before[k, 0]) - (predicted[m, 0] - before[m, 0]),
        (predicted[k, 1] - before[k, 1]) - (predicted[m, 1] - before[m, 1]),
        (predicted[k, 2] - before[k, 2]) - (predicted[m, 2] - before[m, 2]),
    )


@routine
def rest_distance(rest, k, a, b, c, s, t):
    """Return the distance from the vertex to the triangle's point at rest."""
    return length(
        rest[k, 0] - mixed(rest[a, 0], rest[b, 0], rest[c, 0], s, t),
        rest[k, 1] - mixed(rest[a, 1], rest[b, 1], rest[c, 1], s, t),
        rest[k, 2] - mixed(rest[a, 2], rest[b, 2], rest[c, 2], s, t),
    )


@routine
def add_contact(k, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, contact_count):
    """Insert the triangle among the nearest of vertex k if they may touch. Returns `contact_count`, plus 1 if so.

    `at_rest`: positions and bodies of vertices; `contacts`: (triangles, corners, values).
    """
    (rest, body), (corners_of, owned), (triangles, _, values) = at_rest, surface, contacts
    a, b, c = corners_of[triangle, 0], corners_of[triangle, 1], corners_of[triangle, 2]
    if a == k or b == k or c == k:
        return contact_count
    (px, py, pz), (ux, uy, uz), (vx, vy, vz) = seen_from(before, k, a, b, c)
    feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
    if (owned[triangle] >> feature) & 1 == 0:
        return contact_count
    rx, ry, rz = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
    distance = length(rx, ry, rz)
    nearer = max(motion(before, predicted, k, a), motion(before, predicted, k, b))
    nearer = max(nearer, motion(before, predicted, k, c))
    thickness, margin, flat = parameters.thickness, parameters.margin, parameters.normal_distance
    if FEATURE.balls:
        thickness, margin = scaled_length(ratio[k], thickness), scaled_length(ratio[k], margin)
        flat = scaled_length(ratio[k], flat)
    if not distance < thickness + margin + nearer:
        return contact_count
    first, last = k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, triangles, values)
    if place == first + MAX_CONTACTS:
        return contact_count + 1
    make_place(place, first, last, contacts)
    rest_gap = thickness
    if body[a] == body[k]:
        rest_gap = rest_distance(rest, k, a, b, c, s, t)
    inside, nx, ny, nz = outward((rx, ry, rz), distance, (ux, uy, uz), (vx, vy, vz), flat)
    if inside and (owned[triangle] >> SHEET) & 1 != 0:
        inside, nx, ny, nz = False, -nx, -ny, -nz
    enforced = enforced_distance(thickness, rest_gap, dot(nx, ny, nz, rx, ry, rz), parameters.push)
    store(place, triangle, (a, b, c), (s, t, distance), (nx, ny, nz), enforced, contacts)
    values[place, V_INSIDE] = 1.0 if inside else 0.0
    return contact_count + 1


@routine
def find_contacts(band, bands, states, at_rest, vertices, lists, meshes, parameters, ratio, written):
    """Search the triangles of all vertices with neighbours.

    `states`: (before, predicted); `at_rest`: positions and bodies of vertices; `lists`: the result of their search;
    `meshes`: ((offsets, triangles at vertices), (corners, owned features)); `written`: (triangles, corners, values,
    contact counts, lost, seen). Contact counts must be 0. `seen` (bands, triangles): the last vertex that a triangle
    was tested for, as each of its corners leads to it.
    """
    (before, predicted), (_, body), (at_vertex, surface) = states, at_rest, meshes
    triangles, corners, values, contact_counts, lost, seen = written
    (offsets, of_vertices), contacts = at_vertex, (triangles, corners, values)
    entry, missed = lists.begins[band] * MAX_NEIGHBOURS, np.int64(0)
    for t in range(seen.shape[1]):
        seen[band, t] = -1
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        k, count = np.int64(vertices[lists.who[n]]), np.int64(0)
        for e in range(entry, entry + np.int64(lists.numbers[n])):
            j = np.int64(lists.entries[e])
            for at in range(offsets[j], offsets[j + 1]):
                triangle = np.int64(of_vertices[at])
                if seen[band, triangle] != k:
                    seen[band, triangle] = k
                    count = add_contact(
                        k, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, count
                    )
        entry += np.int64(lists.numbers[n])
        slot_count, first = min(count, np.int64(MAX_CONTACTS)), k * MAX_CONTACTS
        missed += count - slot_count
        contact_counts[k] = one_side(first, first + slot_count, body, triangles, corners, values)
    lost[band] = missed


@cache
def make_find(real: Real, math: str, ratios: bool = False) -> Callable:
    """Compile `find_contacts`; `ratios`: vertices are balls."""
    compiler = Compiler(f"surfaces{'_of_balls' * ratios}_{np.dtype(real).name}_{math}", math)
    return compiler.banded(compiler.variant_of(real, {"closed": True, "balls": ratios}).copied(find_contacts))
