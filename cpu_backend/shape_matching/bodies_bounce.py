"""Rebounds between rigid bodies on CPU threads: the impulses on their particles, scaled for each pair by the response
of both bodies (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.particles_bounce import make_passes
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import make_damping
from softlab.cpu_backend.shape_matching.motions import make_motions
from softlab.cpu_backend.shape_matching.rebound import AXES, make_response
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import rebound
from softlab.model.formulas.shape_matching.pace import MOTION


def make_transfers(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `spread` and `join`, which transfer between whole bodies and the particles `first` to before `last`."""
    formulas = compiler.formulas(rebound, real)
    joined, zero, one = formulas.joined, real(0), real(1)
    of_motions = make_motions(compiler, real)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at

    @compiler.compiled
    def spread(first, last, count, arrays, scales):
        """Write the scales of particles; those of clusters are the first three numbers of their motions."""
        whole = arrays.rebound
        for k in range(first, last):
            x, y, z = k, count + k, 2 * count + k
            scales[x], scales[y], scales[z] = one, zero, zero
            for n in range(whole.starts[k], whole.starts[k + 1]):
                if whole.factors[n] != zero:
                    motion = row_at(whole.motions, np.int64(MOTION) * whole.clusters[n])
                    scales[x], scales[y], scales[z] = motion[0], motion[1], motion[2]

    @compiler.compiled
    def join(first, last, position, velocity, count, arrays, impulses):
        """Add the motions of clusters to velocities, or the impulse `impulses` for a particle without a cluster."""
        whole = arrays.rebound
        for k in range(first, last):
            x, y, z = k, count + k, 2 * count + k
            a, b, c = impulses[x], impulses[y], impulses[z]
            for n in range(whole.starts[k], whole.starts[k + 1]):
                if whole.factors[n] != zero:
                    motion = motion_of(whole.motions, whole.clusters[n])
                    a, b, c = velocity_at(motion, position[x], position[y], position[z])
            a, b, c = joined(velocity[x], a), joined(velocity[y], b), joined(velocity[z], c)
            velocity[x], velocity[y], velocity[z] = a, b, c

    return SimpleNamespace(spread=spread, join=join)


def make_impulses(compiler: Compiler, real: Real, scaled: bool) -> Callable:
    """Make apply_all(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel).

    It writes the velocity changes of bouncing particles into `impulses` (particles_bounce.make_passes).
    """
    push, zero = make_passes(compiler, real, scaled, True).push, real(0)

    @compiler.compiled
    def store_impulses(band, count, arrays, impulses):
        lists, contacts = arrays.search.lists, arrays.contacts
        for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
            i = lists.who[n]
            for axis in range(AXES):
                impulses[axis * count + i] = contacts.moves[AXES * n + axis] if contacts.counts[i] != zero else zero

    @compiler.compiled
    def apply_all(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel):
        for band in assigned(team, member, bands):
            push(band, weights.size, position, velocity, weights, contacts, scales, travel)
            store_impulses(band, weights.size, contacts, impulses)

    return apply_all


@cache
def make_bodies_bounce(real: Real, math: str) -> Callable:
    """Make bounce(team, member, bands, position, velocity, weights, contacts, arrays, scratch, pitch), run by each
    member of a team (core/progress.py).

    As `make_bounce` of contact/particles_bounce.py. `contacts`: ContactArrays; `arrays`: those of clusters; `pitch`:
    numbers in a band's scratch.
    """
    compiler = Compiler(f"bodies_bounce_all_{np.dtype(real).name}_{math}", math)
    respond = make_response(compiler, real, True).response
    gather, count_contacts = (
        make_damping(compiler, real, True).gather,
        make_passes(compiler, real, False, True).count_contacts,
    )
    apply_all, apply_scaled = (make_impulses(compiler, real, scaled) for scaled in (False, True))
    transfers = make_transfers(compiler, real)
    spread, join = transfers.spread, transfers.join
    joined, zero, one = compiler.formulas(rebound, real).joined, real(0), real(1)

    @compiler.compiled
    def any_contacts(bands, scratch, pitch):
        """Return True if any band has a contact; each band stores that in the last number of its scratch."""
        touching = False
        for band in range(bands):
            touching = touching or scratch[pitch * (band + 1) - 1] != zero
        return touching

    @compiler.compiled
    def gather_all(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        """Compute the motions of the bodies that rebound as a whole."""
        limits = arrays.rebound.limits
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(pitch * band))
            if any_contacts(bands, scratch, pitch):
                for c in range(limits.size * band // bands, limits.size * (band + 1) // bands):
                    if limits[c] != zero:
                        gather(c, position, velocity, count, arrays, arrays.rebound.motions, band_scratch)

    @compiler.compiled
    def bounce_all(team, member, bands, position, velocity, weights, contacts, arrays, scratch, pitch):
        """Run all phases. Without contacts they only add 0 to the velocities."""
        impulses, scales, travel = arrays.rebound.impulses, arrays.rebound.scales, arrays.rigid.travel
        count, clusters = weights.size, arrays.rebound.limits.size
        for band in assigned(team, member, bands):
            touching = count_contacts(band, count, position, velocity, contacts, travel)
            scratch[pitch * (band + 1) - 1] = one if touching else zero
        for band in assigned(team, member, bands):
            low, high = count * band // bands, count * (band + 1) // bands
            if any_contacts(bands, scratch, pitch):
                for axis in range(AXES):
                    for k in range(axis * count + low, axis * count + high):
                        impulses[k] = zero
        apply_all(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel)
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(pitch * band))
            if any_contacts(bands, scratch, pitch):
                for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                    respond(c, position, count, arrays, band_scratch)
        for band in assigned(team, member, bands):
            if any_contacts(bands, scratch, pitch):
                spread(count * band // bands, count * (band + 1) // bands, count, arrays, scales)
        apply_scaled(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel)
        gather_all(team, member, bands, position, impulses, count, arrays, scratch, pitch)
        for band in assigned(team, member, bands):
            low, high = count * band // bands, count * (band + 1) // bands
            if any_contacts(bands, scratch, pitch):
                join(low, high, position, velocity, count, arrays, impulses)
            else:
                for axis in range(AXES):
                    for k in range(axis * count + low, axis * count + high):
                        velocity[k] = joined(velocity[k], zero)

    return bounce_all


@cache
def make_bodies_bounce_stage(real: Real, math: str) -> Callable:
    """Compile bounce(bands, position, velocity, weights, contacts, arrays, scratch, pitch): see make_bodies_bounce."""
    bounce_all = make_bodies_bounce(real, math)

    return Compiler(f"bodies_bounce_{np.dtype(real).name}_{math}", math).team(bounce_all)
