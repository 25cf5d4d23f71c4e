"""Operations on one vertex of a mesh, and loops over vertices and constraints (core/constraints.py), for CPU threads.

A mass is a row of four numbers: x, y, z and, in the positions, its weight. No two constraints of a colour share a mass,
so threads may process any part of it: the state's bits depend neither on their number nor on their order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass
from softlab.cpu_backend.contact.pins import drive
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.constraints import make_colours, make_projections
from softlab.cpu_backend.core.own_forces import particle_force, with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.core.wind import air_now
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, features_of, filled, routine
from softlab.model.formulas.distance import added, damping_factor, kicked, predicted, rate, slowed
from softlab.model.particles.constraints import Projection
from softlab.model.position_based import mesh_wind
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


collide_position = Open("collide_position(...): as collide_mass, without restitution")
sweep = Open("sweep(team, member, bands, position, weights, before, sets, fresh, parameters): project all constraints")


@routine
def row(array, k):
    return array[k, 0], array[k, 1], array[k, 2]


wind_of = filled(mesh_wind.wind_of, {"row": row, "corners_of": row})


@routine
def begin(first, last, step, substep, before, velocity, position, parameters, integers, wind_lists):
    """Predict the positions of the masses `first` to before `last`."""
    h = parameters.dt
    air = air_now(parameters, integers, substep, 0.0) if FEATURE.wind else (0.0, 0.0, 0.0)
    for k in range(first, last):
        w = before[k, 3]
        if w == 0.0:
            continue
        ax, ay, az = 0.0, 0.0, 0.0
        if FEATURE.gravity:
            ay = ay + parameters.gravity
        if FEATURE.wind:
            fx, fy, fz = wind_of(k, air, before, velocity, parameters, wind_lists)
            ax, ay, az = added(ax, w, fx), added(ay, w, fy), added(az, w, fz)
        ax, ay, az = particle_force((ax, ay, az), k, w, parameters, integers, step)
        factor = damping_factor(parameters.braking, w) if FEATURE.damping else 1.0
        if FEATURE.body_damping:
            for axis in range(AXES):
                velocity[k, axis] = slowed(velocity[k, axis], velocity[k, 3], h)
        position[k, 0] = predicted(before[k, 0], h, kicked(velocity[k, 0], factor, h, ax))
        position[k, 1] = predicted(before[k, 1], h, kicked(velocity[k, 1], factor, h, ay))
        position[k, 2] = predicted(before[k, 2], h, kicked(velocity[k, 2], factor, h, az))


@routine
def update_masses(first, last, before, position, velocity, parameters):
    """Compute the velocities of the substep."""
    for k in range(first, last):
        for axis in range(AXES):
            v = rate(position[k, axis], before[k, axis], parameters.inverse_substep)
            velocity[k, axis] = v if before[k, 3] > 0.0 else 0.0


@routine
def collide_masses(first, last, substep, before, position, velocity, parameters, bodies, kinds):
    """Apply the colliders."""
    for k in range(first, last):
        if before[k, 3] == 0.0:
            continue
        (px, py, pz), (vx, vy, vz) = collide_mass(
            bodies, kinds, substep, parameters, (before[k, 0], before[k, 1], before[k, 2]),
            (position[k, 0], position[k, 1], position[k, 2]), (velocity[k, 0], velocity[k, 1], velocity[k, 2]),
        )  # fmt: skip
        position[k, 0] = px
        position[k, 1] = py
        position[k, 2] = pz
        velocity[k, 0] = vx
        velocity[k, 1] = vy
        velocity[k, 2] = vz


@routine
def touch_masses(first, last, substep, fresh, before, position, pushes, parameters, bodies, kinds):
    """Apply the colliders within iterations to positions.

    `pushes` (masses, 3) [m]: displacement by colliders so far, 0 if `fresh`. Colliders act on the position without it,
    so that they act on a mass with all that constraints did to it since the substep began.
    """
    inverse_h = parameters.inverse_substep
    for k in range(first, last):
        if before[k, 3] == 0.0:
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
        (px, py, pz), _ = collide_position(bodies, kinds, substep, parameters, old, (x, y, z), velocity)
        position[k, 0], position[k, 1], position[k, 2] = px, py, pz
        pushes[k, 0], pushes[k, 1], pushes[k, 2] = px - x, py - y, pz - z


@routine
def release_masses(first, last, position, pushes):
    """Write positions without `pushes`, for velocities and colliders of the substep's end."""
    for k in range(first, last):
        for axis in range(AXES):
            position[k, axis] = position[k, axis] - pushes[k, axis]


@routine
def opening(team, member, bands, frame, number, position, velocity, before, predicted, world):
    """Start a substep, in all threads of a team: save positions in `before`, write predictions into `predicted`, move
    pins; `world`: a World."""
    count, parameters, driven = len(position), world.parameters, world.driven
    for band in assigned(team, member, bands):
        for k in range(count * band // bands, count * (band + 1) // bands):
            for axis in range(position.shape[1]):
                before[k, axis] = position[k, axis]
    for band in assigned(team, member, bands):
        first, last = count * band // bands, count * (band + 1) // bands
        begin(first, last, frame, number, before, velocity, predicted, parameters, world.integers, world.wind_lists)
        if FEATURE.motion:
            first, last = driven.size * band // bands, driven.size * (band + 1) // bands
            drive(first, last, number, position, velocity, parameters, world.bodies, driven)


@routine
def closing(team, member, bands, number, position, velocity, before, world):
    """End a substep, in all threads of a team: velocities, colliders, pins."""
    count, parameters, bodies, driven = len(position), world.parameters, world.bodies, world.driven
    for band in assigned(team, member, bands):
        first, last = count * band // bands, count * (band + 1) // bands
        update_masses(first, last, before, position, velocity, parameters)
        if FEATURE.colliders:
            collide_masses(first, last, number, before, position, velocity, parameters, bodies, world.kinds)
    if FEATURE.motion:
        for band in assigned(team, member, bands):
            first, last = driven.size * band // bands, driven.size * (band + 1) // bands
            drive(first, last, number, position, velocity, parameters, bodies, driven)


def mesh_features(parts: frozenset[str]) -> dict[str, Any]:
    """Return the features of these kernels. Every mass has its weight."""
    return features_of(parts | {"load"}) | {"axes": AXES, "colliders": bool(parts & set(COLLIDER_KINDS))}


def of_scene(compiler: Compiler, kernel: Callable, real: Real, parts: frozenset[str]) -> Any:
    """Return a kernel with the forces and colliders of a scene; those within iterations leave velocities to the end."""
    position_only = compiler.variant_of(real, mesh_features(parts - {"restitution"}))(collide_mass)
    return with_forces(filled(kernel, {"collide_position": position_only}), parts)


@routine
def predict(team, member, bands, step, substep, position, velocity, before, parameters, integers, wind_lists):
    count = len(position)
    for band in assigned(team, member, bands):
        for k in range(count * band // bands, count * (band + 1) // bands):
            for axis in range(position.shape[1]):
                before[k, axis] = position[k, axis]
    for band in assigned(team, member, bands):
        first, last = count * band // bands, count * (band + 1) // bands
        begin(first, last, step, substep, before, velocity, position, parameters, integers, wind_lists)


@routine
def update(band, bands, before, position, velocity, parameters):
    count = len(position)
    update_masses(count * band // bands, count * (band + 1) // bands, before, position, velocity, parameters)


@routine
def collide(band, bands, substep, before, position, velocity, parameters, bodies, kinds):
    count = len(position)
    first, last = count * band // bands, count * (band + 1) // bands
    collide_masses(first, last, substep, before, position, velocity, parameters, bodies, kinds)


@routine
def pins(band, bands, number, position, velocity, parameters, bodies, driven):
    many = driven.size
    drive(many * band // bands, many * (band + 1) // bands, number, position, velocity, parameters, bodies, driven)


@routine
def touch(band, bands, substep, fresh, before, position, pushes, parameters, bodies, kinds):
    count = len(position)
    first, last = count * band // bands, count * (band + 1) // bands
    touch_masses(first, last, substep, fresh, before, position, pushes, parameters, bodies, kinds)


@routine
def release(band, bands, position, pushes):
    count = len(position)
    release_masses(count * band // bands, count * (band + 1) // bands, position, pushes)


@cache
def make_mesh_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages, one parallel loop each: `predict`; `update`, `collide`, `pins`, `touch` and `release` as the
    functions that they call, with the number of `bands` instead of a range. core/constraints.py has those of
    constraints."""
    compiler = Compiler(cloth_variant("mesh_stages", real, math, parts), math)
    variant = compiler.variant_of(real, mesh_features(parts))

    def copied(stage: Any) -> Callable:
        return variant.copied(of_scene(compiler, stage, real, parts))

    banded = {stage.__name__: compiler.banded(copied(stage)) for stage in (update, collide, pins, touch, release)}
    return SimpleNamespace(predict=compiler.team(copied(predict)), **banded)


@routine
def advance(team, member, bands, steps, position, velocity, before, sets, world, pushes):
    """Do many steps in one call.

    `steps`: a Steps; `world`: a World; `sets`: (corners, values, multipliers, starts) of each set of constraints;
    `pushes`: of `touch_masses`.
    """
    count, step, substeps, iterations = steps
    particles = len(position)
    for pass_number in range(count * substeps):
        number = step * substeps + pass_number
        frame = step + pass_number // substeps
        opening(team, member, bands, frame, number, position, velocity, before, position, world)
        if FEATURE.constraints:
            for iteration in range(iterations):
                fresh = iteration == 0
                if FEATURE.colliders_in_iterations:
                    for band in assigned(team, member, bands):
                        first, last = particles * band // bands, particles * (band + 1) // bands
                        touch_masses(
                            first, last, number, fresh, before, position, pushes, world.parameters, world.bodies,
                            world.kinds,
                        )  # fmt: skip
                sweep(team, member, bands, position, position, before, sets, fresh, world.parameters)
        if FEATURE.colliders_in_iterations:
            for band in assigned(team, member, bands):
                release_masses(particles * band // bands, particles * (band + 1) // bands, position, pushes)
        closing(team, member, bands, number, position, velocity, before, world)


@cache
def make_mesh_advance(real: Real, math: str, parts: frozenset[str], projections: tuple[Projection, ...]) -> Callable:
    """Compile `advance` for sets of constraints with these `projections`, in their order."""
    compiler = Compiler(cloth_variant("mesh", real, math, parts), math)
    projects = [make_projections(compiler, real, projection, False) for projection in projections]
    sweep = make_colours(compiler, projects, [projection.run for projection in projections])
    kernel = of_scene(compiler, filled(advance, {"sweep": sweep}), real, parts)
    return compiler.team(
        compiler.variant_of(real, mesh_features(parts) | {"constraints": bool(projects)}).copied(kernel)
    )
