"""Projection of contacts of masses with triangles on CUDA: one thread per mass, which sums the corrections of its contacts in
their order, so that no sum depends on the order of threads. Atomics only count integers. What a contact and a mass do:
model/contact/triangle_push.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_find import ACCESS
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.contact.triangle_contacts import slots_of
from softlab.model.contact.triangle_push import corner_weight, depth_of, gathered, load_of, pushed, rubbed
from softlab.model.formulas.contact import scaled, shifted, taken
from softlab.model.formulas.surface_contact import load as load_by_push

QUADS = 3  # of a contact with friction of surfaces: levers of two corners, and IMPULSES
IMPULSES = 2  # friction and, last, normal impulse, of all sweeps of the substep so far


class ContactPlanes(NamedTuple):
    """Contacts as they are projected: corners, quads of normals and of weights."""

    corners: DeviceArray
    normals: DeviceArray
    weights: DeviceArray


class ContactWeights(NamedTuple):
    """The quads of weights of contacts."""

    weights: DeviceArray


class Links(NamedTuple):
    """Places (3 contact + corner) where a mass is a corner: counts[k] `entries` from starts[k] on, ascending."""

    starts: DeviceArray
    counts: DeviceArray
    entries: DeviceArray


@inlined_routine
def force_of_contact(forces, slot):
    return load_quad(forces, slot)


@inlined_routine
def press_of_contact(rubbing, slot):
    return load_quad(rubbing, QUADS * slot + IMPULSES)[3]


@inlined_routine
def lever_of_contact(rubbing, slot, n):
    s = load_quad(rubbing, QUADS * slot + n)
    return s[0], s[1], s[2]


@inlined_routine
def links_of(links, k):
    return links.starts[k], links.starts[k] + links.counts[k]


PUSH_ACCESS = ACCESS | {
    "force_of_contact": force_of_contact, "press_of_contact": press_of_contact, "lever_of_contact": lever_of_contact,
    "links_of": links_of,
}  # fmt: skip


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
        contacts = ContactWeights(weights)
        loads[k] = load_of(k, contact_counts, contacts, Links(starts, counts, links), forces, False)


@routine
def deepen(position, before, contact_counts, corners, normals, weights, starts, lists, surface, forces):
    """Write forces (quads): the depth of contacts. `starts`, `lists`, `surface`: see `make_project`."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        contacts = ContactPlanes(corners, normals, weights)
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            depth = depth_of(slot, k, position, before, contacts, (starts, lists, surface))
            store_quad(forces, slot, 0.0, 0.0, 0.0, depth)


@routine
def push(position, before, contact_counts, corners, normals, weights, mass_weights, loads, record, forces, rubbing):
    """Compute the displacement of a mass by a contact, for a weight of 1; before friction of surfaces, add its normal
    impulse to that of the substep."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size:
        contacts = ContactPlanes(corners, normals, weights)
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            depth = load_quad(forces, slot)[3]
            if depth > 0.0:
                (x, y, z), scale = pushed(slot, k, position, before, contacts, (mass_weights, loads), depth, record[0])
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
        contacts = ContactWeights(weights)
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
                part = corner_weight(contacts, links[entry])
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
        contacts = ContactPlanes(corners, normals, weights)
        first, last = slots_of(contact_counts, k)
        for slot in range(first, last):
            used = load_quad(rubbing, QUADS * slot + IMPULSES)
            press = used[3]
            if press > 0.0:
                impulses = press, (used[0], used[1], used[2])
                j, d, e = rubbed(slot, k, position, before, contacts, (mass_weights, loads), impulses, record[0])
                store_quad(rubbing, QUADS * slot, d[0], d[1], d[2], 0.0)
                store_quad(rubbing, QUADS * slot + 1, e[0], e[1], e[2], 0.0)
                store_quad(rubbing, QUADS * slot + IMPULSES, used[0] + j[0], used[1] + j[1], used[2] + j[2], press)
                store_quad(forces, slot, j[0], j[1], j[2], press)


@routine
def gather_rubbed(position, contact_counts, weights, starts, counts, links, mass_weights, loads, forces, rubbing):
    """Move the masses by the friction of their contacts."""
    k = np.int64(cuda.grid(1))
    if k < contact_counts.size and loads[k] > 0.0 and mass_weights[k] > 0.0:
        contacts = ContactWeights(weights)
        x, y, z = gathered(k, contact_counts, contacts, Links(starts, counts, links), forces, rubbing, True)
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
    kernels = (*KERNELS, *OF_FRICTION_OF_SURFACES) if levers else KERNELS
    return kernels_of(variant, math, (filled(kernel, PUSH_ACCESS) for kernel in kernels), label)
