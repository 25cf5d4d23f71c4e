"""Projection of contacts of masses with triangles, of a cloth with itself or of surfaces: each mass sums the corrections
of its contacts, as their mass and as a corner of their triangle, in the order of the contacts. Parallel, with the same
bits for any number of threads. What a contact and a mass do: model/contact/triangle_push.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.cpu_backend.contact.self_find import ACCESS
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.triangle_contacts import slots_of
from softlab.model.contact.triangle_push import depth_of, gathered, load_of, pushed, rubbed
from softlab.model.formulas.contact import scaled, shifted

FORCES = 4  # values of a contact in a sweep: displacement of its mass (of weight 1), depth or normal impulse
F_X, F_Y, F_Z, F_DEPTH = range(FORCES)
# with friction of surfaces: extra displacements of two corners, and the impulses of all sweeps of the substep so far
F_PRESS = FORCES + 6  # along the normal
F_FRICTION = F_PRESS + 1
RUBBING = F_FRICTION + 3


class Links(NamedTuple):
    """Places (3 contact + corner) where a mass is a corner: `entries` from starts[k] to before starts[k + 1], ascending."""

    starts: np.ndarray
    entries: np.ndarray


@inlined_routine
def force_of_contact(forces, slot):
    return forces[slot, F_X], forces[slot, F_Y], forces[slot, F_Z], forces[slot, F_DEPTH]


@inlined_routine
def press_of_contact(forces, slot):
    return forces[slot, F_PRESS]


@inlined_routine
def lever_of_contact(forces, slot, n):
    at = FORCES + 3 * n
    return forces[slot, at], forces[slot, at + 1], forces[slot, at + 2]


@inlined_routine
def links_of(links, k):
    return links.starts[k], links.starts[k + 1]


PUSH_ACCESS = ACCESS | {
    "force_of_contact": force_of_contact, "press_of_contact": press_of_contact, "lever_of_contact": lever_of_contact,
    "links_of": links_of,
}  # fmt: skip


@routine
def push(slot, k, points, begin, contacts, masses, parameters, forces):
    depth = forces[slot, F_DEPTH]
    (x, y, z), scale = pushed(slot, k, points, begin, contacts, masses, depth, parameters)
    forces[slot, F_X], forces[slot, F_Y], forces[slot, F_Z] = x, y, z
    if FEATURE.levers:  # friction comes next
        forces[slot, F_PRESS] += scaled(depth, scale)


@routine
def rub(slot, k, points, begin, contacts, masses, parameters, forces):
    """Write the displacement of a contact's mass by friction, for a weight of 1, and the levers on its corners."""
    used = forces[slot, F_FRICTION], forces[slot, F_FRICTION + 1], forces[slot, F_FRICTION + 2]
    impulses = forces[slot, F_PRESS], used
    j, second, third = rubbed(slot, k, points, begin, contacts, masses, impulses, parameters)
    for axis in range(3):
        forces[slot, F_X + axis], forces[slot, F_FRICTION + axis] = j[axis], used[axis] + j[axis]
        forces[slot, FORCES + axis], forces[slot, FORCES + 3 + axis] = second[axis], third[axis]
    forces[slot, F_DEPTH] = forces[slot, F_PRESS]


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
def move(k, position, contact_counts, contacts, links, weights, forces, points, levered):
    x, y, z = gathered(k, contact_counts, contacts, links, forces, forces, levered)
    i, j = k // position.shape[2], k % position.shape[2]
    position[0, i, j] = shifted(points[k, 0], weights[k], x)
    position[1, i, j] = shifted(points[k, 1], weights[k], y)
    position[2, i, j] = shifted(points[k, 2], weights[k], z)
    for axis in range(3):
        points[k, axis] = position[axis, i, j]


@routine
def project_contacts(team, member, bands, sweeps, position, begin, stored, weights, parameters, scratch):
    """Sweep over the contacts, all of a sweep from one state, and update `position` (3, rows, columns). Friction of
    surfaces has as many sweeps, after all those that push: friction follows the sum of their normal impulses.

    `stored`: (contact counts, contacts, links, around); `scratch`: (points, loads, forces).
    """
    (contact_counts, contacts, links, around), (points, loads, forces) = stored, scratch
    columns, masses = position.shape[2], position.shape[1] * position.shape[2]
    for sweep in range(sweeps):
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                for axis in range(3):
                    points[k, axis] = position[axis, k // columns, k % columns]
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                first, last = slots_of(contact_counts, k)
                for slot in range(first, last):
                    forces[slot, F_DEPTH] = depth_of(slot, k, points, begin, contacts, around)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                loads[k] = load_of(k, contact_counts, contacts, links, forces, False)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                first, last = slots_of(contact_counts, k)
                for slot in range(first, last):
                    if forces[slot, F_DEPTH] > 0.0:
                        push(slot, k, points, begin, contacts, (weights, loads), parameters, forces)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                if loads[k] > 0.0 and weights[k] > 0.0:
                    move(k, position, contact_counts, contacts, links, weights, forces, points, False)
                if FEATURE.levers and sweep == sweeps - 1:
                    loads[k] = load_of(k, contact_counts, contacts, links, forces, True)
    for _ in range(sweeps if FEATURE.levers else 0):
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                first, last = slots_of(contact_counts, k)
                for slot in range(first, last):
                    if forces[slot, F_PRESS] > 0.0:
                        rub(slot, k, points, begin, contacts, (weights, loads), parameters, forces)
        for band in assigned(team, member, bands):
            for k in range(masses * band // bands, masses * (band + 1) // bands):
                if loads[k] > 0.0 and weights[k] > 0.0:
                    move(k, position, contact_counts, contacts, links, weights, forces, points, True)


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
        project_contacts=compiler.team(variant.copied(filled(project_contacts, PUSH_ACCESS))),
    )
