"""Rebounds between particles, after their velocities are known: count the pairs that must separate faster, compute all
impulses from one state, and apply them. Only particles with neighbours are processed, as in
contact/particles_project.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, real, routine
from softlab.model.contact.particle_contacts import lack_along
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_SELF_DISTANCE,
    H_INVERSE_SUBSTEP,
    H_RESTITUTION,
    MAX_NEIGHBOURS,
)
from softlab.model.formulas.particle_contact import (
    added,
    direction,
    impulse_added,
    moved,
    split,
    squared,
    touching,
)
from softlab.model.formulas.particle_contact import impulse as impulse_of
from softlab.model.formulas.shape_matching.rebound import shared as factor_of
from softlab.model.formulas.shape_matching.rebound import squared as squared_impulse
from softlab.model.formulas.shape_matching.rebound import wanted


@routine
def lack_of(i, j, pair, count, position, old, velocity, record, travel, pressed):
    """Return how much faster particles i and j must separate, and the unit normal from j to i.

    `pressed`: their contact in the substep; `travel` (shape_matching/particles.py): particles of rigid bodies have slacks.
    """
    x, y, z = position, row_at(position, np.int64(count)), row_at(position, np.int64(2 * count))
    distance = record[pair + G_DISTANCE] if pair >= 0 else record[-1 - pair + G_SELF_DISTANCE]
    dx, dy, dz = x[i] - x[j], y[i] - y[j], z[i] - z[j]
    if not touching(squared(dx, dy, dz), distance):
        return 0.0, 0.0, 0.0, 0.0
    u, v, w = old, row_at(old, np.int64(count)), row_at(old, np.int64(2 * count))
    before = u[i] - u[j], v[i] - v[j], w[i] - w[j]
    u, v, w = velocity, row_at(velocity, np.int64(count)), row_at(velocity, np.int64(2 * count))
    now = u[i] - u[j], v[i] - v[j], w[i] - w[j]
    _, nx, ny, nz = direction(dx, dy, dz, distance, i < j)
    are_rigid = False
    if FEATURE.rigid_bounce:
        are_rigid = travel[3 * count + i] > 0.0 and travel[3 * count + j] > 0.0
    return lack_along((nx, ny, nz), before, now, are_rigid, record, pressed), nx, ny, nz


@routine
def count_contacts(band, count, position, velocity, arrays, travel):
    """Store the contacts of each particle that must separate faster in `acting`, one particle after the other, and
    their numbers in `counts`. Returns True if there are any."""
    record, lists, contacts, old = arrays.rows.record, arrays.search.lists, arrays.contacts, arrays.old
    who, numbers, entries, pairs, acting = lists.who, lists.numbers, lists.entries, lists.pairs, contacts.acting
    first = lists.begins[band]
    last = first + lists.active[band]
    entry, place = np.int64(first) * MAX_NEIGHBOURS, np.int64(first) * MAX_NEIGHBOURS
    start = place
    for n in range(first, last):
        i, begin = who[n], place
        for e in range(entry, entry + numbers[n]):
            by = contacts.pressed[e] if FEATURE.rigid_bounce else 0.0
            lack, _, _, _ = lack_of(i, entries[e], pairs[e], count, position, old, velocity, record, travel, by)
            acting[place] = e
            place += 1 if lack != 0.0 else 0
        entry += numbers[n]
        contacts.counts[i] = real(place - begin)
    return place > start


@routine
def push(band, count, position, velocity, weights, arrays, scales, travel):
    """Write the velocity changes of bouncing particles into `moves`, by their place in `who`; for rigid bodies in the
    first pass also the change that their contacts alone require, into `scales`."""
    record, lists, contacts, old = arrays.rows.record, arrays.search.lists, arrays.contacts, arrays.old
    acting, counts = contacts.acting, contacts.counts
    first = lists.begins[band]
    last = first + lists.active[band]
    place = np.int64(first) * MAX_NEIGHBOURS
    for n in range(first, last):
        i = lists.who[n]
        contact_count, weight = counts[i], weights[i]
        if contact_count == 0.0:
            continue
        x, y, z, squares = 0.0, 0.0, 0.0, 0.0
        for a in range(place, place + np.int64(contact_count)):
            j, pair = lists.entries[acting[a]], lists.pairs[acting[a]]
            by = contacts.pressed[acting[a]] if FEATURE.rigid_bounce else 0.0
            lack, nx, ny, nz = lack_of(i, j, pair, count, position, old, velocity, record, travel, by)
            fraction = split(weight, contact_count, weights[j], counts[j])
            if FEATURE.scaled_impulses:
                by_i, by_j = row_at(scales, np.int64(i)), row_at(scales, np.int64(j))
                lack = lack * factor_of(
                    record[H_RESTITUTION], by_i[0], by_i[count], by_i[2 * count], by_j[0], by_j[count], by_j[2 * count]
                )
            if FEATURE.rigid_bounce:
                impulse = impulse_of(fraction, lack, max(by, 0.0), record[H_INVERSE_SUBSTEP])
                x, y = impulse_added(x, impulse, nx), impulse_added(y, impulse, ny)
                z = impulse_added(z, impulse, nz)
                squares = squared_impulse(squares, impulse)
            else:
                x, y, z = added(x, fraction, lack, nx), added(y, fraction, lack, ny), added(z, fraction, lack, nz)
        place += np.int64(contact_count)
        if FEATURE.rigid_bounce and not FEATURE.scaled_impulses:
            scales[i] = wanted(weight, contact_count, squares)
        x, y, z = moved(0.0, weight, x), moved(0.0, weight, y), moved(0.0, weight, z)
        contacts.moves[3 * n], contacts.moves[3 * n + 1], contacts.moves[3 * n + 2] = x, y, z


@routine
def put(band, count, velocity, arrays):
    """Add `moves` to velocities."""
    lists, contacts = arrays.search.lists, arrays.contacts
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        i = lists.who[n]
        if contacts.counts[i] != 0.0:
            for axis in range(3):
                velocity[axis * count + i] = velocity[axis * count + i] + contacts.moves[3 * n + axis]


@routine
def bounce_all(team, member, bands, position, velocity, weights, arrays):
    """Apply all rebounds; each member of a team runs it (core/progress.py). `arrays`: ContactArrays."""
    count = weights.size
    for band in assigned(team, member, bands):
        count_contacts(band, count, position, velocity, arrays, velocity)
    for band in assigned(team, member, bands):
        push(band, count, position, velocity, weights, arrays, velocity, velocity)
    for band in assigned(team, member, bands):
        put(band, count, velocity, arrays)


@cache
def make_bounce_stage(real: Real, math: str) -> Callable:
    """Compile bounce(bands, position, velocity, weights, arrays): see `bounce_all`."""
    compiler = Compiler(f"particles_{np.dtype(real).name}_{math}", math)
    features = {"rigid_bounce": False, "scaled_impulses": False}
    return compiler.team(compiler.variant_of(real, features)(bounce_all))
