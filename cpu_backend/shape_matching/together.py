"""Steps of bodies on CPU threads with every body shared by all threads: few or large bodies, and bodies in contact; one
team for all passes (core/progress.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.particles_bounce import make_bounce
from softlab.cpu_backend.contact.particles_find import make_find
from softlab.cpu_backend.contact.particles_project import PACES, make_clear, make_project, make_settle
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.constraints import make_colours, make_planes, make_projections
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.shape_matching.bodies_bounce import make_bodies_bounce
from softlab.cpu_backend.shape_matching.couples import make_couples
from softlab.cpu_backend.shape_matching.damping import make_damping
from softlab.cpu_backend.shape_matching.kernels import AXES, SCRATCH, make_matching
from softlab.cpu_backend.shape_matching.lattice import match_all, move_all
from softlab.cpu_backend.shape_matching.particles import make_particles
from softlab.cpu_backend.shape_matching.rebound import make_rebound
from softlab.cpu_backend.shape_matching.rigid import make_rest, make_steadying
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.particles.links import LINKS
from softlab.model.shape_matching.cluster_tables import shaping
from softlab.model.tables.cloth import COLLIDER_KINDS


def make_substep_end(compiler: Compiler, real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make end(team, member, bands, number, goes_on, before, after, b, contacts); `b`: BodyArrays.

    Each member of a team runs it after particles have moved to their goals; if it `goes_on`, it also predicts the next
    substep.
    """
    of_one, has_damping = make_particles(compiler, real, parts), "cluster_damping" in parts
    begin, rate, collide, has_bodies = of_one.begin, of_one.rate, of_one.collide, bool(parts & set(COLLIDER_KINDS))
    settle, has_predicted_velocity = make_settle(compiler, real, parts), bool(parts & PACES)
    bounce, bounces = make_bounce(real, math), "contact-restitution" in parts
    bounce_bodies, has_rigid = make_bodies_bounce(real, math), "rigid-bounce" in parts
    damping, rebounds = make_damping(compiler, real, has_damping), "rigid-rebound" in parts
    gather, slow, whole = damping.gather, damping.slow, make_rebound(compiler, real, rebounds)
    respond, go, store_impulses, keeps = whole.response, whole.go, of_one.store_impulses, "rigid-motion" in parts
    steadying = make_steadying(compiler, real, keeps)
    gather_rigid, steady = steadying.gather, steadying.steady
    rests = keeps and "sleeping" in parts
    rest, begins_last = make_rest(compiler, real, rests), rebounds or rests or has_rigid
    turning, has_couples = make_couples(compiler, real, parts), "couples" in parts
    gather_couples, turn = turning.gather, turning.turn
    rates_apart = (
        has_predicted_velocity or bounces or has_damping or keeps or has_couples
    )  # others read velocities before colliders

    @compiler.compiled
    def end(team, member, bands, number, goes_on, before, after, b, contacts):
        velocity, weights, arrays, scratch = b.velocity, b.weights, b.clusters, b.scratch
        parameters, integers = b.world.parameters, b.world.integers
        count, clusters = weights.size, arrays.centres.size // 4
        blocks = count // LANES
        travel = arrays.rigid.travel if keeps else weights
        scattered = arrays.rigid.scattered[0] if keeps else False
        if has_couples:
            coupled = arrays.couples.entries.centres.size // 4
            for band in assigned(team, member, bands):
                band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
                for c in range(coupled * band // bands, coupled * (band + 1) // bands):
                    gather_couples(c, after, count, arrays, band_scratch)
        if rates_apart:
            for band in assigned(team, member, bands):
                first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                if has_couples:
                    turn(first, last, after, travel, weights, count, arrays)
                if has_predicted_velocity:
                    settle(first, last, count, before, after, contacts.rows.record, travel)
                if bounces:
                    for axis in range(AXES):
                        for k in range(axis * count + first, axis * count + last):
                            contacts.old[k] = velocity[k]
                rate(first, last, count, before, after, velocity, weights, parameters, travel)
        if keeps:
            for band in assigned(team, member, bands):
                band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
                for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                    gather_rigid(c, after, velocity, count, arrays, band_scratch)
            if scattered:
                for band in assigned(team, member, bands):
                    first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                    steady(first, last, after, velocity, count, arrays)
        if bounces and not has_rigid:
            bounce(team, member, bands, after, velocity, weights, contacts)
        if has_damping:
            for band in assigned(team, member, bands):
                band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
                for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                    gather(c, after, velocity, count, arrays, arrays.damping.motions, band_scratch)
        for band in assigned(team, member, bands):
            first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
            if not rates_apart:
                rate(first, last, count, before, after, velocity, weights, parameters, travel)
            if has_damping:
                slow(first, last, after, velocity, count, arrays)
            if rebounds:
                store_impulses(first, last, number, before, after, velocity, weights, b.world, arrays.rebound.impulses)
            elif has_bodies:
                collide(first, last, number, before, after, velocity, weights, b.world)
            if not begins_last and goes_on:
                begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)
        if rebounds:
            for band in assigned(team, member, bands):
                band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
                for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                    respond(c, after, velocity, count, arrays, band_scratch)
            for band in assigned(team, member, bands):
                first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                if scattered:
                    go(first, last, after, velocity, count, arrays)
                if goes_on and not has_rigid and not rests:
                    begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)
        if has_rigid:
            bounce_bodies(team, member, bands, after, velocity, weights, contacts, arrays, scratch, SCRATCH * LANES)
        if rests:
            for band in assigned(team, member, bands):
                for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                    rest(c, before, after, velocity, count, arrays)
        if has_rigid or rests:
            for band in assigned(team, member, bands):
                first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                if goes_on:
                    begin(first, last, count, after, before, velocity, weights, parameters, integers, travel)

    return end


@cache
def make_bodies_together(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, even, odd, b, links, contacts, lattices); `steps`: Steps; `b`: BodyArrays.

    As loops.make_bodies_apart, over clusters, then over particles, with the velocities of a substep and the predictions
    of the next. `contacts`: ContactArrays, or empty; `lattices`: Lattices.arrays, or empty.
    """
    compiler = Compiler(cloth_variant("bodies_together", real, math, parts), math)
    keeps = "rigid-motion" in parts
    of_one, functions = make_particles(compiler, real, parts), make_matching(real, math, shaping(parts), keeps)
    begin, rate, collide, match, move = of_one.begin, of_one.rate, of_one.collide, functions.match, functions.move
    has_bodies, has_links = bool(parts & set(COLLIDER_KINDS)), "links" in parts
    project_links = make_projections(compiler, real, LINKS, make_planes(compiler))
    sweep_links = make_colours(compiler, [project_links], [LINKS.run])
    find, has_contacts = make_find(real, math), "contacts" in parts
    has_couples = "couples" in parts
    clear = make_clear(compiler)
    take_out = make_project(real, math, "contact-friction" in parts, "contact-adhesion" in parts, keeps, has_couples)
    windows, has_lattices = compiler.variant_of(real), "lattices" in parts
    match_windows, move_windows = windows(match_all), windows(move_all)
    end = make_substep_end(compiler, real, math, parts)
    at_once = not parts & {
        "contacts",
        "cluster_damping",
        "lattices",
        "rigid-motion",
    }  # particles end with the last displacement to their goals

    def advance(team, member, bands, steps, even, odd, b, links, contacts, lattices):
        velocity, weights, arrays, rotation, frames = b.velocity, b.weights, b.clusters, b.rotation, b.frames
        parameters, integers, iterations = b.world.parameters, b.world.integers, steps.iterations
        count, clusters, passes = weights.size, arrays.centres.size // 4, steps.steps * steps.substeps
        blocks = count // LANES
        travel = arrays.rigid.travel if keeps else weights
        couples = arrays.couples.sums if has_couples else weights
        for band in assigned(team, member, bands):
            first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
            begin(first, last, count, even, odd, velocity, weights, parameters, integers, travel)
        for n in range(passes):
            before, after = (odd, even) if n % 2 else (even, odd)
            number, goes_on = steps.step * steps.substeps + n, n < passes - 1
            if has_contacts:
                find(team, member, bands, after, weights, contacts.rows, contacts.search)
                if keeps:
                    for band in assigned(team, member, bands):
                        clear(band, contacts.search.lists, contacts.contacts)
            for iteration in range(iterations):
                if has_links:
                    sweep_links(team, member, bands, after, weights, before, links, iteration == 0, parameters)
                if clusters > 0:
                    for band in assigned(team, member, bands):
                        band_scratch = row_at(b.scratch, np.int64(SCRATCH * LANES * band))
                        stop = clusters * (band + 1) // bands
                        for c in range(clusters * band // bands, stop, LANES):
                            match(
                                c, min(c + LANES, stop), after, count, arrays, rotation, rotation, frames, band_scratch
                            )
                if has_lattices:
                    match_windows(
                        team, member, bands, after, count, lattices, lattices.rotation, lattices.frames, False
                    )
                if clusters > 0 or at_once:
                    for band in assigned(team, member, bands):
                        first, last = LANES * (blocks * band // bands), LANES * (blocks * (band + 1) // bands)
                        move(first, last, after, count, b.own, frames, travel)
                        if at_once and iteration == iterations - 1:
                            rate(first, last, count, before, after, velocity, weights, parameters, travel)
                            if has_bodies:
                                collide(first, last, number, before, after, velocity, weights, b.world)
                            if goes_on:
                                begin(
                                    first, last, count, after, before, velocity, weights, parameters, integers, travel
                                )
                if has_lattices:
                    move_windows(team, member, bands, after, count, lattices)
                if has_contacts:
                    take_out(team, member, bands, before, after, weights, contacts, travel, couples)
            if not at_once:
                end(team, member, bands, number, goes_on, before, after, b, contacts)

    return compiler.team(advance)
