"""Operations on one vertex of a mesh, and loops over vertices and constraints (core/constraints.py), for CPU threads.

A mass is a row of four numbers: x, y, z and, in the positions, its weight. No two constraints of a colour share a mass,
so threads may process any part of it: the state's bits depend neither on their number nor on their order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_mass
from softlab.cpu_backend.contact.pins import make_drive
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.constraints import make_colours, make_projections, make_rows
from softlab.cpu_backend.core.own_forces import make_particle_force
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.core.wind import make_air, make_triangle
from softlab.model.base.types import Real
from softlab.model.formulas import distance
from softlab.model.particles.constraints import Projection
from softlab.model.position_based.mesh_plan import BODY_DAMPING, TOUCHING
from softlab.model.tables.cloth import COLLIDER_KINDS

AXES = 3  # a velocity's fourth number is its particle's own damping rate, 1/s


ALWAYS = {"gauss-seidel", "load", "pins"}  # parts that change no code: every mass has its weight, 0 if pinned


class World(NamedTuple):
    """Constants, integers of random forces, the triangles for wind, colliders and their kinds, particles that follow a
    motion."""

    parameters: np.record
    integers: np.ndarray
    wind_lists: tuple[np.ndarray, np.ndarray, np.ndarray]
    bodies: np.ndarray
    kinds: np.ndarray
    driven: np.ndarray


def make_begin(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make begin(first, last, step, substep, before, velocity, position, parameters, integers, wind_lists).

    It predicts the positions of the masses `first` to before `last`; `wind_lists`: (offsets, triangles at each vertex,
    corners of triangles).
    """
    compiled = compiler.compiled
    formulas = compiler.formulas(distance, real)
    kicked, damping_factor, predicted, added = (
        formulas.kicked,
        formulas.damping_factor,
        formulas.predicted,
        formulas.added,
    )
    particle_force = make_particle_force(compiler, real, AXES, parts | {"load"})  # every mass has its weight
    triangle, air_now = make_triangle(compiler, real), make_air(compiler, real, parts)
    has_gravity, has_wind, has_damping = "gravity" in parts, "wind" in parts, "damping" in parts
    slowed, is_slowed = formulas.slowed, BODY_DAMPING in parts
    zero, one = real(0), real(1)

    @compiled
    def row(array, k):
        return array[k, 0], array[k, 1], array[k, 2]

    @compiled
    def wind_of(k, air, before, velocity, parameters, wind_lists):
        """Return the wind force over the sheet's mass, summed over the triangles at the vertex in their order."""
        offsets, at_vertex, corners = wind_lists
        x, y, z = zero, zero, zero
        for n in range(offsets[k], offsets[k + 1]):
            a, b, c = corners[at_vertex[n], 0], corners[at_vertex[n], 1], corners[at_vertex[n], 2]
            fx, fy, fz = triangle(
                row(before, a), row(before, b), row(before, c), row(velocity, a), row(velocity, b), row(velocity, c), air,
                parameters.drag, parameters.lift,
            )  # fmt: skip
            x, y, z = x + fx, y + fy, z + fz
        return x, y, z

    @compiled
    def begin(first, last, step, substep, before, velocity, position, parameters, integers, wind_lists):
        h = parameters.dt
        air = air_now(parameters, integers, substep, zero) if has_wind else (zero, zero, zero)
        for k in range(first, last):
            w = before[k, 3]
            if w == zero:
                continue
            ax, ay, az = zero, zero, zero
            if has_gravity:
                ay = ay + parameters.gravity
            if has_wind:
                fx, fy, fz = wind_of(k, air, before, velocity, parameters, wind_lists)
                ax, ay, az = added(ax, w, fx), added(ay, w, fy), added(az, w, fz)
            ax, ay, az = particle_force((ax, ay, az), k, w, parameters, integers, step)
            factor = damping_factor(parameters.braking, w) if has_damping else one
            if is_slowed:
                for axis in range(AXES):
                    velocity[k, axis] = slowed(velocity[k, axis], velocity[k, 3], h)
            position[k, 0] = predicted(before[k, 0], h, kicked(velocity[k, 0], factor, h, ax))
            position[k, 1] = predicted(before[k, 1], h, kicked(velocity[k, 1], factor, h, ay))
            position[k, 2] = predicted(before[k, 2], h, kicked(velocity[k, 2], factor, h, az))

    return begin


def make_end(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `update(first, last, before, position, velocity, parameters)`, velocities of the substep, and
    `collide(first, last, substep, before, position, velocity, parameters, bodies, kinds)`, collisions."""
    rate = compiler.formulas(distance, real).rate
    touch = make_collide_mass(compiler, real, parts)
    zero = real(0)

    @compiler.compiled
    def update(first, last, before, position, velocity, parameters):
        for k in range(first, last):
            for axis in range(AXES):
                v = rate(position[k, axis], before[k, axis], parameters.inverse_substep)
                velocity[k, axis] = v if before[k, 3] > zero else zero

    @compiler.compiled
    def collide(first, last, substep, before, position, velocity, parameters, bodies, kinds):
        for k in range(first, last):
            if before[k, 3] == zero:
                continue
            (px, py, pz), (vx, vy, vz) = touch(
                bodies, kinds, substep, parameters, (before[k, 0], before[k, 1], before[k, 2]),
                (position[k, 0], position[k, 1], position[k, 2]), (velocity[k, 0], velocity[k, 1], velocity[k, 2]),
            )  # fmt: skip
            position[k, 0] = px
            position[k, 1] = py
            position[k, 2] = pz
            velocity[k, 0] = vx
            velocity[k, 1] = vy
            velocity[k, 2] = vz

    return SimpleNamespace(update=update, collide=collide)


def make_touching(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the actions of colliders within iterations, on the masses `first` to before `last`.

    `touch(first, last, substep, fresh, before, position, pushes, parameters, bodies, kinds)`: positions after colliders;
    `pushes` (masses, 3) [m]: their displacement by colliders so far, 0 if `fresh`. Colliders act on the position without
    it, so that they hold a mass by what all constraints did to it since the substep began. `release(first, last,
    position, pushes)`: positions without that, for velocities and colliders of the substep's end.
    """
    rate = compiler.formulas(distance, real).rate
    collide_mass = make_collide_mass(compiler, real, parts - {"restitution"})  # velocities are the end's
    zero = real(0)

    @compiler.compiled
    def touch(first, last, substep, fresh, before, position, pushes, parameters, bodies, kinds):
        inverse_h = parameters.inverse_substep
        for k in range(first, last):
            if before[k, 3] == zero:
                continue
            x, y, z = position[k, 0], position[k, 1], position[k, 2]
            if not fresh:
                x, y, z = x - pushes[k, 0], y - pushes[k, 1], z - pushes[k, 2]
            velocity = (
                rate(x, before[k, 0], inverse_h),
                rate(y, before[k, 1], inverse_h),
                rate(z, before[k, 2], inverse_h),
            )
            old = before[k, 0], before[k, 1], before[k, 2]
            (px, py, pz), _ = collide_mass(bodies, kinds, substep, parameters, old, (x, y, z), velocity)
            position[k, 0], position[k, 1], position[k, 2] = px, py, pz
            pushes[k, 0], pushes[k, 1], pushes[k, 2] = px - x, py - y, pz - z

    @compiler.compiled
    def release(first, last, position, pushes):
        for k in range(first, last):
            for axis in range(AXES):
                position[k, axis] = position[k, axis] - pushes[k, axis]

    return SimpleNamespace(touch=touch, release=release)


def make_substep(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `opening` and `closing`, run by all threads of a team before and after a substep's constraints.

    `opening(team, member, bands, frame, number, position, velocity, before, predicted, world)`: positions are saved in
    `before`, predictions written into `predicted`, and pins moved; `closing(team, member, bands, number, position,
    velocity, before, world)`: velocities, colliders, pins. `world`: a World.
    """
    begin, ends, drive = make_begin(compiler, real, parts), make_end(compiler, real, parts), make_drive(compiler, real)
    update, collide = ends.update, ends.collide
    has_bodies, has_motion = bool(parts & set(COLLIDER_KINDS)), "motion" in parts

    @compiler.compiled
    def opening(team, member, bands, frame, number, position, velocity, before, predicted, world):
        count, parameters, driven = len(position), world.parameters, world.driven
        for band in assigned(team, member, bands):
            for k in range(count * band // bands, count * (band + 1) // bands):
                for axis in range(position.shape[1]):
                    before[k, axis] = position[k, axis]
        for band in assigned(team, member, bands):
            first, last = count * band // bands, count * (band + 1) // bands
            begin(first, last, frame, number, before, velocity, predicted, parameters, world.integers, world.wind_lists)
            if has_motion:
                first, last = driven.size * band // bands, driven.size * (band + 1) // bands
                drive(first, last, number, position, velocity, parameters, world.bodies, driven)

    @compiler.compiled
    def closing(team, member, bands, number, position, velocity, before, world):
        count, parameters, bodies, driven = len(position), world.parameters, world.bodies, world.driven
        for band in assigned(team, member, bands):
            first, last = count * band // bands, count * (band + 1) // bands
            update(first, last, before, position, velocity, parameters)
            if has_bodies:
                collide(first, last, number, before, position, velocity, parameters, bodies, world.kinds)
        if has_motion:
            for band in assigned(team, member, bands):
                first, last = driven.size * band // bands, driven.size * (band + 1) // bands
                drive(first, last, number, position, velocity, parameters, bodies, driven)

    return SimpleNamespace(opening=opening, closing=closing)


@cache
def make_mesh_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages, one parallel loop each: `predict`; `update`, `collide`, `pins`, `touch` and `release` as the
    functions that they call, with the number of `bands` instead of a range. core/constraints.py has those of
    constraints."""
    compiler = Compiler(cloth_variant("mesh_stages", real, math, parts), math)
    begin, ends = make_begin(compiler, real, parts), make_end(compiler, real, parts)
    update_some, collide_some, drive = ends.update, ends.collide, make_drive(compiler, real)
    touching = make_touching(compiler, real, parts)
    touch_some, release_some = touching.touch, touching.release

    def predict(team, member, bands, step, substep, position, velocity, before, parameters, integers, wind_lists):
        count = len(position)
        for band in assigned(team, member, bands):
            for k in range(count * band // bands, count * (band + 1) // bands):
                for axis in range(position.shape[1]):
                    before[k, axis] = position[k, axis]
        for band in assigned(team, member, bands):
            first, last = count * band // bands, count * (band + 1) // bands
            begin(first, last, step, substep, before, velocity, position, parameters, integers, wind_lists)

    def update(band, bands, before, position, velocity, parameters):
        count = len(position)
        update_some(count * band // bands, count * (band + 1) // bands, before, position, velocity, parameters)

    def collide(band, bands, substep, before, position, velocity, parameters, bodies, kinds):
        count = len(position)
        first, last = count * band // bands, count * (band + 1) // bands
        collide_some(first, last, substep, before, position, velocity, parameters, bodies, kinds)

    def pins(band, bands, number, position, velocity, parameters, bodies, driven):
        many = driven.size
        drive(many * band // bands, many * (band + 1) // bands, number, position, velocity, parameters, bodies, driven)

    def touch(band, bands, substep, fresh, before, position, pushes, parameters, bodies, kinds):
        count = len(position)
        first, last = count * band // bands, count * (band + 1) // bands
        touch_some(first, last, substep, fresh, before, position, pushes, parameters, bodies, kinds)

    def release(band, bands, position, pushes):
        count = len(position)
        release_some(count * band // bands, count * (band + 1) // bands, position, pushes)

    banded = {one.__name__: compiler.banded(one) for one in (update, collide, pins, touch, release)}
    return SimpleNamespace(predict=compiler.team(predict), **banded)


@cache
def make_mesh_advance(real: Real, math: str, parts: frozenset[str], projections: tuple[Projection, ...]) -> Callable:
    """Compile advance(bands, steps, position, velocity, before, sets, world, pushes): many steps in one call.

    `steps`: a Steps; `world`: a World; `sets`: (corners, values, multipliers, starts) of each set of constraints, in
    the order of `projections`; `pushes`: of make_touching.
    """
    compiler = Compiler(cloth_variant("mesh", real, math, parts), math)
    substep, rows = make_substep(compiler, real, parts), make_rows(compiler)
    opening, closing = substep.opening, substep.closing
    projects = [make_projections(compiler, real, projection, rows) for projection in projections]
    sweep = make_colours(compiler, projects, [projection.run for projection in projections])
    has_constraints, has_touching = bool(projects), TOUCHING in parts
    touching = make_touching(compiler, real, parts)
    touch, release = touching.touch, touching.release

    def advance(team, member, bands, steps, position, velocity, before, sets, world, pushes):
        count, step, substeps, iterations = steps
        particles = len(position)
        for pass_number in range(count * substeps):
            number = step * substeps + pass_number
            frame = step + pass_number // substeps
            opening(team, member, bands, frame, number, position, velocity, before, position, world)
            if has_constraints:
                for iteration in range(iterations):
                    fresh = iteration == 0
                    if has_touching:
                        for band in assigned(team, member, bands):
                            first, last = particles * band // bands, particles * (band + 1) // bands
                            touch(
                                first, last, number, fresh, before, position, pushes, world.parameters, world.bodies,
                                world.kinds,
                            )  # fmt: skip
                    sweep(team, member, bands, position, position, before, sets, fresh, world.parameters)
            if has_touching:
                for band in assigned(team, member, bands):
                    release(particles * band // bands, particles * (band + 1) // bands, position, pushes)
            closing(team, member, bands, number, position, velocity, before, world)

    return compiler.team(advance)
