"""CUDA kernels of a fluid's velocities and positions by the scheme `divergence-free`, around its solves, one thread per
particle (model/fluid/divergence_plan.py, 1, 6, 8 and 11)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_force, with_forces
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.motion import SLOWED, limit_change, limit_speed
from softlab.gpu_backend.fluid.sums import row
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.gpu_backend.fluid.walls import settled
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.fluid.parameters import F_BUOYANCY, F_CHANGE, F_DRAG, F_SPEED, F_SURFACE_DRAG, F_WEIGHT
from softlab.model.formulas.fluid.divergence import gained
from softlab.model.formulas.fluid.motion import accelerated, braked, buoyant, drifted, speed_of, wrapped_offset


@inlined_routine
def corrected_velocity(v, e, most, parameters):
    """Return a velocity after a solve."""
    rate = parameters.inverse_dt
    x, y, z = gained(v[0], e[0], rate), gained(v[1], e[1], rate), gained(v[2], e[2], rate)
    return limit_change(x, y, z, v[0], v[1], v[2], most)


@inlined_routine
def velocity_after_forces(k, v, at, particle, constraints, parameters, fluids, integers, step):
    """Return the velocity after drag and the forces on the particle; `at`: the row of its fluid."""
    vx, vy, vz, h, ay = v[0], v[1], v[2], parameters.dt, 0.0
    if FEATURE.drag:
        c, drag, surface = constraints[k], fluids[at + F_DRAG], fluids[at + F_SURFACE_DRAG]
        vx, vy = braked(vx, h, drag, surface, c), braked(vy, h, drag, surface, c)
        vz = braked(vz, h, drag, surface, c)
    if FEATURE.gravity:
        ay = buoyant(parameters.gravity, fluids[at + F_BUOYANCY])
    if FEATURE.axes == 3:
        ax, ay, az = particle_force((0.0, ay, 0.0), particle[k], 1.0, parameters, integers, step)
    else:
        ax, ay = particle_force((0.0, ay), particle[k], 1.0, parameters, integers, step)
        az = 0.0
    return accelerated(vx, h, ax), accelerated(vy, h, ay), accelerated(vz, h, az)


@routine
def gather(position, record, into):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        parameters, p = record[0], load_quad(position, k)
        x, y, z = p[0], p[1], p[2]
        if FEATURE.periodic_x:
            x = x + wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
        if FEATURE.periodic_y:
            y = y + wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
        if FEATURE.periodic_z:
            z = z + wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
        store_quad(into, k, x, y, z, p[3])


@routine
def take_up(before, velocity, shifts, record, fluids):
    k = np.int32(cuda.grid(1))
    if k < before.size // SIZE:
        at = row(load_quad(before, k)[3])
        vx, vy, vz = corrected_velocity(load_quad(velocity, k), load_quad(shifts, k), fluids[at + F_CHANGE], record[0])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def accelerate(
    before, velocity, particle, constraints, record, fluids, integers, counter, place, substeps, substep, into,
    counts,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    if k < before.size // SIZE:
        step, _ = clock(counter, place, substeps, substep)
        at, v = row(load_quad(before, k)[3]), load_quad(velocity, k)
        vx, vy, vz = velocity_after_forces(k, v, at, particle, constraints, record[0], fluids, integers, step)
        if speed_of(vx, vy, vz) > fluids[at + F_SPEED]:
            cuda.atomic.add(counts, SLOWED, 1)
        vx, vy, vz = limit_speed(vx, vy, vz, fluids[at + F_SPEED])
        store_quad(into, k, vx, vy, vz, 0.0)


@routine
def move(
    before, velocity, shifts, multipliers, seconds, record, fluids, bodies, integers, counter, place, substeps, substep,
    new_position, new_velocity,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    if k < before.size // SIZE:
        parameters, b = record[0], load_quad(before, k)
        at, h = row(b[3]), parameters.dt
        u = load_quad(velocity, k)
        vx, vy, vz = corrected_velocity(u, load_quad(shifts, k), fluids[at + F_CHANGE], parameters)
        vx, vy, vz = limit_speed(vx, vy, vz, fluids[at + F_SPEED])
        x, y, z = drifted(b[0], vx, h), drifted(b[1], vy, h), drifted(b[2], vz, h)
        _, number = clock(counter, place, substeps, substep)
        world = World(parameters, bodies, integers)
        if FEATURE.colliders:
            vx, vy, vz = settled(b, (vx, vy, vz), u, seconds[k], fluids[at + F_WEIGHT], world, number)
        x, y, z, vx, vy, vz = collide(b, x, y, z, vx, vy, vz, world, number)
        if FEATURE.colliders:
            vx, vy, vz = limit_speed(vx, vy, vz, fluids[at + F_SPEED])
        multipliers[k] = multipliers[k] + seconds[k]
        store_quad(new_position, k, x, y, z, b[3])
        store_quad(new_velocity, k, vx, vy, vz, 0.0)


@cache
def make_free_motion(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `gather`, `take_up`, `accelerate` and `move`.

    `gather(position, record, into)`: positions wrapped into the periodic box; `take_up(before, velocity, shifts,
    record, fluids)`; `accelerate(before, velocity, particle, constraints, record, fluids, integers, counter, place,
    substeps, substep, into, counts)`; `move(before, velocity, shifts, multipliers, seconds, record, fluids, *world,
    new_position, new_velocity)`. `before`: positions and fluids of particles; `world`: bodies, integers, counter,
    place, substeps, substep.
    """
    variant = fluid_variant(real, math, parts, repeats)
    kernels = gather, take_up, with_forces(accelerate, parts), move
    return kernels_of(variant, math, kernels, f"fluid_{variant_name(real, math, parts, repeats)}")
