"""Projection of contacts of masses with triangles on CUDA: one thread per mass, which sums the corrections of its contacts in
their order, so that no sum depends on the order of threads. Atomics only count integers."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
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

QUADS = 3  # of a contact with friction of surfaces: levers of two corners, and IMPULSES
IMPULSES = 2  # friction and, last, normal impulse, of all sweeps of the substep so far


@routine
def slots_of(contact_counts, k):
    first = k * MAX_CONTACTS
    return first, first + min(np.int64(contact_counts[k]), np.int64(MAX_CONTACTS))


@routine
def offset(points, k, a, b, c, s, t):
    p, qa, qb, qc = load_quad(points, k), load_quad(points, a), load_quad(points, b), load_quad(points, c)
    return (
        p[0] - mixed(qa[0], qb[0], qc[0], s, t),
        p[1] - mixed(qa[1], qb[1], qc[1], s, t),
        p[2] - mixed(qa[2], qb[2], qc[2], s, t),
    )


@routine
def corner_weight(weights, place):
    w, corner = load_quad(weights, place // 3), place % 3
    if corner == 0:
        return first_weight(w[0], w[1])
    return w[0] if corner == 1 else w[1]


@routine
def fill_links(contact_counts, corners, cursors, links, rubbing):
    """List the contacts at each mass, in any order, and set the impulses of the substep to 0."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        first, last = slots_of(contact_counts, k)
        for place in range(3 * first, 3 * last):
            links[cuda.atomic.add(cursors, corners[place], 1)] = place
        if FEATURE.levers:
            for slot in range(first, last):
                store_quad(rubbing, QUADS * slot + IMPULSES, 0.0, 0.0, 0.0, 0.0)


@routine
def sort_links(starts, counts, links):
    """Sort by insertion: a mass is a corner of a few contacts, which are almost in order."""
    k = np.int64(cuda.grid(1))
    if k < counts.size:
        for at in range(starts[k] + 1, starts[k] + counts[k]):
            link, place = links[at], at
            while place > starts[k] and links[place - 1] > link:
                links[place] = links[place - 1]
                place -= 1
            links[place] = link


@routine
def load_up(contact_counts, weights, starts, counts, links, forces, loads):
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        load = 0.0
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            if load_quad(forces, slot)[3] > 0.0:
                load += 1.0
        for entry in range(starts[k], starts[k] + counts[k]):
            if load_quad(forces, links[entry] // 3)[3] > 0.0:
                load += corner_weight(weights, links[entry])
        loads[k] = load


@routine
def difference(points, a, b):
    p, q = load_quad(points, a), load_quad(points, b)
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@routine
def seen_from(points, k, a, b, c):
    return difference(points, a, k), difference(points, a, b), difference(points, a, c)


@routine
def shallower(slot, k, position, before, corners, n, r, depth, around):
    a, b, c = corners[3 * slot], corners[3 * slot + 1], corners[3 * slot + 2]
    p, q, w = seen_from(position, k, a, b, c)
    check = checked(
        (n[0], n[1], n[2]), r, difference(before, a, b), difference(before, a, c), p, q, w, depth, n[3]
    )  # fmt: skip
    if check == NONE:
        return depth
    left = n[3] - apart(p, q, w)
    if check != BY_TRIANGLE:
        starts, lists, surface = around
        for place in range(3 * slot, 3 * slot + 3):
            for at in range(starts[corners[place]], starts[corners[place] + 1]):
                t = 3 * lists[at]
                a, b, c = surface[t], surface[t + 1], surface[t + 2]
                if k in (a, b, c):
                    continue
                p, q, w = seen_from(position, k, a, b, c)
                x, u, v = seen_from(before, k, a, b, c)
                if through(over(x, u, v), over(p, q, w)):
                    return depth
                if check == NEAREST:
                    left = max(left, n[3] - apart(p, q, w))
    return min(depth, left)


@routine
def rubbed(k, corners, position, before, n, w, masses_of, parameters, path, impulses):
    (a, b, c), (mass_weights, loads), (r, slid), (press, _) = corners, masses_of, path, impulses
    first = first_weight(w[0], w[1])
    masses = (
        split(mass_weights[k], press, loads[k]), split(mass_weights[a], load_by_push(first, press), loads[a]),
        split(mass_weights[b], load_by_push(w[0], press), loads[b]),
        split(mass_weights[c], load_by_push(w[1], press), loads[c]),
    )  # fmt: skip
    return rub_surfaces(
        (n[0], n[1], n[2]), r, slid, impulses, (first, w[0], w[1]), masses,
        (difference(position, a, b), difference(position, a, c)), (difference(before, a, b), difference(before, a, c)),
        parameters.static_friction, parameters.dynamic_friction,
    )  # fmt: skip


@routine
def lever(rubbing, place):
    """Return the displacement by friction of the corner place % 3 of contact place // 3."""
    slot, corner = place // 3, place % 3
    if corner == 0:
        s, t = load_quad(rubbing, QUADS * slot), load_quad(rubbing, QUADS * slot + 1)
        return -(s[0] + t[0]), -(s[1] + t[1]), -(s[2] + t[2])
    s = load_quad(rubbing, QUADS * slot + corner - 1)
    return s[0], s[1], s[2]


@routine
def deepen(position, before, contact_counts, corners, normals, weights, starts, lists, surface, forces):
    """Write forces (quads): the depth of contacts. `starts`, `lists`, `surface`: see `make_project`."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            n, w = load_quad(normals, slot), load_quad(weights, slot)
            a, b, c = corners[3 * slot], corners[3 * slot + 1], corners[3 * slot + 2]
            x, y, z = offset(position, k, a, b, c, w[0], w[1])
            depth = n[3] - dot(n[0], n[1], n[2], x, y, z)
            if depth > 0.0:
                r = offset(before, k, a, b, c, w[0], w[1])
                depth = shallower(slot, k, position, before, corners, n, r, depth, (starts, lists, surface))
            store_quad(forces, slot, 0.0, 0.0, 0.0, depth)


@routine
def push(position, before, contact_counts, corners, normals, weights, mass_weights, loads, record, forces, rubbing):
    """Compute the displacement of a mass by a contact, for a weight of 1; before friction of surfaces, add its normal
    impulse to that of the substep."""
    parameters = record[0]
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            depth = load_quad(forces, slot)[3]
            if depth > 0.0:
                n, w = load_quad(normals, slot), load_quad(weights, slot)
                a, b, c = corners[3 * slot], corners[3 * slot + 1], corners[3 * slot + 2]
                scale = inverse(stiffness(
                    mass_weights[k], loads[k], mass_weights[a], loads[a], mass_weights[b], loads[b],
                    mass_weights[c], loads[c], w[0], w[1],
                ))  # fmt: skip
                if FEATURE.friction and not FEATURE.levers:
                    rx, ry, rz = offset(position, k, a, b, c, w[0], w[1])
                    ox, oy, oz = offset(before, k, a, b, c, w[0], w[1])
                    x, y, z = rx - ox, ry - oy, rz - oz
                    toward = dot(n[0], n[1], n[2], x, y, z)
                    x, y, z = along(x, n[0], toward), along(y, n[1], toward), along(z, n[2], toward)
                    part = slip(length(x, y, z), depth, parameters.static_friction, parameters.dynamic_friction)
                    x = rubbed_by_law(depth, n[0], part, x, scale)
                    y = rubbed_by_law(depth, n[1], part, y, scale)
                    z = rubbed_by_law(depth, n[2], part, z, scale)
                else:
                    x, y, z = (
                        correction(depth, n[0], scale), correction(depth, n[1], scale), correction(depth, n[2], scale)
                    )  # fmt: skip
                store_quad(forces, slot, x, y, z, depth)
                if FEATURE.levers:
                    s = load_quad(rubbing, QUADS * slot + IMPULSES)
                    store_quad(rubbing, QUADS * slot + IMPULSES, s[0], s[1], s[2], s[3] + scaled(depth, scale))


@routine
def gather(position, contact_counts, weights, starts, counts, links, mass_weights, loads, forces, rubbing):
    """Move the masses by their contacts. With friction of surfaces, write the loads for it, too."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        x, y, z, load = 0.0, 0.0, 0.0, 0.0
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            force = load_quad(forces, slot)
            if force[3] > 0.0:
                x, y, z = x + force[0], y + force[1], z + force[2]
            if FEATURE.levers:
                load += load_quad(rubbing, QUADS * slot + IMPULSES)[3]
        for entry in range(starts[k], starts[k] + counts[k]):
            slot = links[entry] // 3
            force = load_quad(forces, slot)
            press = load_quad(rubbing, QUADS * slot + IMPULSES)[3] if FEATURE.levers else force[3]
            if press > 0.0:
                part = corner_weight(weights, links[entry])
                if force[3] > 0.0:
                    x, y, z = taken(x, part, force[0]), taken(y, part, force[1]), taken(z, part, force[2])
                load += load_by_push(part, press)
        if loads[k] > 0.0 and mass_weights[k] > 0.0:
            p, w = load_quad(position, k), mass_weights[k]
            store_quad(position, k, shifted(p[0], w, x), shifted(p[1], w, y), shifted(p[2], w, z), p[3])
        if FEATURE.levers:
            loads[k] = load


@routine
def rub(position, before, contact_counts, corners, normals, weights, mass_weights, loads, record, forces, rubbing):
    """Compute the displacement of a mass by a contact's friction, for a weight of 1, and the levers on corners."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            used = load_quad(rubbing, QUADS * slot + IMPULSES)
            press = used[3]
            if press > 0.0:
                n, w = load_quad(normals, slot), load_quad(weights, slot)
                a, b, c = corners[3 * slot], corners[3 * slot + 1], corners[3 * slot + 2]
                r = offset(position, k, a, b, c, w[0], w[1])
                ox, oy, oz = offset(before, k, a, b, c, w[0], w[1])
                path = r, (r[0] - ox, r[1] - oy, r[2] - oz)
                impulses = press, (used[0], used[1], used[2])
                j, d, e = rubbed(k, (a, b, c), position, before, n, w, (mass_weights, loads), record[0], path, impulses)
                store_quad(rubbing, QUADS * slot, d[0], d[1], d[2], 0.0)
                store_quad(rubbing, QUADS * slot + 1, e[0], e[1], e[2], 0.0)
                store_quad(rubbing, QUADS * slot + IMPULSES, used[0] + j[0], used[1] + j[1], used[2] + j[2], press)
                store_quad(forces, slot, j[0], j[1], j[2], press)


@routine
def gather_rubbed(position, contact_counts, weights, starts, counts, links, mass_weights, loads, forces, rubbing):
    """Move the masses by the friction of their contacts."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size and loads[k] > 0.0 and mass_weights[k] > 0.0:
        x, y, z = 0.0, 0.0, 0.0
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            force = load_quad(forces, slot)
            if force[3] > 0.0:
                x, y, z = x + force[0], y + force[1], z + force[2]
        for entry in range(starts[k], starts[k] + counts[k]):
            force = load_quad(forces, links[entry] // 3)
            if force[3] > 0.0:
                part, d = corner_weight(weights, links[entry]), lever(rubbing, links[entry])
                x, y, z = taken(x, part, force[0]), taken(y, part, force[1]), taken(z, part, force[2])
                x, y, z = x - d[0], y - d[1], z - d[2]
        p, w = load_quad(position, k), mass_weights[k]
        store_quad(position, k, shifted(p[0], w, x), shifted(p[1], w, y), shifted(p[2], w, z), p[3])


KERNELS = fill_links, sort_links, load_up, deepen, push, gather
OF_FRICTION_OF_SURFACES = rub, gather_rubbed  # after `gather`


@cache
def make_project(real: Any, math: str, friction: bool, surfaces: bool = False) -> SimpleNamespace:
    """Compile `fill_links` and `sort_links` (once per substep), `deepen`, `load_up`, `push` and `gather` (each sweep), and
    for friction of surfaces `rub` and `gather_rubbed`.

    `surfaces`: as on the CPU; `starts`, `lists`, `surface`: offsets and triangles at each particle, and the triangles'
    corners; `rubbing`: QUADS per contact, levers of two corners, and the friction and normal impulse of the substep.
    """
    levers = friction and surfaces
    variant = device_variant(real, math, {"friction": friction, "levers": levers})
    label = f"contacts_{variant_name(real, math, f'friction_{int(friction)}')}{'_surfaces' * surfaces}"
    return kernels_of(variant, math, (*KERNELS, *OF_FRICTION_OF_SURFACES) if levers else KERNELS, label)
