"""Projection of particle contacts: those of a sweep are counted, projected from one state, and then applied. Only
particles with neighbours are processed; each thread handles those whose neighbours it searched."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, real, routine, row_routine
from softlab.model.contact.particle_contacts import calmed, contact_added
from softlab.model.contact.particle_parameters import (
    G_ACTIVE,
    G_DISTANCE,
    G_PULL,
    G_SELF_DISTANCE,
    MAX_NEIGHBOURS,
)
from softlab.model.formulas.particle_contact import moved, split, squared, within
from softlab.model.formulas.particle_contact import pressed as pressed_by
from softlab.model.formulas.shape_matching.couple import gathered
from softlab.model.formulas.shape_matching.rigid import carried

PACES = frozenset({"speed-limit", "sleeping"})


@routine
def count_contacts(band, count, position, record, lists, contacts):
    """Store the neighbours that are contacts at the current positions in `acting`, one particle after the other,
    and their numbers in `counts`."""
    who, numbers, entries, pairs, acting = lists.who, lists.numbers, lists.entries, lists.pairs, contacts.acting
    first = lists.begins[band]
    last = first + lists.active[band]
    entry, place = np.int64(first) * MAX_NEIGHBOURS, np.int64(first) * MAX_NEIGHBOURS
    xs, ys, zs = position, row_at(position, np.int64(count)), row_at(position, np.int64(2 * count))
    for n in range(first, last):
        i, begin = who[n], place
        x, y, z = xs[i], ys[i], zs[i]
        for e in range(entry, entry + numbers[n]):
            j, pair = entries[e], pairs[e]
            nearer = record[pair + G_ACTIVE] if pair >= 0 else record[-1 - pair + G_SELF_DISTANCE]
            square = squared(x - xs[j], y - ys[j], z - zs[j])
            acting[place] = e
            place += 1 if within(square, nearer) else 0
        entry += numbers[n]
        contacts.counts[i] = real(place - begin)


@routine
def push(band, count, before, position, weights, record, lists, contacts, couples):
    """Write new positions of particles with contacts into `moves`, by their place in `who`; add to `couples`."""
    entries, pairs, acting = lists.entries, lists.pairs, contacts.acting
    counts, pressed = contacts.counts, contacts.pressed
    first = lists.begins[band]
    last = first + lists.active[band]
    place = np.int64(first) * MAX_NEIGHBOURS
    xs, ys, zs = position, row_at(position, np.int64(count)), row_at(position, np.int64(2 * count))
    old_x, old_y, old_z = before, row_at(before, np.int64(count)), row_at(before, np.int64(2 * count))
    for n in range(first, last):
        i = lists.who[n]
        contact_count = counts[i]
        if contact_count == 0.0:
            continue
        px, py, pz, weight = xs[i], ys[i], zs[i], weights[i]
        ox, oy, oz = old_x[i], old_y[i], old_z[i]
        sums, couple = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for a in range(place, place + np.int64(contact_count)):
            j, pair = entries[acting[a]], pairs[acting[a]]
            distance = record[pair + G_DISTANCE] if pair >= 0 else record[-1 - pair + G_SELF_DISTANCE]
            pull = 0.0
            if FEATURE.contact_adhesion:
                pull = record[pair + G_PULL] if pair >= 0 else 0.0
            d = px - xs[j], py - ys[j], pz - zs[j]
            b = ox - old_x[j], oy - old_y[j], oz - old_z[j]
            fraction = split(weight, contact_count, weights[j], counts[j])
            sums, couple, depth = contact_added((sums, couple), d, b, i < j, distance, pull, fraction, record)
            if FEATURE.rigid_motion:
                pressed[acting[a]] = pressed_by(pressed[acting[a]], fraction, depth)
        place += np.int64(contact_count)
        x, y, z = moved(px, weight, sums[0]), moved(py, weight, sums[1]), moved(pz, weight, sums[2])
        contacts.moves[3 * n], contacts.moves[3 * n + 1], contacts.moves[3 * n + 2] = x, y, z
        if FEATURE.couples:
            couples[i] = gathered(couples[i], weight, couple[0])
            couples[count + i] = gathered(couples[count + i], weight, couple[1])
            couples[2 * count + i] = gathered(couples[2 * count + i], weight, couple[2])


@routine
def put(band, count, position, travel, lists, contacts):
    """Apply `moves`."""
    moves = contacts.moves
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        i = lists.who[n]
        if contacts.counts[i] != 0.0:
            for axis in range(3):
                k = axis * count + i
                if FEATURE.rigid_motion:
                    travel[k] = carried(travel[k], moves[3 * n + axis], position[k])
                position[k] = moves[3 * n + axis]


@routine
def project_all(team, member, bands, before, position, weights, arrays, travel, couples):
    """Sweep over the contacts; each member of a team runs it (core/progress.py). `arrays`: ContactArrays.

    `travel` is that of shape_matching/particles.py, for rigid bodies; `couples` that of shape_matching/couples.py, for
    friction that turns clusters.
    """
    count, record, lists, contacts = weights.size, arrays.rows.record, arrays.search.lists, arrays.contacts
    for _ in range(arrays.sweeps):
        for band in assigned(team, member, bands):
            count_contacts(band, count, position, record, lists, contacts)
        for band in assigned(team, member, bands):
            push(band, count, before, position, weights, record, lists, contacts, couples)
        for band in assigned(team, member, bands):
            put(band, count, position, travel, lists, contacts)


@routine
def clear_some(band, lists, contacts):
    """Zero `pressed` of all contacts at the start of a substep."""
    entry = np.int64(lists.begins[band]) * MAX_NEIGHBOURS
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        for e in range(entry, entry + lists.numbers[n]):
            contacts.pressed[e] = 0
        entry += lists.numbers[n]


@routine
def clear(band, bands, lists, contacts):
    clear_some(band, lists, contacts)


@row_routine
def settle_rows(n, record, x, y, z, to_x, to_y, to_z, over_x, over_y, over_z):
    for k in range(n):
        u, v, w = calmed((x[k], y[k], z[k]), (to_x[k], to_y[k], to_z[k]), record)
        if FEATURE.rigid_motion:
            over_x[k] = carried(over_x[k], u, to_x[k])
            over_y[k] = carried(over_y[k], v, to_y[k])
            over_z[k] = carried(over_z[k], w, to_z[k])
        to_x[k], to_y[k], to_z[k] = u, v, w


@routine
def settle_some(first, last, count, before, position, record, travel):
    """Apply the speed limit and sleeping at the end of a substep."""
    u, v, w = (first, count + first, 2 * count + first) if FEATURE.rigid_motion else (0, 0, 0)
    settle_rows(
        last - first, record, row_at(before, first), row_at(before, count + first), row_at(before, 2 * count + first),
        row_at(position, first), row_at(position, count + first), row_at(position, 2 * count + first),
        row_at(travel, u), row_at(travel, v), row_at(travel, w),
    )  # fmt: skip


@routine
def settle(band, bands, count, before, position, record, travel):
    settle_some(count * band // bands, count * (band + 1) // bands, count, before, position, record, travel)


@cache
def make_project_stage(
    real: Real, math: str, has_friction: bool, has_adhesion: bool, has_rigid: bool, has_couples: bool = False
) -> Callable:
    """Compile project(bands, before, position, weights, arrays, travel, couples): see `project_all`."""
    name = f"particles_{np.dtype(real).name}_{math}{'_friction' * has_friction}{'_adhesion' * has_adhesion}"
    features = {
        "contact_friction": has_friction, "contact_adhesion": has_adhesion, "rigid_motion": has_rigid,
        "couples": has_couples,
    }  # fmt: skip
    compiler = Compiler(name, math)
    return compiler.team(compiler.variant_of(real, features)(project_all))


@cache
def make_clear_stage(real: Real, math: str) -> Callable:
    """Compile clear(bands, lists, contacts): all particles, in parallel."""
    compiler = Compiler(f"particles_clear_{np.dtype(real).name}_{math}", math)
    return compiler.banded(compiler.variant_of(real).copied(clear))


@cache
def make_settle_stage(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile settle(bands, count, before, position, record, travel): all particles, in parallel."""
    words = sorted(parts & (PACES | {"rigid-motion"}))
    compiler = Compiler(f"particles_{np.dtype(real).name}_{math}_{'_'.join(words)}", math)
    return compiler.banded(compiler.variant_of(real, features_of(parts)).copied(settle))
