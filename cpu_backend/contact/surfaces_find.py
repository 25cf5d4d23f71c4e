"""Search of the triangles of other bodies' surfaces that a vertex may touch within a substep, on CPU threads: those at
its neighbouring vertices (contact/neighbours.py). The result does not depend on the number of threads. What a vertex does:
model/contact/triangle_search.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.self_find import SEARCH_ACCESS
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, routine
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.triangle_contacts import between, point
from softlab.model.contact.triangle_search import add_of_surface, one_side


@routine
def find_contacts(band, bands, states, at_rest, vertices, lists, meshes, parameters, ratio, written):
    """Search the triangles of all vertices with neighbours.

    `states`: (before, predicted); `at_rest`: positions and bodies of vertices; `lists`: the result of their search;
    `meshes`: ((offsets, triangles at vertices), (corners, owned features)); `written`: (contacts, contact counts,
    lost, seen). Contact counts must be 0. `seen` (bands, triangles): the last vertex that a triangle
    was tested for, as each of its corners leads to it.
    """
    (before, predicted), (_, body), (at_vertex, surface) = states, at_rest, meshes
    (offsets, of_vertices), (contacts, contact_counts, lost, seen) = at_vertex, written
    entry, missed = lists.begins[band] * MAX_NEIGHBOURS, np.int64(0)
    for t in range(seen.shape[1]):
        seen[band, t] = -1
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        k, count = np.int64(vertices[lists.who[n]]), np.int64(0)
        p = point(before, k)
        vertex = k, p, between(p, point(predicted, k))
        for e in range(entry, entry + np.int64(lists.numbers[n])):
            j = np.int64(lists.entries[e])
            for at in range(offsets[j], offsets[j + 1]):
                triangle = np.int64(of_vertices[at])
                if seen[band, triangle] != k:
                    seen[band, triangle] = k
                    count = add_of_surface(
                        vertex, triangle, before, predicted, at_rest, surface, parameters, ratio, contacts, count
                    )
        entry += np.int64(lists.numbers[n])
        slot_count, first = min(count, np.int64(MAX_CONTACTS)), k * MAX_CONTACTS
        missed += count - slot_count
        contact_counts[k] = one_side(first, first + slot_count, body, contacts)
    lost[band] = missed


@cache
def make_find(real: Real, math: str, ratios: bool = False) -> Callable:
    """Compile `find_contacts`; `ratios`: vertices are balls."""
    compiler = Compiler(f"surfaces{'_of_balls' * ratios}_{np.dtype(real).name}_{math}", math)
    variant = compiler.variant_of(real, {"closed": True, "balls": ratios})
    return compiler.banded(variant.copied(filled(find_contacts, SEARCH_ACCESS)))
