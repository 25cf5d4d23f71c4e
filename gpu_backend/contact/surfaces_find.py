"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CUDA: one thread per
surface vertex tests those at its neighbouring vertices (contact/neighbours.py). What a vertex does:
model/contact/triangle_search.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_find import SEARCH_ACCESS, TriangleContacts
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, routine
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.triangle_contacts import between, point
from softlab.model.contact.triangle_search import add_of_surface, one_side


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
        p = point(before, k)
        vertex = k, p, between(p, point(predicted, k))
        contacts = TriangleContacts(triangles, corners, normals, weights)
        for n in range(min(np.int64(numbers[i]), np.int64(MAX_NEIGHBOURS))):
            j = table[n * vertices.size + i]
            for at in range(offsets[j], offsets[j + 1]):
                count = add_of_surface(
                    vertex, np.int64(at_vertex[at]), before, predicted, (rest, body), (corners_of, owned), parameters,
                    ratio, contacts, count,
                )  # fmt: skip
        slot_count, first = min(count, np.int64(MAX_CONTACTS)), k * MAX_CONTACTS
        if count > slot_count:
            cuda.atomic.add(lost, 0, count - slot_count)
        slot_count = one_side(first, first + slot_count, body, contacts)
        contact_counts[k] = slot_count
        for place in range(3 * first, 3 * (first + slot_count)):
            cuda.atomic.add(link_counts, corners[place], 1)


@cache
def make_find(real: Real, math: str, ratios: bool = False) -> SimpleNamespace:
    """Compile `take`, `clear` and `find_contacts`; `ratios`: vertices are balls."""
    label = f"surfaces{'_of_balls' * ratios}_{variant_name(real, math)}"
    kernels = take, clear, filled(find_contacts, SEARCH_ACCESS)
    return kernels_of(device_variant(real, math, {"balls": ratios}), math, kernels, label)
