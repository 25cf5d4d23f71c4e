"""Motion of one mass of a cloth in a pass of an integrator: its forces, the step's formula, the colliders, the pins."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.contact.pins import make_pins
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.mass_spring.cloth.point import make_cloth_forces
from softlab.model.base.types import Real
from softlab.model.core.integrators import step_formula
from softlab.model.core.own_forces import particle_forces_change
from softlab.model.formulas import integrators

RK4_OFFSETS = (0.0, 0.5, 0.5, 1.0)  # of a stage's time, in steps
RK4_DERIVATIVE = ("half_dt", "half_dt", "dt", "dt")
RK4_TOTAL = ("sixth_dt", "third_dt", "third_dt", "sixth_dt")


@cache
def make_cloth_kicks(real: Real, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Callable]:
    """Make device functions: `step` of one-force integrators; `opening`, `middle`, `closing` of velocity Verlet.

    Each is kick(ax, ay, az, k, p, v, world, step) -> (px, py, pz, vx, vy, vz): of mass k, at p and with velocity v
    (quads), which springs, gravity and wind accelerate by a. `step` is the number of the step that begins.
    """
    forces, collide = make_cloth_forces(real, math, parts), make_collide(real, math, parts)
    pin = make_pins(real, math, parts).pin
    add_particle_force, damp = forces.add_particle_force, forces.damp
    formulas = device_formulas(integrators, real, math, {"damped": True})
    first_half, second_half = formulas.verlet_first_half, formulas.verlet_second_half
    verlet = integrator == "velocity-verlet"
    one_force = formulas.variant(step_formula(integrator))
    has_pins, changes = "pins" in parts, particle_forces_change(parts)
    zero, one = real(0), np.int64(1)
    inline = inlined(math)

    @inline
    def settle(p, px, py, pz, vx, vy, vz, world, step):
        """Apply colliders, then pins: a pinned mass stays where it was, or follows its motion."""
        px, py, pz, vx, vy, vz = collide(p, px, py, pz, vx, vy, vz, world, step)
        if has_pins:
            if p[3] != zero:
                px, py, pz, vx, vy, vz = pin(p[3], p, step, False, world)
        return px, py, pz, vx, vy, vz

    @inline
    def step_mass(ax, ay, az, k, p, v, world, step):
        parameters, integers = world.parameters, world.integers
        ax, ay, az = add_particle_force(ax, ay, az, k, zero, parameters, integers, step)
        ax, ay, az = damp(ax, ay, az, v, parameters)
        dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
        px, vx = one_force(p[0], v[0], ax, dt, half_dt_squared)
        py, vy = one_force(p[1], v[1], ay, dt, half_dt_squared)
        pz, vz = one_force(p[2], v[2], az, dt, half_dt_squared)
        return settle(p, px, py, pz, vx, vy, vz, world, step)

    @inline
    def kick_and_drift(p, vx, vy, vz, ax, ay, az, world, step):
        """Do the first half of a step from the velocity (vx, vy, vz)."""
        parameters = world.parameters
        dt, half_dt, rate = parameters.dt, parameters.half_dt, parameters.damping
        px, vx = first_half(p[0], vx, ax, dt, half_dt, rate)
        py, vy = first_half(p[1], vy, ay, dt, half_dt, rate)
        pz, vz = first_half(p[2], vz, az, dt, half_dt, rate)
        return settle(p, px, py, pz, vx, vy, vz, world, step)

    @inline
    def second_kick(v, ax, ay, az, parameters):
        half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
        return (
            second_half(v[0], ax, half_dt, inverse_damping),
            second_half(v[1], ay, half_dt, inverse_damping),
            second_half(v[2], az, half_dt, inverse_damping),
        )

    @inline
    def opening_mass(ax, ay, az, k, p, v, world, step):
        parameters, integers = world.parameters, world.integers
        ax, ay, az = add_particle_force(ax, ay, az, k, zero, parameters, integers, step)
        return kick_and_drift(p, v[0], v[1], v[2], ax, ay, az, world, step)

    @inline
    def closing_mass(ax, ay, az, k, p, v, world, step):
        parameters, integers = world.parameters, world.integers
        ax, ay, az = add_particle_force(ax, ay, az, k, zero, parameters, integers, step - one)
        vx, vy, vz = second_kick(v, ax, ay, az, parameters)
        if has_pins:
            if p[3] != zero:  # one that follows a motion already has its velocity
                vx, vy, vz = v[0], v[1], v[2]
        return p[0], p[1], p[2], vx, vy, vz

    @inline
    def middle_mass(bx, by, bz, k, p, v, world, step):
        """Do the second half kick of one step and the first of the next: both need the force here, computed once."""
        parameters, integers = world.parameters, world.integers
        ax, ay, az = add_particle_force(bx, by, bz, k, zero, parameters, integers, step - one)
        if changes:
            bx, by, bz = add_particle_force(bx, by, bz, k, zero, parameters, integers, step)
        else:
            bx, by, bz = ax, ay, az
        vx, vy, vz = second_kick(v, ax, ay, az, parameters)
        return kick_and_drift(p, vx, vy, vz, bx, by, bz, world, step)

    if verlet:
        return {"opening": opening_mass, "middle": middle_mass, "closing": closing_mass}
    return {"step": step_mass}


@cache
def make_cloth_moves(real: Real, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Callable]:
    """Make the functions of make_cloth_kicks together with the forces before them.

    Each is move(position, velocity, place, k, cell, p, v, world, step, air) -> (px, py, pz, vx, vy, vz): of mass k in
    row i and column j, at index `place` of the arrays of quads that its neighbours are read from, at p and with
    velocity v.

    Velocity Verlet's two kicks between steps are one pass with one force evaluation, `middle`, if no force depends on
    velocities (model/cloth_plan.kicks_coupled); else a step is `opening` and `closing`.
    """
    steady = make_cloth_forces(real, math, parts).steady
    inline = inlined(math)

    def make_move(kick: Callable) -> Callable:
        @inline
        def move(position, velocity, place, k, cell, p, v, world, step, air):
            parameters = world.parameters
            ax, ay, az = steady(position, velocity, place, cell, p, v, parameters, air)
            return kick(ax, ay, az, k, p, v, world, step)

        return move

    return {name: make_move(kick) for name, kick in make_cloth_kicks(real, math, integrator, parts).items()}


@cache
def make_cloth_rk4(real: Real, math: str, parts: frozenset[str], stage: int) -> Callable:
    """Make one of the four stages of RK4 (0 to 3), a device function.

    move(position, velocity, k, cell, now, base, total, world, step, air) -> (p', v', total_p', total_v'), each (x, y,
    z): the state of the next stage and the running sum; in the last stage p', v' are the new state, after colliders.
    `now`, `base`, `total`: position and velocity of mass k. The first stage reads no total.
    """
    forces, collide = make_cloth_forces(real, math, parts), make_collide(real, math, parts)
    pin, halfway = (
        make_pins(real, math, parts).pin,
        stage < 2,
    )  # a stage leads to half of the step, or all of it
    steady, add_particle_force, damp = forces.steady, forces.add_particle_force, forces.damp
    rk4_stage = device_formulas(integrators, real, math).rk4_stage
    k_derivative, k_total, last = RK4_DERIVATIVE[stage], RK4_TOTAL[stage], stage == 3
    has_pins = "pins" in parts
    zero = real(0)
    inline = inlined(math)

    @inline
    def advanced(base, rate, total, derivative_dt, total_dt):
        """Apply rk4_stage by axis. Returns (next x, y, z), (sum x, y, z)."""
        x, sum_x = rk4_stage(base[0], rate[0], total[0], derivative_dt, total_dt)
        y, sum_y = rk4_stage(base[1], rate[1], total[1], derivative_dt, total_dt)
        z, sum_z = rk4_stage(base[2], rate[2], total[2], derivative_dt, total_dt)
        return (x, y, z), (sum_x, sum_y, sum_z)

    @inline
    def rk4_mass(position, velocity, k, cell, now, base, total, world, step, air):
        parameters, integers = world.parameters, world.integers
        p, v = now
        (base_p, base_v), (total_p, total_v) = base, total
        ax, ay, az = steady(position, velocity, k, cell, p, v, parameters, air)
        ax, ay, az = add_particle_force(ax, ay, az, k, zero, parameters, integers, step)
        ax, ay, az = damp(ax, ay, az, v, parameters)
        derivative_dt, total_dt = parameters[k_derivative], parameters[k_total]
        new_p, sum_p = advanced(base_p, v, total_p, derivative_dt, total_dt)
        new_v, sum_v = advanced(base_v, (ax, ay, az), total_v, derivative_dt, total_dt)
        if last:
            px, py, pz, vx, vy, vz = collide(
                base_p, sum_p[0], sum_p[1], sum_p[2], sum_v[0], sum_v[1], sum_v[2], world, step
            )
            new_p, new_v = (px, py, pz), (vx, vy, vz)
        if has_pins:
            if p[3] != zero:
                px, py, pz, vx, vy, vz = pin(p[3], p, step, halfway, world)
                new_p, new_v = (px, py, pz), (vx, vy, vz)
        return new_p, new_v, sum_p, sum_v

    return rk4_mass
