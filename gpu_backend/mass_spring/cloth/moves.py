"""Motion of one mass of a cloth in a pass of an integrator: its forces, the step's formula, the colliders, the pins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.contact.pins import pin
from softlab.gpu_backend.core.forces import add_particle_force
from softlab.gpu_backend.mass_spring.cloth.point import damp, steady
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
from softlab.model.formulas.integrators import one_force, rk4_stage, verlet_first_half, verlet_second_half

ONE = np.int64(1)
RK4_OFFSETS = (0.0, 0.5, 0.5, 1.0)  # of a stage's time, in steps
kick = Open("kick(ax, ay, az, k, p, v, world, step): of `kicks_of`")


@inlined_routine
def settle(p, px, py, pz, vx, vy, vz, world, step):
    """Apply colliders, then pins: a pinned mass stays where it was, or follows its motion."""
    px, py, pz, vx, vy, vz = collide(p, px, py, pz, vx, vy, vz, world, step)
    if FEATURE.pins:
        if p[3] != 0.0:
            px, py, pz, vx, vy, vz = pin(p[3], p, step, False, world)
    return px, py, pz, vx, vy, vz


@inlined_routine
def step_mass(ax, ay, az, k, p, v, world, step):
    parameters, integers = world.parameters, world.integers
    ax, ay, az = add_particle_force(ax, ay, az, k, 0.0, parameters, integers, step)
    ax, ay, az = damp(ax, ay, az, v, parameters)
    dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
    px, vx = one_force(p[0], v[0], ax, dt, half_dt_squared)
    py, vy = one_force(p[1], v[1], ay, dt, half_dt_squared)
    pz, vz = one_force(p[2], v[2], az, dt, half_dt_squared)
    return settle(p, px, py, pz, vx, vy, vz, world, step)


@inlined_routine
def kick_and_drift(p, vx, vy, vz, ax, ay, az, world, step):
    """Do the first half of a step from the velocity (vx, vy, vz)."""
    parameters = world.parameters
    dt, half_dt, rate = parameters.dt, parameters.half_dt, parameters.damping
    px, vx = verlet_first_half(p[0], vx, ax, dt, half_dt, rate)
    py, vy = verlet_first_half(p[1], vy, ay, dt, half_dt, rate)
    pz, vz = verlet_first_half(p[2], vz, az, dt, half_dt, rate)
    return settle(p, px, py, pz, vx, vy, vz, world, step)


@inlined_routine
def second_kick(v, ax, ay, az, parameters):
    half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
    return (
        verlet_second_half(v[0], ax, half_dt, inverse_damping),
        verlet_second_half(v[1], ay, half_dt, inverse_damping),
        verlet_second_half(v[2], az, half_dt, inverse_damping),
    )


@inlined_routine
def opening_mass(ax, ay, az, k, p, v, world, step):
    parameters, integers = world.parameters, world.integers
    ax, ay, az = add_particle_force(ax, ay, az, k, 0.0, parameters, integers, step)
    return kick_and_drift(p, v[0], v[1], v[2], ax, ay, az, world, step)


@inlined_routine
def closing_mass(ax, ay, az, k, p, v, world, step):
    parameters, integers = world.parameters, world.integers
    ax, ay, az = add_particle_force(ax, ay, az, k, 0.0, parameters, integers, step - ONE)
    vx, vy, vz = second_kick(v, ax, ay, az, parameters)
    if FEATURE.pins:
        if p[3] != 0.0:  # one that follows a motion already has its velocity
            vx, vy, vz = v[0], v[1], v[2]
    return p[0], p[1], p[2], vx, vy, vz


@inlined_routine
def middle_mass(bx, by, bz, k, p, v, world, step):
    """Do the second half kick of one step and the first of the next: both need the force here, computed once."""
    parameters, integers = world.parameters, world.integers
    ax, ay, az = add_particle_force(bx, by, bz, k, 0.0, parameters, integers, step - ONE)
    if FEATURE.changing:
        bx, by, bz = add_particle_force(bx, by, bz, k, 0.0, parameters, integers, step)
    else:
        bx, by, bz = ax, ay, az
    vx, vy, vz = second_kick(v, ax, ay, az, parameters)
    return kick_and_drift(p, vx, vy, vz, bx, by, bz, world, step)


@inlined_routine
def move(position, velocity, place, k, cell, p, v, world, step, air):
    parameters = world.parameters
    ax, ay, az = steady(position, velocity, place, cell, p, v, parameters, air)
    return kick(ax, ay, az, k, p, v, world, step)


@inlined_routine
def advanced(base, rate, total, derivative_dt, total_dt):
    """Apply rk4_stage by axis. Returns (next x, y, z), (sum x, y, z)."""
    x, sum_x = rk4_stage(base[0], rate[0], total[0], derivative_dt, total_dt)
    y, sum_y = rk4_stage(base[1], rate[1], total[1], derivative_dt, total_dt)
    z, sum_z = rk4_stage(base[2], rate[2], total[2], derivative_dt, total_dt)
    return (x, y, z), (sum_x, sum_y, sum_z)


@inlined_routine
def rk4_mass(position, velocity, k, cell, now, base, total, world, step, air):
    """Do one of the four stages of RK4. Returns (p', v', total_p', total_v'), each (x, y, z): the state of the next stage
    and the running sum; in the last stage p', v' are the new state, after colliders.

    `now`, `base`, `total`: position and velocity of mass k. The first stage reads no total.
    """
    parameters, integers = world.parameters, world.integers
    p, v = now
    (base_p, base_v), (total_p, total_v) = base, total
    ax, ay, az = steady(position, velocity, k, cell, p, v, parameters, air)
    ax, ay, az = add_particle_force(ax, ay, az, k, 0.0, parameters, integers, step)
    ax, ay, az = damp(ax, ay, az, v, parameters)
    derivative_dt = parameters.half_dt if FEATURE.stage < 2 else parameters.dt
    total_dt = parameters.sixth_dt if FEATURE.stage == 0 or FEATURE.stage == 3 else parameters.third_dt
    new_p, sum_p = advanced(base_p, v, total_p, derivative_dt, total_dt)
    new_v, sum_v = advanced(base_v, (ax, ay, az), total_v, derivative_dt, total_dt)
    if FEATURE.stage == 3:
        px, py, pz, vx, vy, vz = collide(
            base_p, sum_p[0], sum_p[1], sum_p[2], sum_v[0], sum_v[1], sum_v[2], world, step
        )
        new_p, new_v = (px, py, pz), (vx, vy, vz)
    if FEATURE.pins:
        if p[3] != 0.0:
            px, py, pz, vx, vy, vz = pin(p[3], p, step, FEATURE.stage < 2, world)
            new_p, new_v = (px, py, pz), (vx, vy, vz)
    return new_p, new_v, sum_p, sum_v


def kicks_of(integrator: str) -> dict[str, Callable]:
    """Return the motion of one mass by the name of the pass: `step` of one-force integrators; `opening`, `middle`,
    `closing` of velocity Verlet.

    Each is kick(ax, ay, az, k, p, v, world, step) -> (px, py, pz, vx, vy, vz): of mass k, at p and with velocity v
    (quads), which springs, gravity and wind accelerate by a. `step` is the number of the step that begins.
    """
    if integrator == "velocity-verlet":
        return {"opening": opening_mass, "middle": middle_mass, "closing": closing_mass}
    return {"step": step_mass}


def moves_of(integrator: str) -> dict[str, Callable]:
    """Return the motions of `kicks_of` together with the forces before them.

    Each is move(position, velocity, place, k, cell, p, v, world, step, air) -> (px, py, pz, vx, vy, vz): of mass k in
    row i and column j, at index `place` of the arrays of quads that its neighbours are read from, at p and with
    velocity v.

    Velocity Verlet's two kicks between steps are one pass with one force evaluation, `middle`, if no force depends on
    velocities (model/cloth_plan.kicks_coupled); else a step is `opening` and `closing`.
    """
    return {name: filled(move, {"kick": one}) for name, one in kicks_of(integrator).items()}
