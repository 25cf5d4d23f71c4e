"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CUDA: one thread per
surface vertex tests those at its neighbouring vertices (contact/neighbours.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_find import make_slots
from softlab.gpu_backend.core.compile import kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas import contact, surface_contact

# Slots and quads of a contact as in contact/self_find.py; the last number of its weights: not 0 if the vertex is
# inside.


@cache
def _make_slots(real: Any, math: str) -> SimpleNamespace:
    """Make `place_of`, `copy`, `one_side`, as in cpu_backend/contact/surfaces_find.py."""
    device, zero, slots = cuda.jit(device=True, **kernel_options(math)), real(0), make_slots(math)
    copy = slots.copy

    @device
    def one_side(first, last, body, triangles, corners, normals, weights):
        end = first
        for slot in range(first, last):
            on_one_side, first_body = True, body[corners[3 * slot]]
            for lead in range(first, end):
                if body[corners[3 * lead]] == first_body:
                    on_one_side = load_quad(weights, lead)[3] == zero and load_quad(weights, slot)[3] == zero
                    break
            if on_one_side:
                if end != slot:
                    copy(slot, end, triangles, corners, normals, weights)
                end += 1
        return end - first

    return SimpleNamespace(one_side=one_side, **vars(slots))


@cache
def _make_add_contact(real: Any, math: str, ratios: bool) -> Any:
    """Make add_contact(k, p, moved, triangle, before, predicted, rest, body, corners_of, owned, parameters, ratio, triangles,
    corners, normals, weights, contact_count), as in cpu_backend/contact/surfaces_find.py."""
    device, slots = cuda.jit(device=True, **kernel_options(math)), _make_slots(real, math)
    formulas, sides = device_formulas(contact, real, math), device_formulas(surface_contact, real, math)
    outward, scaled_length = sides.outward, sides.scaled_length
    nearest, away, length, dot = formulas.nearest, formulas.away, formulas.length, formulas.dot
    enforced_distance, mixed = formulas.enforced_distance, formulas.mixed
    place_of, copy = slots.place_of, slots.copy
    zero, one, sheet = real(0), real(1), contact.SHEET

    @device
    def motion(other, moved, was):
        return length(
            moved[0] - (other[0] - was[0]), moved[1] - (other[1] - was[1]), moved[2] - (other[2] - was[2])
        )  # fmt: skip

    @device
    def rest_distance(rest, k, a, b, c, s, t):
        p, qa, qb, qc = load_quad(rest, k), load_quad(rest, a), load_quad(rest, b), load_quad(rest, c)
        return length(
            p[0] - mixed(qa[0], qb[0], qc[0], s, t),
            p[1] - mixed(qa[1], qb[1], qc[1], s, t),
            p[2] - mixed(qa[2], qb[2], qc[2], s, t),
        )

    @device
    def add_contact(vertex, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, contact_count):
        """Insert the triangle among the nearest of a vertex if they may touch. Returns `contact_count`, plus 1 if so.

        `vertex`: its number, position and displacement; `at_rest`: positions and bodies of vertices; `surface`: (corners,
        owned features); `contacts`: (triangles, corners, normals, weights).
        """
        (k, p, moved), (rest, body), (corners_of, owned) = vertex, at_rest, surface
        triangles, corners, normals, weights = contacts
        a, b, c = corners_of[3 * triangle], corners_of[3 * triangle + 1], corners_of[3 * triangle + 2]
        if a == k or b == k or c == k:
            return contact_count
        qa, qb, qc = load_quad(before, a), load_quad(before, b), load_quad(before, c)
        ux, uy, uz = qb[0] - qa[0], qb[1] - qa[1], qb[2] - qa[2]
        vx, vy, vz = qc[0] - qa[0], qc[1] - qa[1], qc[2] - qa[2]
        px, py, pz = p[0] - qa[0], p[1] - qa[1], p[2] - qa[2]
        feature, s, t = nearest(ux, uy, uz, vx, vy, vz, px, py, pz)
        if (owned[triangle] >> feature) & 1 == 0:
            return contact_count
        rx, ry, rz = away(px, ux, vx, s, t), away(py, uy, vy, s, t), away(pz, uz, vz, s, t)
        distance = length(rx, ry, rz)
        nearer = max(motion(load_quad(predicted, a), moved, qa), motion(load_quad(predicted, b), moved, qb))
        nearer = max(nearer, motion(load_quad(predicted, c), moved, qc))
        thickness, margin, flat = parameters.thickness, parameters.margin, parameters.normal_distance
        if ratios:  # balls
            thickness, margin, flat = (
                scaled_length(ratio[k], thickness),
                scaled_length(ratio[k], margin),
                scaled_length(ratio[k], flat),
            )
        if not distance < thickness + margin + nearer:
            return contact_count
        first = k * MAX_CONTACTS
        last = first + min(contact_count, MAX_CONTACTS)
        place = place_of(first, last, distance, triangle, triangles, weights)
        if place > first and triangles[place - 1] == triangle:
            return contact_count
        if place == first + MAX_CONTACTS:
            return contact_count + 1
        slot = min(last, first + MAX_CONTACTS - 1)
        while slot > place:
            copy(slot - 1, slot, triangles, corners, normals, weights)
            slot -= 1
        rest_gap = thickness
        if body[a] == body[k]:
            rest_gap = rest_distance(rest, k, a, b, c, s, t)
        inside, nx, ny, nz = outward((rx, ry, rz), distance, (ux, uy, uz), (vx, vy, vz), flat)
        if inside and (owned[triangle] >> sheet) & 1 != 0:
            inside, nx, ny, nz = False, -nx, -ny, -nz
        triangles[place] = triangle
        corners[3 * place], corners[3 * place + 1], corners[3 * place + 2] = a, b, c
        enforced = enforced_distance(thickness, rest_gap, dot(nx, ny, nz, rx, ry, rz), parameters.push)
        store_quad(normals, place, nx, ny, nz, enforced)
        store_quad(weights, place, s, t, distance, one if inside else zero)
        return contact_count + 1

    return add_contact


@cache
def make_find(real: Any, math: str, ratios: bool = False) -> SimpleNamespace:
    """Compile `take`, `clear` and `find_contacts`.

    `take(before, vertices, points)`: quads of the vertices, each of weight 1; `clear(contact_counts, link_counts)`;
    `find_contacts(before, predicted, rest, body, vertices, table, numbers, offsets, at_vertex, corners_of, owned,
    record, ratio, triangles, corners, normals, weights, contact_counts, link_counts, lost)`: `table`, `numbers`: the
    neighbours of each vertex.
    """
    add_contact, one_side = _make_add_contact(real, math, ratios), _make_slots(real, math).one_side
    one, many = real(1), np.int64(MAX_NEIGHBOURS)

    def take(before, vertices, points):
        i = np.int64(cuda.grid(1))
        if i < vertices.size:
            p = load_quad(before, vertices[i])
            store_quad(points, i, p[0], p[1], p[2], one)

    def clear(contact_counts, link_counts):
        k = np.int64(cuda.grid(1))
        if k < contact_counts.size:
            contact_counts[k] = 0
            link_counts[k] = 0

    def find_contacts(
        before, predicted, rest, body, vertices, table, numbers, offsets, at_vertex, corners_of, owned, record, ratio,
        triangles, corners, normals, weights, contact_counts, link_counts, lost,
    ):  # fmt: skip
        i = np.int64(cuda.grid(1))
        if i < vertices.size:
            parameters = record[0]
            k, count = np.int64(vertices[i]), np.int64(0)
            p, now = load_quad(before, k), load_quad(predicted, k)
            vertex = k, p, (now[0] - p[0], now[1] - p[1], now[2] - p[2])
            contacts = triangles, corners, normals, weights
            for n in range(min(np.int64(numbers[i]), many)):
                j = table[n * vertices.size + i]
                for at in range(offsets[j], offsets[j + 1]):
                    count = add_contact(
                        vertex, np.int64(at_vertex[at]), before, predicted, (rest, body), (corners_of, owned), parameters,
                        ratio, contacts, count,
                    )  # fmt: skip
            slot_count, first = min(count, np.int64(MAX_CONTACTS)), k * MAX_CONTACTS
            if count > slot_count:
                cuda.atomic.add(lost, 0, count - slot_count)
            slot_count = one_side(first, first + slot_count, body, triangles, corners, normals, weights)
            contact_counts[k] = slot_count
            for place in range(3 * first, 3 * (first + slot_count)):
                cuda.atomic.add(link_counts, corners[place], 1)

    return make_kernels(
        (take, clear, find_contacts), f"surfaces{'_of_balls' * ratios}_{variant_name(real, math)}", **kernel_options(math)
    )  # fmt: skip
