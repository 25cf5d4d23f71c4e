"""Steps of bodies on CPU threads with every body shared by all threads: few or large bodies, and bodies in contact; one
team for all passes (core/progress.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.particles_bounce import bounce_all
from softlab.cpu_backend.contact.particles_find import find_all
from softlab.cpu_backend.contact.particles_project import PACES, clear_some, project_all, settle_some
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.constraints import make_colours, make_projections
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.shape_matching.bodies_bounce import make_bodies_bounce
from softlab.cpu_backend.shape_matching.couples import gather_couples, turn_particles
from softlab.cpu_backend.shape_matching.damping import gather_motion, slow
from softlab.cpu_backend.shape_matching.kernels import AXES, SCRATCH, match_clusters, move_particles
from softlab.cpu_backend.shape_matching.lattice import match_all, move_all
from softlab.cpu_backend.shape_matching.particles import (
    begin,
    body_features,
    collide_particles,
    rate,
    store_impulses,
)
from softlab.cpu_backend.shape_matching.rebound import go, respond
from softlab.cpu_backend.shape_matching.rigid import gather_rigid, rest_cluster, steady_particles
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.particles.links import LINKS

bounce_bodies = Open(
    "bounce_bodies(team, member, bands, position, velocity, weights, contacts, arrays, scratch, pitch)"
)
sweep_links = Open("sweep_links(team, member, bands, after, weights, before, links, fresh, parameters)")


@routine
def end(team, member, bands, number, goes_on, before, after, b, contacts):
    """Complete a substep after particles have moved to their goals; if it `goes_on`, predict the next one. `b`: BodyArrays.

    Each member of a team runs it.
    """
    velocity, weights, arrays, scratch = b.velocity, b.weights, b.clusters, b.scratch
    parameters, integers = b.world.parameters, b.world.integers
    count, clusters = weights.size, arrays.centres.size // 4
    blocks = count // LANES
    travel = arrays.rigid.travel if FEATURE.rigid_motion else weights
    scattered = arrays.rigid.scattered[0] if FEATURE.rigid_motion else False
    if FEATURE.couples:
        coupled = arrays.couples.entries.centres.size // 4
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
            for c in range(coupled * band // bands, coupled * (band + 1) // bands):
                gather_couples(c, after, count, arrays, band_scratch)
    if FEATURE.rates_apart:
        for band in assigned(team, member, bands):
            first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
            if FEATURE.couples:
                turn_particles(first, last, after, travel, weights, count, arrays)
            if FEATURE.calmed:
                settle_some(first, last, count, before, after, contacts.rows.record, travel)
            if FEATURE.contact_restitution:
                for axis in range(AXES):
                    for k in range(axis * count + first, axis * count + last):
                        contacts.old[k] = velocity[k]
            rate(first, last, count, before, after, velocity, weights, parameters, travel)
    if FEATURE.rigid_motion:
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                gather_rigid(c, after, velocity, count, arrays, band_scratch)
        if scattered:
            for band in assigned(team, member, bands):
                first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                steady_particles(first, last, after, velocity, count, arrays)
    if FEATURE.contact_restitution and not FEATURE.rigid_bounce:
        bounce_all(team, member, bands, after, velocity, weights, contacts)
    if FEATURE.cluster_damping:
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                gather_motion(c, after, velocity, count, arrays, arrays.damping.motions, band_scratch)
    for band in assigned(team, member, bands):
        first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
        if not FEATURE.rates_apart:
            rate(first, last, count, before, after, velocity, weights, parameters, travel)
        if FEATURE.cluster_damping:
            slow(first, last, after, velocity, count, arrays)
        if FEATURE.rigid_rebound:
            store_impulses(first, last, number, before, after, velocity, weights, b.world, arrays.rebound.impulses)
        elif FEATURE.colliders:
            collide_particles(first, last, number, before, after, velocity, weights, b.world)
        if not (FEATURE.rigid_rebound or FEATURE.rests or FEATURE.rigid_bounce) and goes_on:
            begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)
    if FEATURE.rigid_rebound:
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                respond(c, after, velocity, count, arrays, band_scratch)
        for band in assigned(team, member, bands):
            first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
            if scattered:
                go(first, last, after, velocity, count, arrays)
            if goes_on and not FEATURE.rigid_bounce and not FEATURE.rests:
                begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)
    if FEATURE.rigid_bounce:
        bounce_bodies(team, member, bands, after, velocity, weights, contacts, arrays, scratch, SCRATCH * LANES)
    if FEATURE.rests:
        for band in assigned(team, member, bands):
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                rest_cluster(c, before, after, velocity, count, arrays)
    if FEATURE.rigid_bounce or FEATURE.rests:
        for band in assigned(team, member, bands):
            first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
            if goes_on:
                begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)


@routine
def advance(team, member, bands, steps, even, odd, b, links, contacts, lattices):
    """Advance all bodies by `steps.steps` steps, over clusters, then over particles."""
    velocity, weights, arrays, rotation, frames = b.velocity, b.weights, b.clusters, b.rotation, b.frames
    parameters, integers, iterations = b.world.parameters, b.world.integers, steps.iterations
    count, clusters, passes = weights.size, arrays.centres.size // 4, steps.steps * steps.substeps
    blocks = count // LANES
    travel = arrays.rigid.travel if FEATURE.rigid_motion else weights
    couples = arrays.couples.sums if FEATURE.couples else weights
    for band in assigned(team, member, bands):
        first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
        begin(first, last, count, even, odd, velocity, weights, parameters, integers, travel)
    for n in range(passes):
        before, after = (odd, even) if n % 2 else (even, odd)
        number, goes_on = steps.step * steps.substeps + n, n < passes - 1
        if FEATURE.contacts:
            find_all(team, member, bands, after, weights, contacts.rows, contacts.search)
            if FEATURE.rigid_motion:
                for band in assigned(team, member, bands):
                    clear_some(band, contacts.search.lists, contacts.contacts)
        for iteration in range(iterations):
            if FEATURE.links:
                sweep_links(team, member, bands, after, weights, before, links, iteration == 0, parameters)
            if clusters > 0:
                for band in assigned(team, member, bands):
                    band_scratch = row_at(b.scratch, np.int64(SCRATCH * LANES * band))
                    stop = clusters * (band + 1) // bands
                    for c in range(clusters * band // bands, stop, LANES):
                        high = min(c + LANES, stop)
                        match_clusters(c, high, after, count, arrays, rotation, rotation, frames, band_scratch)
            if FEATURE.lattices:
                match_all(team, member, bands, after, count, lattices, lattices.rotation, lattices.frames, False)
            if clusters > 0 or FEATURE.at_once:
                for band in assigned(team, member, bands):
                    first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                    move_particles(first, last, after, count, b.own, frames, travel)
                    if FEATURE.at_once and iteration == iterations - 1:
                        rate(first, last, count, before, after, velocity, weights, parameters, travel)
                        if FEATURE.colliders:
                            collide_particles(first, last, number, before, after, velocity, weights, b.world)
                        if goes_on:
                            begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)
            if FEATURE.lattices:
                move_all(team, member, bands, after, count, lattices)
            if FEATURE.contacts:
                project_all(team, member, bands, before, after, weights, contacts, travel, couples)
        if not FEATURE.at_once:
            end(team, member, bands, number, goes_on, before, after, b, contacts)


@cache
def make_bodies_together(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, even, odd, b, links, contacts, lattices); `steps`: Steps; `b`: BodyArrays.

    As loops.make_bodies_apart, over clusters, then over particles, with the velocities of a substep and the predictions
    of the next. `contacts`: ContactArrays, or empty; `lattices`: Lattices.arrays, or empty.
    """
    compiler = Compiler(cloth_variant("bodies_together", real, math, parts), math)
    read_before_colliders = {"contact-restitution", "cluster_damping", "rigid-motion", "couples", *PACES}
    features = body_features(parts) | {
        "rests": {"rigid-motion", "sleeping"} <= parts,
        "rates_apart": bool(parts & read_before_colliders),
        "scaled_impulses": False,
        "at_once": not parts & {"contacts", "cluster_damping", "lattices", "rigid-motion"},
    }
    project_links = make_projections(compiler, real, LINKS, True)
    kernel = with_forces(filled(advance, {
        "bounce_bodies": make_bodies_bounce(real, math), "sweep_links": make_colours(compiler, [project_links], [LINKS.run]),
    }), parts)  # fmt: skip
    return compiler.team(compiler.variant_of(real, features).copied(kernel))
