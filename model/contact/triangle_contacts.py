"""Contacts of a particle with triangles: what search (triangle_search.py) and projection (triangle_push.py) share.

Both backends compile these routines; a backend fills in how it reads and writes its arrays. `contacts`: the arrays of
all contacts, of which particle k has those from MAX_CONTACTS k on; `points`: positions of all particles.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import Open, inlined_routine, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas.contact import mixed

point = Open("point(points, k) -> (x, y, z)")
corners_of_contact = Open("corners_of_contact(contacts, slot) -> (a, b, c), the corners of its triangle")
normal_of_contact = Open("normal_of_contact(contacts, slot) -> (nx, ny, nz, stored distance)")
weights_of_contact = Open("weights_of_contact(contacts, slot) -> (b, c, distance at the substep's start, ...)")
corners_of_surface = Open("corners_of_surface(surface, triangle) -> (a, b, c)")


@routine
def slots_of(contact_counts, k):
    """Return first and last + 1 of the contacts of particle k."""
    first = k * MAX_CONTACTS
    return first, first + min(np.int64(contact_counts[k]), np.int64(MAX_CONTACTS))


@inlined_routine
def between(p, q):
    """Return the vector from p to q."""
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@inlined_routine
def offset_of(p, a, b, c, s, t):
    """Return the vector to p from the point of the triangle a, b, c with the weights s and t of b and c."""
    return (
        p[0] - mixed(a[0], b[0], c[0], s, t),
        p[1] - mixed(a[1], b[1], c[1], s, t),
        p[2] - mixed(a[2], b[2], c[2], s, t),
    )


@routine
def offset(points, k, corners, s, t):
    """Return the vector to particle k from a point of a triangle; see `offset_of`."""
    a, b, c = corners
    return offset_of(point(points, k), point(points, a), point(points, b), point(points, c), s, t)
