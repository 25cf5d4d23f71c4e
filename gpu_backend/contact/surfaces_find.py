"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CUDA: one thread per
surface vertex tests those at its neighbouring vertices (contact/neighbours.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_find import copy, make_place, motion, place_of, store
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas.contact import SHEET, away, dot, enforced_distance, length, mixed, nearest
from softlab.model.formulas.surface_contact import outward, scaled_length

# Slots and quads of a contact as in contact/self_find.py; the last number of its weights: not 0 if the vertex is
# inside.


@routine
def one_side(first, last, body, triangles, corners, normals, weights):
    """Remove contacts on the wrong side of a body, and return how many are left; see cpu_backend/contact/surfaces_find.py."""
    end = first
    for slot in range(first, last):
        on_one_side, first_body = True, body[corners[3 * slot]]
        for lead in range(first, end):
            if body[corners[3 * lead]] == first_body:
                on_one_side = load_quad(weights, lead)[3] == 0.0 and load_quad(weights, slot)[3] == 0.0
                break
        if on_one_side:
            if end != slot:
                copy(slot, end, triangles, corners, normals, weights)
            end += 1
    return end - first


@routine
def rest_distance(rest, k, a, b, c, s, t):
    """Return the distance from the vertex to the triangle's point at rest."""
    p, qa, qb, qc = load_quad(rest, k), load_quad(rest, a), load_quad(rest, b), load_quad(rest, c)
    return length(
        p[0] - mixed(qa[0], qb[0], qc[0], s, t),
        p[1] - mixed(qa[1], qb[1], qc[1], s, t),
        p[2] - mixed(qa[2], qb[2], qc[2], s, t),
    )


@routine
def add_contact(vertex, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, contact_count):
    """Insert the triangle among the nearest of a vertex if they may touch. Returns `contact_count`, plus 1 if so.

    `vertex`: its number, position and displacement; `at_rest`: positions and bodies of vertices; `surface`: (corners,
    owned features); `contacts`: (triangles, corners, normals, weights).
    """
    (k, p, moved), (rest, body), (corners_of, owned) = vertex, at_rest, surface
    triangles, _, _, weights = contacts
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
    if FEATURE.balls:
        thickness, margin = scaled_length(ratio[k], thickness), scaled_length(ratio[k], margin)
        flat = scaled_length(ratio[k], flat)
    if not distance < thickness + margin + nearer:
        return contact_count
    first = k * MAX_CONTACTS
    last = first + min(contact_count, MAX_CONTACTS)
    place = place_of(first, last, distance, triangle, triangles, weights)
    if place > first and triangles[place - 1] == triangle:
        return contact_count
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
    at = s, t, distance, 1.0 if inside else 0.0
    store(place, triangle, (a, b, c), (nx, ny, nz), enforced, at, contacts)
    return contact_count + 1


@routine
def take(before, vertices, points):
    """Write quads of the vertices, each of weight 1."""
    i = np.int64(cuda.grid(1))
    if i < vertices.size:
        p = load_quad(before, vertices[i])
        store_quad(points, i, p[0], p[1], p[2], 1.0)


@routine
def clear(contact_counts, link_counts):
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        contact_counts[k] = 0
        link_counts[k] = 0


@routine
def find_contacts(
    before, predicted, rest, body, vertices, table, numbers, offsets, at_vertex, corners_of, owned, record, ratio,
    triangles, corners, normals, weights, contact_counts, link_counts, lost,
):  # fmt: skip
    """Search the triangles of a vertex; `table`, `numbers`: the neighbours of each vertex."""
    i = np.int64(cuda.grid(1))
    if i < vertices.size:
        parameters = record[0]
        k, count = np.int64(vertices[i]), np.int64(0)
        p, now = load_quad(before, k), load_quad(predicted, k)
        vertex = k, p, (now[0] - p[0], now[1] - p[1], now[2] - p[2])
        contacts = triangles, corners, normals, weights
        for n in range(min(np.int64(numbers[i]), np.int64(MAX_NEIGHBOURS))):
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


@cache
def make_find(real: Real, math: str, ratios: bool = False) -> SimpleNamespace:
    """Compile `take`, `clear` and `find_contacts`; `ratios`: vertices are balls."""
    label = f"surfaces{'_of_balls' * ratios}_{variant_name(real, math)}"
    return kernels_of(device_variant(real, math, {"balls": ratios}), math, (take, clear, find_contacts), label)
