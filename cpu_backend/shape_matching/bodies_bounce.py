"""Rebounds between rigid bodies on CPU threads: the impulses on their particles, scaled for each pair by the response
of both bodies (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.particles_bounce import count_contacts, push
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import gather_motion
from softlab.cpu_backend.shape_matching.motions import motion_of
from softlab.cpu_backend.shape_matching.rebound import AXES, respond_as_one
from softlab.model.base.types import Real
from softlab.model.base.variant import Open, filled, routine
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.formulas.shape_matching.rebound import joined
from softlab.model.shape_matching.motions import velocity_at

apply_scaled = Open("apply_scaled(...): `apply` in the variant of scaled impulses")


@routine
def spread(first, last, count, arrays, scales):
    """Write the scales of particles; those of clusters are the first three numbers of their motions."""
    whole = arrays.rebound
    for k in range(first, last):
        x, y, z = k, count + k, 2 * count + k
        scales[x], scales[y], scales[z] = 1.0, 0.0, 0.0
        for n in range(whole.starts[k], whole.starts[k + 1]):
            if whole.factors[n] != 0.0:
                motion = row_at(whole.motions, np.int64(MOTION) * whole.clusters[n])
                scales[x], scales[y], scales[z] = motion[0], motion[1], motion[2]


@routine
def join(first, last, position, velocity, count, arrays, impulses):
    """Add the motions of clusters to velocities, or the impulse `impulses` for a particle without a cluster."""
    whole = arrays.rebound
    for k in range(first, last):
        x, y, z = k, count + k, 2 * count + k
        a, b, c = impulses[x], impulses[y], impulses[z]
        for n in range(whole.starts[k], whole.starts[k + 1]):
            if whole.factors[n] != 0.0:
                motion = motion_of(whole.motions, whole.clusters[n])
                a, b, c = velocity_at(motion, position[x], position[y], position[z])
        a, b, c = joined(velocity[x], a), joined(velocity[y], b), joined(velocity[z], c)
        velocity[x], velocity[y], velocity[z] = a, b, c


@routine
def store_moves(band, count, arrays, impulses):
    """Write the velocity changes of a band's bouncing particles into `impulses`."""
    lists, contacts = arrays.search.lists, arrays.contacts
    for n in range(lists.begins[band], lists.begins[band] + lists.active[band]):
        i = lists.who[n]
        for axis in range(AXES):
            impulses[axis * count + i] = contacts.moves[AXES * n + axis] if contacts.counts[i] != 0.0 else 0.0


@routine
def apply(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel):
    """Compute the impulses of all contacts."""
    for band in assigned(team, member, bands):
        push(band, weights.size, position, velocity, weights, contacts, scales, travel)
        store_moves(band, weights.size, contacts, impulses)


@routine
def any_contacts(bands, scratch, pitch):
    """Return True if any band has a contact; each band stores that in the last number of its scratch."""
    touching = False
    for band in range(bands):
        touching = touching or scratch[pitch * (band + 1) - 1] != 0.0
    return touching


@routine
def gather_all(team, member, bands, position, velocity, count, arrays, scratch, pitch):
    """Compute the motions of the bodies that rebound as a whole."""
    limits = arrays.rebound.limits
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        if any_contacts(bands, scratch, pitch):
            for c in range(limits.size * band // bands, limits.size * (band + 1) // bands):
                if limits[c] != 0.0:
                    gather_motion(c, position, velocity, count, arrays, arrays.rebound.motions, band_scratch)


@routine
def bounce_all(team, member, bands, position, velocity, weights, contacts, arrays, scratch, pitch):
    """Run all phases. Without contacts they only add 0 to the velocities."""
    impulses, scales, travel = arrays.rebound.impulses, arrays.rebound.scales, arrays.rigid.travel
    count, clusters = weights.size, arrays.rebound.limits.size
    for band in assigned(team, member, bands):
        touching = count_contacts(band, count, position, velocity, contacts, travel)
        scratch[pitch * (band + 1) - 1] = 1.0 if touching else 0.0
    for band in assigned(team, member, bands):
        low, high = count * band // bands, count * (band + 1) // bands
        if any_contacts(bands, scratch, pitch):
            for axis in range(AXES):
                for k in range(axis * count + low, axis * count + high):
                    impulses[k] = 0.0
    apply(team, member, bands, position, velocity, weights, contacts, impulses, scales, travel)
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        if any_contacts(bands, scratch, pitch):
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                respond_as_one(c, position, count, arrays, band_scratch)
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
                    velocity[k] = joined(velocity[k], 0.0)


def _bounce_all(compiler: Compiler, real: Real) -> tuple[Any, Any]:
    """Return (variant, bounce_all), with the passes over contacts filled in."""
    features = {"pairs": True, "rigid_bounce": True, "scaled_impulses": False}
    scaled = compiler.variant_of(real, features | {"scaled_impulses": True})(apply)
    return compiler.variant_of(real, features), filled(bounce_all, {"apply_scaled": scaled})


@cache
def make_bodies_bounce(real: Real, math: str) -> Callable:
    """Make bounce(team, member, bands, position, velocity, weights, contacts, arrays, scratch, pitch), run by each
    member of a team (core/progress.py).

    As `make_bounce` of contact/particles_bounce.py. `contacts`: ContactArrays; `arrays`: those of clusters; `pitch`:
    numbers in a band's scratch.
    """
    variant, kernel = _bounce_all(Compiler(f"bodies_bounce_all_{np.dtype(real).name}_{math}", math), real)
    compiled: Callable = variant(kernel)
    return compiled


@cache
def make_bodies_bounce_stage(real: Real, math: str) -> Callable:
    """Compile bounce(bands, position, velocity, weights, contacts, arrays, scratch, pitch): see make_bodies_bounce."""
    compiler = Compiler(f"bodies_bounce_{np.dtype(real).name}_{math}", math)
    variant, kernel = _bounce_all(compiler, real)
    return compiler.team(variant.copied(kernel))
