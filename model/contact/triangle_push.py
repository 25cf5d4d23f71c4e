"""Projection of contacts with triangles: what one contact and one particle do, from one state of all particles.

A particle sums the corrections of its contacts, as their vertex and as a corner of their triangle, in the order of the
contacts. `begin`: positions before the substep; `around`: offsets and triangles at each particle, and the triangles'
corners; `forces`: of a contact the displacement of its vertex, for a weight of 1, and its depth or, where surfaces rub,
its normal impulse.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, Open, inlined_routine, routine
from softlab.model.contact.triangle_contacts import (
    between,
    corners_of_contact,
    corners_of_surface,
    normal_of_contact,
    offset,
    point,
    slots_of,
    weights_of_contact,
)
from softlab.model.formulas.contact import (
    along,
    correction,
    dot,
    first_weight,
    inverse,
    length,
    slip,
    stiffness,
    taken,
)
from softlab.model.formulas.contact import rubbed as rubbed_by_law
from softlab.model.formulas.surface_contact import (
    BY_TRIANGLE,
    NEAREST,
    NONE,
    apart,
    checked,
    load,
    over,
    split,
    through,
)
from softlab.model.formulas.surface_contact import rub as rub_surfaces

force_of_contact = Open("force_of_contact(forces, slot) -> (x, y, z, depth or normal impulse)")
links_of = Open("links_of(links, k) -> (first, last + 1) of the entries of particle k in links.entries")
press_of_contact = Open("press_of_contact(rubbing, slot) -> normal impulse of the substep so far")
lever_of_contact = Open("lever_of_contact(rubbing, slot, n) -> (x, y, z), the lever of corner n + 2")


@inlined_routine
def difference(points, a, b):
    """Return the vector from particle a to particle b."""
    return between(point(points, a), point(points, b))


@routine
def seen_from(points, k, a, b, c):
    """Return point k and the second and third corner of a triangle, seen from its first one."""
    return difference(points, a, k), difference(points, a, b), difference(points, a, c)


@routine
def shallower(slot, k, points, begin, contacts, r, depth, around):
    """Return the depth of a contact, 0 or less where the surfaces are apart; `checked` has the rule."""
    (a, b, c), n = corners_of_contact(contacts, slot), normal_of_contact(contacts, slot)
    p, q, w = seen_from(points, k, a, b, c)
    check = checked(
        (n[0], n[1], n[2]), r, difference(begin, a, b), difference(begin, a, c), p, q, w, depth, n[3]
    )  # fmt: skip
    if check == NONE:
        return depth
    left = n[3] - apart(p, q, w)
    if check != BY_TRIANGLE:
        starts, lists, surface = around
        for corner in (a, b, c):
            for at in range(starts[corner], starts[corner + 1]):
                d, e, f = corners_of_surface(surface, lists[at])
                if k in (d, e, f):
                    continue
                p, q, w = seen_from(points, k, d, e, f)
                x, u, v = seen_from(begin, k, d, e, f)
                if through(over(x, u, v), over(p, q, w)):
                    return depth
                if check == NEAREST:
                    left = max(left, n[3] - apart(p, q, w))
    return min(depth, left)


@routine
def depth_of(slot, k, points, begin, contacts, around):
    """Return the penetration depth below the stored distance [m]; 0 or less if the contact is inactive."""
    corners, n, w = (
        corners_of_contact(contacts, slot),
        normal_of_contact(contacts, slot),
        weights_of_contact(contacts, slot),
    )
    x, y, z = offset(points, k, corners, w[0], w[1])
    depth = n[3] - dot(n[0], n[1], n[2], x, y, z)
    if depth > 0.0:
        r = offset(begin, k, corners, w[0], w[1])
        depth = shallower(slot, k, points, begin, contacts, r, depth, around)
    return depth


@inlined_routine
def slid(slot, k, points, begin, contacts):
    """Return (the vector from the triangle's point to the vertex, its change in this substep)."""
    corners, w = corners_of_contact(contacts, slot), weights_of_contact(contacts, slot)
    r, o = offset(points, k, corners, w[0], w[1]), offset(begin, k, corners, w[0], w[1])
    return r, between(o, r)


@routine
def pushed(slot, k, points, begin, contacts, masses, depth, parameters):
    """Return (displacement of the vertex by a contact, for a weight of 1; impulse over depth).

    `masses`: (inverse masses, numbers of active contacts) of particles.
    """
    (weights, loads), (a, b, c) = masses, corners_of_contact(contacts, slot)
    n, w = normal_of_contact(contacts, slot), weights_of_contact(contacts, slot)
    scale = inverse(
        stiffness(weights[k], loads[k], weights[a], loads[a], weights[b], loads[b], weights[c], loads[c], w[0], w[1])
    )
    if FEATURE.friction and not FEATURE.levers:
        _, (x, y, z) = slid(slot, k, points, begin, contacts)
        toward = dot(n[0], n[1], n[2], x, y, z)
        x, y, z = along(x, n[0], toward), along(y, n[1], toward), along(z, n[2], toward)
        part = slip(length(x, y, z), depth, parameters.static_friction, parameters.dynamic_friction)
        x, y = rubbed_by_law(depth, n[0], part, x, scale), rubbed_by_law(depth, n[1], part, y, scale)
        return (x, y, rubbed_by_law(depth, n[2], part, z, scale)), scale
    return (correction(depth, n[0], scale), correction(depth, n[1], scale), correction(depth, n[2], scale)), scale


@routine
def rubbed(slot, k, points, begin, contacts, masses_of, impulses, parameters):
    """Return (displacement of a contact's vertex by friction, for a weight of 1; levers of two corners).

    `masses_of`: (inverse masses, sums of `load`) of particles; `impulses`: (normal, friction) of the substep so far.
    """
    (weights, loads), (press, used), (a, b, c) = masses_of, impulses, corners_of_contact(contacts, slot)
    n, w = normal_of_contact(contacts, slot), weights_of_contact(contacts, slot)
    r, path = slid(slot, k, points, begin, contacts)
    first = first_weight(w[0], w[1])
    masses = (
        split(weights[k], press, loads[k]), split(weights[a], load(first, press), loads[a]),
        split(weights[b], load(w[0], press), loads[b]), split(weights[c], load(w[1], press), loads[c]),
    )  # fmt: skip
    return rub_surfaces(
        (n[0], n[1], n[2]), r, path, (press, used), (first, w[0], w[1]), masses,
        (difference(points, a, b), difference(points, a, c)), (difference(begin, a, b), difference(begin, a, c)),
        parameters.static_friction, parameters.dynamic_friction,
    )  # fmt: skip


@routine
def corner_weight(contacts, place):
    """Return the weight of the corner place % 3 of contact place // 3."""
    w, corner = weights_of_contact(contacts, place // 3), place % 3
    if corner == 0:
        return first_weight(w[0], w[1])
    return w[0] if corner == 1 else w[1]


@routine
def lever(rubbing, place):
    """Return the further displacement of a triangle's corner; `place` as in `corner_weight`."""
    slot, corner = place // 3, place % 3
    if corner == 0:
        s, t = lever_of_contact(rubbing, slot, 0), lever_of_contact(rubbing, slot, 1)
        return -(s[0] + t[0]), -(s[1] + t[1]), -(s[2] + t[2])
    return lever_of_contact(rubbing, slot, corner - 1)


@routine
def load_of(k, contact_counts, contacts, links, forces, levered):
    """Return the number of active contacts of particle k, or the sum of `load` if `levered`; as a triangle's corner it
    counts them by its weight."""
    total = 0.0
    first, last = slots_of(contact_counts, k)
    for slot in range(first, last):
        force = press_of_contact(forces, slot) if levered else force_of_contact(forces, slot)[3]
        if force > 0.0:
            total += force if levered else 1.0
    first, last = links_of(links, k)
    for entry in range(first, last):
        place = links.entries[entry]
        force = press_of_contact(forces, place // 3) if levered else force_of_contact(forces, place // 3)[3]
        if force > 0.0:
            part = corner_weight(contacts, place)
            total += load(part, force) if levered else part
    return total


@routine
def gathered(k, contact_counts, contacts, links, forces, rubbing, levered):
    """Return the displacement of particle k by all its contacts, for a weight of 1; if `levered`, by friction."""
    x, y, z = 0.0, 0.0, 0.0
    first, last = slots_of(contact_counts, k)
    for slot in range(first, last):
        force = force_of_contact(forces, slot)
        if force[3] > 0.0:
            x, y, z = x + force[0], y + force[1], z + force[2]
    first, last = links_of(links, k)
    for entry in range(first, last):
        place = links.entries[entry]
        force = force_of_contact(forces, place // 3)
        if force[3] > 0.0:
            part = corner_weight(contacts, place)
            x, y, z = taken(x, part, force[0]), taken(y, part, force[1]), taken(z, part, force[2])
            if levered:
                d = lever(rubbing, place)
                x, y, z = x - d[0], y - d[1], z - d[2]
    return x, y, z
