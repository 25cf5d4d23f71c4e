"""Projection of contacts of masses with triangles, of a cloth with itself or of surfaces: each mass sums the corrections
of its contacts, as their mass and as a corner of their triangle, in the order of the contacts. Parallel, with the same
bits for any number of threads."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.self_find import V_B, V_C, V_ENFORCED, V_NX, V_NY, V_NZ, difference, seen_from
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.variant import FEATURE, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.formulas.contact import (
    along,
    correction,
    dot,
    first_weight,
    inverse,
    length,
    mixed,
    scaled,
    shifted,
    slip,
    stiffness,
    taken,
)
from softlab.model.formulas.contact import rubbed as rubbed_by_law
from softlab.model.formulas.surface_contact import BY_TRIANGLE, NEAREST, NONE, apart, checked, over, split, through
from softlab.model.formulas.surface_contact import load as load_by_push
from softlab.model.formulas.surface_contact import rub as rub_surfaces

FORCES = 4  # values of a contact in a sweep: depth, displacement of its mass (of weight 1)
F_DEPTH, F_X, F_Y, F_Z = range(FORCES)
# with friction of surfaces: extra displacements of two corners, and the impulses of all sweeps of the substep so far
F_PRESS = FORCES + 6  # along the normal
F_FRICTION = F_PRESS + 1
RUBBING = F_FRICTION + 3


@routine
def shallower(slot, k, points, begin, corners, values, r, depth, around):
    """Return the depth of a contact, 0 or less where the surfaces are apart; `checked` has the rule."""
    a, b, c = corners[slot, 0], corners[slot, 1], corners[slot, 2]
    n, enforced = (values[slot, V_NX], values[slot, V_NY], values[slot, V_NZ]), values[slot, V_ENFORCED]
    p, q, w = seen_from(points, k, a, b, c)
    check = checked(n, r, difference(begin, a, b), difference(begin, a, c), p, q, w, depth, enforced)
    if check == NONE:
        return depth
    left = enforced - apart(p, q, w)
    if check != BY_TRIANGLE:
        starts, lists, surface = around
        for corner in range(3):
            for at in range(starts[corners[slot, corner]], starts[corners[slot, corner] + 1]):
                a, b, c = surface[lists[at], 0], surface[lists[at], 1], surface[lists[at], 2]
                if k in (a, b, c):
                    continue
                p, q, w = seen_from(points, k, a, b, c)
                x, u, v = seen_from(begin, k, a, b, c)
                if through(over(x, u, v), over(p, q, w)):
                    return depth
                if check == NEAREST:
                    left = max(left, enforced - apart(p, q, w))
    return min(depth, left)


@routine
def rubbed(slot, k, points, begin, contacts, masses_of, parameters, path, forces):
    """Write the displacement of a contact's mass by friction, for a weight of 1, and the levers on its corners.

    `contacts`: (corners, values); `masses_of`: (weights, loads); `path`: of `slid`.
    """
    (corners, values), (weights, loads), (r, slid) = contacts, masses_of, path
    a, b, c = corners[slot, 0], corners[slot, 1], corners[slot, 2]
    s, t, n = values[slot, V_B], values[slot, V_C], (values[slot, V_NX], values[slot, V_NY], values[slot, V_NZ])
    first, press = first_weight(s, t), forces[slot, F_PRESS]
    masses = (
        split(weights[k], press, loads[k]), split(weights[a], load_by_push(first, press), loads[a]),
        split(weights[b], load_by_push(s, press), loads[b]), split(weights[c], load_by_push(t, press), loads[c]),
    )  # fmt: skip
    used = forces[slot, F_FRICTION], forces[slot, F_FRICTION + 1], forces[slot, F_FRICTION + 2]
    j, second, third = rub_surfaces(
        n, r, slid, (press, used), (first, s, t), masses,
        (difference(points, a, b), difference(points, a, c)), (difference(begin, a, b), difference(begin, a, c)),
        parameters.static_friction, parameters.dynamic_friction,
    )  # fmt: skip
    for axis in range(3):
        forces[slot, F_X + axis], forces[slot, F_FRICTION + axis] = j[axis], used[axis] + j[axis]
        forces[slot, FORCES + axis], forces[slot, FORCES + 3 + axis] = second[axis], third[axis]


@routine
def offset(points, k, a, b, c, s, t):
    """Return the vector from the triangle's point to the mass."""
    return (
        points[k, 0] - mixed(points[a, 0], points[b, 0], points[c, 0], s, t),
        points[k, 1] - mixed(points[a, 1], points[b, 1], points[c, 1], s, t),
        points[k, 2] - mixed(points[a, 2], points[b, 2], points[c, 2], s, t),
    )


@routine
def depth_of(slot, k, points, begin, corners, values, around):
    """Return the penetration depth below the stored distance [m]; 0 or less if the contact is inactive."""
    a, b, c = corners[slot, 0], corners[slot, 1], corners[slot, 2]
    x, y, z = offset(points, k, a, b, c, values[slot, V_B], values[slot, V_C])
    depth = values[slot, V_ENFORCED] - dot(values[slot, V_NX], values[slot, V_NY], values[slot, V_NZ], x, y, z)
    if depth > 0.0:
        r = offset(begin, k, a, b, c, values[slot, V_B], values[slot, V_C])
        depth = shallower(slot, k, points, begin, corners, values, r, depth, around)
    return depth


@routine
def slid(slot, k, points, begin, corners, values):
    """Return (the vector from the triangle's point to the mass, its change in this substep)."""
    a, b, c, s, t = corners[slot, 0], corners[slot, 1], corners[slot, 2], values[slot, V_B], values[slot, V_C]
    r, o = offset(points, k, a, b, c, s, t), offset(begin, k, a, b, c, s, t)
    return r, (r[0] - o[0], r[1] - o[1], r[2] - o[2])


@routine
def push(slot, k, points, begin, corners, values, weights, loads, parameters, forces):
    a, b, c = corners[slot, 0], corners[slot, 1], corners[slot, 2]
    s, t, depth = values[slot, V_B], values[slot, V_C], forces[slot, F_DEPTH]
    nx, ny, nz = values[slot, V_NX], values[slot, V_NY], values[slot, V_NZ]
    scale = inverse(
        stiffness(weights[k], loads[k], weights[a], loads[a], weights[b], loads[b], weights[c], loads[c], s, t)
    )
    if FEATURE.friction and not FEATURE.levers:
        _, (x, y, z) = slid(slot, k, points, begin, corners, values)
        toward = dot(nx, ny, nz, x, y, z)
        x, y, z = along(x, nx, toward), along(y, ny, toward), along(z, nz, toward)
        part = slip(length(x, y, z), depth, parameters.static_friction, parameters.dynamic_friction)
        forces[slot, F_X] = rubbed_by_law(depth, nx, part, x, scale)
        forces[slot, F_Y] = rubbed_by_law(depth, ny, part, y, scale)
        forces[slot, F_Z] = rubbed_by_law(depth, nz, part, z, scale)
    else:
        forces[slot, F_X] = correction(depth, nx, scale)
        forces[slot, F_Y] = correction(depth, ny, scale)
        forces[slot, F_Z] = correction(depth, nz, scale)
        if FEATURE.friction:  # which comes next
            forces[slot, F_PRESS] += scaled(depth, scale)


@routine
def rub(slot, k, points, begin, corners, values, weights, loads, parameters, forces):
    path = slid(slot, k, points, begin, corners, values)
    rubbed(slot, k, points, begin, (corners, values), (weights, loads), parameters, path, forces)


@routine
def link_contacts(team, member, bands, contact_counts, corners, starts, totals, links, forces):
    """List, for mass m, the places (3 contact + corner) where it is a corner: links[starts[m] : starts[m + 1]],
    ascending. Set the impulses of the substep to 0.

    Each thread has a range of masses and reads all contacts; a counting sort.
    """
    masses = contact_counts.size
    for band in assigned(team, member, bands):
        low, high = masses * band // bands, masses * (band + 1) // bands
        starts[low:high] = 0
        inside = 0
        for k in range(masses):
            first = k * MAX_CONTACTS
            for slot in range(first, first + min(contact_counts[k], MAX_CONTACTS)):
                if FEATURE.levers and low <= k < high:
                    for column in range(F_PRESS, RUBBING):
                        forces[slot, column] = 0.0
                for corner in range(3):
                    m = corners[slot, corner]
                    if low <= m < high:
                        starts[m] += 1
                        inside += 1
        totals[band] = inside
    for band in assigned(team, member, bands):
        low, high = masses * band // bands, masses * (band + 1) // bands
        end = np.int64(0)
        for before_it in range(band):
            end += totals[before_it]
        if band == bands - 1:
            starts[masses] = end + totals[band]
        for m in range(low, high):
            end += starts[m]
            starts[m] = end
        for backward in range(masses):
            k = masses - 1 - backward
            contact_count = min(contact_counts[k], MAX_CONTACTS)
            for back in range(contact_count):
                slot = k * MAX_CONTACTS + contact_count - 1 - back
                for corner in range(3):
                    m = corners[slot, corner]
                    if low <= m < high:
                        starts[m] -= 1
                        links[starts[m]] = 3 * slot + corner


@routine
def corner_weight(values, place):
    """Return the weight of the corner place % 3 of contact place // 3."""
    slot, corner = place // 3, place % 3
    if corner == 0:
        return first_weight(values[slot, V_B], values[slot, V_C])
    return values[slot, V_B + corner - 1]


@routine
def lever(forces, place, axis):
    """Return the further displacement of a triangle's corner along an axis; `place` as in `corner_weight`."""
    slot, corner = place // 3, place % 3
    if corner == 0:
        return -(forces[slot, FORCES + axis] + forces[slot, FORCES + 3 + axis])
    return forces[slot, FORCES + 3 * (corner - 1) + axis]


@routine
def gather(k, contact_counts, values, starts, links, forces, levered):
    """Return the displacement of mass k by all its contacts, for a weight of 1; by friction if `levered`."""
    x, y, z, active = 0.0, 0.0, 0.0, F_PRESS if levered else F_DEPTH
    for slot in range(k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_counts[k], MAX_CONTACTS)):
        if forces[slot, active] > 0.0:
            x, y, z = x + forces[slot, F_X], y + forces[slot, F_Y], z + forces[slot, F_Z]
    for place in range(starts[k], starts[k + 1]):
        slot = links[place] // 3
        if forces[slot, active] > 0.0:
            part = corner_weight(values, links[place])
            x = taken(x, part, forces[slot, F_X])
            y = taken(y, part, forces[slot, F_Y])
            z = taken(z, part, forces[slot, F_Z])
            if levered:
                x, y = x - lever(forces, links[place], 0), y - lever(forces, links[place], 1)
                z = z - lever(forces, links[place], 2)
    return x, y, z


@routine
def load_of(k, contact_counts, values, starts, links, forces, levered):
    """Return the number of active contacts of mass k, or the sum of `load` if `levered`; as a triangle's corner it
    counts them by its weight."""
    load, active = 0.0, F_PRESS if levered else F_DEPTH
    for slot in range(k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_counts[k], MAX_CONTACTS)):
        if forces[slot, active] > 0.0:
            load += forces[slot, active] if levered else 1.0
    for place in range(starts[k], starts[k + 1]):
        force = forces[links[place] // 3, active]
        if force > 0.0:
            part = corner_weight(values, links[place])
            load += load_by_push(part, force) if levered else part
    return load


@routine
def move(k, position, contact_counts, values, starts, links, weights, forces, points, levered):
    x, y, z = gather(k, contact_counts, values, starts, links, forces, levered)
    i, j = k // position.shape[2], k % position.shape[2]
    position[0, i, j] = shifted(points[k, 0], weights[k], x)
    position[1, i, j] = shifted(points[k, 1], weights[k], y)
    position[2, i, j] = shifted(points[k, 2], weights[k], z)
    for axis in range(3):
        points[k, axis] = position[axis, i, j]


@routine
def project_contacts(team, member, bands, sweeps, position, begin, contacts, weights, parameters, scratch):
    """Sweep over the contacts, all of a sweep from one state, and update `position` (3, rows, columns). Friction of
    surfaces has as many sweeps, after all those that push: friction follows the sum of their normal impulses.

    `contacts`: (found, corners, values, starts, links, around); `scratch`: (points, loads, forces).
    """
    (contact_counts, corners, values, starts, links, around), (points, loads, forces) = contacts, scratch
    rows, columns = position.shape[1], position.shape[2]
    masses = rows * columns
    for sweep in range(sweeps):
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                for axis in range(3):
                    points[k, axis] = position[axis, k // columns, k % columns]
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                for slot in range(k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_counts[k], MAX_CONTACTS)):
                    forces[slot, F_DEPTH] = depth_of(slot, k, points, begin, corners, values, around)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                loads[k] = load_of(k, contact_counts, values, starts, links, forces, False)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                for slot in range(k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_counts[k], MAX_CONTACTS)):
                    if forces[slot, F_DEPTH] > 0.0:
                        push(slot, k, points, begin, corners, values, weights, loads, parameters, forces)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                if loads[k] > 0.0 and weights[k] > 0.0:
                    move(k, position, contact_counts, values, starts, links, weights, forces, points, False)
                if FEATURE.levers and sweep == sweeps - 1:
                    loads[k] = load_of(k, contact_counts, values, starts, links, forces, True)
    for _ in range(sweeps if FEATURE.levers else 0):
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                for slot in range(k * MAX_CONTACTS, k * MAX_CONTACTS + min(contact_counts[k], MAX_CONTACTS)):
                    if forces[slot, F_PRESS] > 0.0:
                        rub(slot, k, points, begin, corners, values, weights, loads, parameters, forces)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                if loads[k] > 0.0 and weights[k] > 0.0:
                    move(k, position, contact_counts, values, starts, links, weights, forces, points, True)


@cache
def make_project(real: Any, math: str, friction: bool, surfaces: bool = False) -> SimpleNamespace:
    """Compile `link_contacts` and `project_contacts`; the arrays are those of cpu_backend/contact/self_contact.py.

    `surfaces`: friction exerts no moment. `around`: (offsets and triangles at each particle, the triangles' corners).
    """
    words = ("friction" if friction else "smooth") + "_surfaces" * surfaces
    compiler = Compiler(f"{np.dtype(real).name}_{math}_{words}", math)
    variant = compiler.variant_of(real, {"friction": friction, "levers": friction and surfaces})
    return SimpleNamespace(
        link_contacts=compiler.team(variant.copied(link_contacts)),
        project_contacts=compiler.team(variant.copied(project_contacts)),
    )
