"""Rebounds between particles, after their velocities are known: count the pairs that must separate faster, compute all
impulses from one state, and apply them. Only particles with neighbours are processed, as in
contact/particles_project.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_SELF_DISTANCE,
    H_INVERSE_SUBSTEP,
    H_RESTITUTION,
    H_SETTLING,
    MAX_NEIGHBOURS,
)
from softlab.model.formulas import particle_contact
from softlab.model.formulas.shape_matching import rebound


def make_passes(compiler: Compiler, real: Real, scaled: bool, has_rigid: bool = False) -> SimpleNamespace:
    """Make `count_contacts`, `push`, `put` (see the inner functions), for a `band` of the particles that have neighbours.

    `scaled`: impulses of a pair are multiplied by the smaller one of both particles' `scales`. `has_rigid`: `travel` is
    read, as in shape_matching/particles.py. Two particles of rigid bodies, which have slacks, then separate as those do
    (model/formulas/particle_contact.py, `parting`), even without restitution.
    """
    formulas = compiler.formulas(particle_contact, real)
    squared, touching, direction = formulas.squared, formulas.touching, formulas.direction
    lacking, split, added, moved = formulas.lacking, formulas.split, formulas.added, formulas.moved
    parting, impulse_of, impulse_added = formulas.parting, formulas.impulse, formulas.impulse_added
    whole = compiler.formulas(rebound, real)
    factor_of, squared_impulse, wanted, zero = whole.shared, whole.squared, whole.wanted, real(0)

    @compiler.compiled
    def lack_of(i, j, pair, count, position, old, velocity, record, travel, pressed):
        """Return how much faster particles i and j must separate, and the unit normal from j to i. `pressed`: their
        contact in the substep."""
        x, y, z = position, row_at(position, np.int64(count)), row_at(position, np.int64(2 * count))
        distance = record[pair + G_DISTANCE] if pair >= 0 else record[-1 - pair + G_SELF_DISTANCE]
        dx, dy, dz = x[i] - x[j], y[i] - y[j], z[i] - z[j]
        if not touching(squared(dx, dy, dz), distance):
            return zero, zero, zero, zero
        u, v, w = old, row_at(old, np.int64(count)), row_at(old, np.int64(2 * count))
        before = u[i] - u[j], v[i] - v[j], w[i] - w[j]
        u, v, w = velocity, row_at(velocity, np.int64(count)), row_at(velocity, np.int64(2 * count))
        now = u[i] - u[j], v[i] - v[j], w[i] - w[j]
        _, nx, ny, nz = direction(dx, dy, dz, distance, i < j)
        e, settling = record[H_RESTITUTION], record[H_SETTLING]
        if has_rigid:
            if travel[3 * count + i] > zero and travel[3 * count + j] > zero:
                return parting(before, now, (nx, ny, nz), e, settling, pressed), nx, ny, nz
            if e == zero:
                return zero, nx, ny, nz
        return lacking(before, now, (nx, ny, nz), e, settling), nx, ny, nz

    @compiler.compiled
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
                by = contacts.pressed[e] if has_rigid else zero
                lack, _, _, _ = lack_of(i, entries[e], pairs[e], count, position, old, velocity, record, travel, by)
                acting[place] = e
                place += 1 if lack != zero else 0
            entry += numbers[n]
            contacts.counts[i] = real(place - begin)
        return place > start

    @compiler.compiled
    def push(band, count, position, velocity, weights, arrays, scales, travel):
        """Write the velocity changes of bouncing particles into `moves`, by their place in `who`; for rigid bodies in
        the first pass also the change that their contacts ask for alone, into `scales`."""
        record, lists, contacts, old = arrays.rows.record, arrays.search.lists, arrays.contacts, arrays.old
        acting, counts = contacts.acting, contacts.counts
        first = lists.begins[band]
        last = first + lists.active[band]
        place = np.int64(first) * MAX_NEIGHBOURS
        for n in range(first, last):
            i = lists.who[n]
            contact_count, weight = counts[i], weights[i]
            if contact_count == zero:
                continue
            x, y, z, squares = zero, zero, zero, zero
            for a in range(place, place + np.int64(contact_count)):
                j, pair = lists.entries[acting[a]], lists.pairs[acting[a]]
                by = contacts.pressed[acting[a]] if has_rigid else zero
                lack, nx, ny, nz = lack_of(i, j, pair, count, position, old, velocity, record, travel, by)
                fraction = split(weight, contact_count, weights[j], counts[j])
                if scaled:
                    by_i, by_j = row_at(scales, np.int64(i)), row_at(scales, np.int64(j))
                    lack = lack * factor_of(
                        record[H_RESTITUTION],
                        by_i[0],
                        by_i[count],
                        by_i[2 * count],
                        by_j[0],
                        by_j[count],
                        by_j[2 * count],
                    )
                if has_rigid:
                    impulse = impulse_of(fraction, lack, max(by, zero), record[H_INVERSE_SUBSTEP])
                    x, y, z = (
                        impulse_added(x, impulse, nx),
                        impulse_added(y, impulse, ny),
                        impulse_added(z, impulse, nz),
                    )
                    squares = squared_impulse(squares, impulse)
                else:
                    x, y, z = added(x, fraction, lack, nx), added(y, fraction, lack, ny), added(z, fraction, lack, nz)
            place += np.int64(contact_count)
            if has_rigid and not scaled:
                scales[i] = wanted(weight, contact_count, squares)
            x, y, z = moved(zero, weight, x), moved(zero, weight, y), moved(zero, weight, z)
            contacts.moves[3 * n], contacts.moves[3 * n + 1], contacts.moves[3 * n + 2] = x, y, z

    @compiler.compiled
    def put(band, count, velocity, arrays):
        lists, contacts = arrays.search.lists, arrays.contacts
        for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
            i = lists.who[n]
            if contacts.counts[i] != zero:
                for axis in range(3):
                    velocity[axis * count + i] = velocity[axis * count + i] + contacts.moves[3 * n + axis]

    return SimpleNamespace(count_contacts=count_contacts, push=push, put=put)


@cache
def make_bounce(real: Real, math: str) -> Callable:
    """Make bounce(team, member, bands, position, velocity, weights, arrays), which each member of a team runs
    (core/progress.py). `arrays`: ContactArrays."""
    compiler = Compiler(f"particles_bounce_{np.dtype(real).name}_{math}", math)
    passes = make_passes(compiler, real, False)
    count_contacts, push, put = passes.count_contacts, passes.push, passes.put

    @compiler.compiled
    def bounce_all(team, member, bands, position, velocity, weights, arrays):
        count = weights.size
        for band in assigned(team, member, bands):
            count_contacts(band, count, position, velocity, arrays, velocity)
        for band in assigned(team, member, bands):
            push(band, count, position, velocity, weights, arrays, velocity, velocity)
        for band in assigned(team, member, bands):
            put(band, count, velocity, arrays)

    return bounce_all


@cache
def make_bounce_stage(real: Real, math: str) -> Callable:
    """Compile bounce(bands, position, velocity, weights, arrays): see make_bounce."""
    bounce_all = make_bounce(real, math)

    return Compiler(f"particles_{np.dtype(real).name}_{math}", math).team(bounce_all)
