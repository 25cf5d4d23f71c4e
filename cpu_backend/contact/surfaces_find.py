"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CPU threads: those at
its neighbouring vertices (contact/neighbours.py). The result does not depend on the number of threads."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.self_find import V_B, V_C, V_DISTANCE, V_ENFORCED, V_NX, V_NY, V_NZ, make_slots
from softlab.cpu_backend.contact.self_find import VALUES as OF_SHEETS
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas import contact, surface_contact

V_INSIDE = OF_SHEETS  # not 0 if the vertex is inside
VALUES = OF_SHEETS + 1


def _make_slots(compiler: Compiler, real: Any) -> SimpleNamespace:
    """Make `place_of`, `copy` and `one_side`, for the sorted contacts of a vertex."""
    slots = make_slots(compiler, VALUES)
    copy = slots.copy

    @compiler.compiled
    def one_side(first, last, body, triangles, corners, values):
        """Remove contacts on the wrong side of a body, and return how many are left.

        The nearest triangle of each body decides on which side of it the vertex is. If inside, only that contact
        remains; if outside, triangles seen from behind are removed.
        """
        zero, end = real(0), first
        for slot in range(first, last):
            on_one_side, first_body = True, body[corners[slot, 0]]
            for lead in range(first, end):
                if body[corners[lead, 0]] == first_body:
                    on_one_side = values[lead, V_INSIDE] == zero and values[slot, V_INSIDE] == zero
                    break
            if on_one_side:
                if end != slot:
                    copy(slot, end, triangles, corners, values)
                end += 1
        return end - first

    return SimpleNamespace(one_side=one_side, **vars(slots))


def _make_triangle(compiler: Compiler, real: Any, slots: SimpleNamespace, ratios: bool) -> Any:
    """Make add_contact(k, triangle, before, predicted, rest, body, surface, parameters, ratio, triangles, corners, values,
    contact_count): see the inner function."""
    formulas = compiler.formulas(contact, real)
    sides = compiler.formulas(surface_contact, real)
    outward, scaled_length = sides.outward, sides.scaled_length
    nearest, away, length, dot = formulas.nearest, formulas.away, formulas.length, formulas.dot
    enforced_distance, mixed = formulas.enforced_distance, formulas.mixed
    place_of, copy = slots.place_of, slots.copy
    zero, one, sheet = real(0), real(1), contact.SHEET

    @compiler.compiled
    def motion(before, predicted, k, m):
        return length(
            (predicted[k, 0] - before[k, 0]) - (predicted[m, 0] - before[m, 0]),
            (predicted[k, 1] - before[k, 1]) - (predicted[m, 1] - before[m, 1]),
            (predicted[k, 2] - before[k, 2]) - (predicted[m, 2] - before[m, 2]),
        )

    @compiler.compiled
    def rest_distance(rest, k, a, b, c, s, t):
        """Return the distance from the vertex to the triangle's point at rest."""
        return length(
            rest[k, 0] - mixed(rest[a, 0], rest[b, 0], rest[c, 0], s, t),
            rest[k, 1] - mixed(rest[a, 1], rest[b, 1], rest[c, 1], s, t),
            rest[k, 2] - mixed(rest[a, 2], rest[b, 2], rest[c, 2], s, t),
        )

    @compiler.compiled
    def add_contact(k, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, contact_count):
        """Insert the triangle among the nearest of vertex k if they may touch. Returns `contact_count`, plus 1 if so.

        `at_rest`: positions and bodies of vertices; `contacts`: (triangles, corners, values).
        """
        (rest, body), (corners_of, owned), (triangles, corners, values) = at_rest, surface, contacts
        a, b, c = corners_of[triangle, 0], corners_of[triangle, 1], corners_of[triangle, 2]
        if a == k or b == k or c == k:
            return contact_count
        ux, uy, uz = before[b, 0] - before[a, 0], before[b, 1] - before[a, 1], before[b, 2] - before[a, 2]
        vx, vy, vz = before[c, 0] - before[a, 0], before[c, 1] - before[a, 1], before[c, 2] - before[a, 2]
        px, py, pz = before[k, 0] - before[a, 0], before[k, 1] - before[a, 1], before[k, 2] - before[a, 2]
        feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
        if (owned[triangle] >> feature) & 1 == 0:
            return contact_count
        rx, ry, rz = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
        distance = length(rx, ry, rz)
        nearer = max(motion(before, predicted, k, a), motion(before, predicted, k, b))
        nearer = max(nearer, motion(before, predicted, k, c))
        thickness, margin, flat = parameters.thickness, parameters.margin, parameters.normal_distance
        if ratios:  # vertices that are balls
            thickness, margin, flat = (
                scaled_length(ratio[k], thickness),
                scaled_length(ratio[k], margin),
                scaled_length(ratio[k], flat),
            )
        if not distance < thickness + margin + nearer:
            return contact_count
        first, last = k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_count, MAX_CONTACTS)
        place = place_of(first, last, distance, triangle, triangles, values)
        if place == first + MAX_CONTACTS:
            return contact_count + 1
        for slot in range(min(last, first + MAX_CONTACTS - 1), place, -1):
            copy(slot - 1, slot, triangles, corners, values)
        rest_gap = thickness
        if body[a] == body[k]:
            rest_gap = rest_distance(rest, k, a, b, c, s, t)
        inside, nx, ny, nz = outward((rx, ry, rz), distance, (ux, uy, uz), (vx, vy, vz), flat)
        if inside and (owned[triangle] >> sheet) & 1 != 0:
            inside, nx, ny, nz = False, -nx, -ny, -nz
        triangles[place] = triangle
        corners[place, 0], corners[place, 1], corners[place, 2] = a, b, c
        values[place, V_B], values[place, V_C], values[place, V_DISTANCE] = s, t, distance
        values[place, V_NX], values[place, V_NY], values[place, V_NZ] = nx, ny, nz
        gap = dot(nx, ny, nz, rx, ry, rz)
        values[place, V_ENFORCED] = enforced_distance(thickness, rest_gap, gap, parameters.push)
        values[place, V_INSIDE] = one if inside else zero
        return contact_count + 1

    return add_contact


@cache
def make_find(real: Any, math: str, ratios: bool = False) -> Any:
    """Compile find_contacts(bands, states, at_rest, vertices, lists, meshes, parameters, ratio, written), for all vertices
    with neighbours.

    `states`: (before, predicted); `at_rest`: positions and bodies of vertices; `lists`: the result of their search;
    `meshes`: ((offsets, triangles at vertices), (corners, owned features)); `written`: (triangles, corners, values,
    found, lost, seen). `contact_counts` must be 0. `seen` (bands, triangles): the last vertex that a triangle was
    tested for, as each of its corners leads to it.
    """
    compiler = Compiler(f"surfaces{'_of_balls' * ratios}_{np.dtype(real).name}_{math}", math)
    slots = _make_slots(compiler, real)
    add_contact, one_side = _make_triangle(compiler, real, slots, ratios), slots.one_side

    def find_contacts(band, bands, states, at_rest, vertices, lists, meshes, parameters, ratio, written):
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

    return compiler.banded(find_contacts)
