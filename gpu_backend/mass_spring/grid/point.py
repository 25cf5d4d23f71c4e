"""Operations on one mass, as device functions: its forces, and its motion in each pass of an integrator.

Each thread sums the pulls of its four neighbours. Sums are computed as on the CPU: (right + left) + (below + above),
then gravity, external, poke, damping. A neighbour beyond the edge is replaced by the mass itself, whose
pull on itself is zero: no branch at the edges. Functions are compiled for the parts of a scene: flags are closure
constants, an absent part leaves no instruction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernel_options
from softlab.gpu_backend.core.forces import make_particle_force
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.pairs import load_pair
from softlab.model.base.types import Real
from softlab.model.core.integrators import step_formula
from softlab.model.core.own_forces import particle_forces_change
from softlab.model.formulas import integrators, springs


def _make_spring_sum(real: Real, device: Any, spring_acceleration_2d: Callable, parts: frozenset[str]) -> Callable:
    """Make spring_sum(position, k, cell, parameters)."""
    has_springs, zero, one = "springs" in parts, real(0), np.int32(1)

    @device
    def spring_sum(position, k, cell, parameters):
        """Return the sum of the four pulls over mass [m/s^2] on mass k = i * columns + j, (0, 0) in a scene without
        springs."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        if not has_springs:
            return zero, zero
        here = load_pair(position, k)
        left = load_pair(position, k - one if j > 0 else k)
        right = load_pair(position, k + one if j < columns - 1 else k)
        above = load_pair(position, k - columns if i > 0 else k)
        below = load_pair(position, k + columns if i < rows - 1 else k)
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        right_x, right_y = spring_acceleration_2d(right.real - here.real, right.imag - here.imag, stiffness, rest)
        left_x, left_y = spring_acceleration_2d(left.real - here.real, left.imag - here.imag, stiffness, rest)
        below_x, below_y = spring_acceleration_2d(below.real - here.real, below.imag - here.imag, stiffness, rest)
        above_x, above_y = spring_acceleration_2d(above.real - here.real, above.imag - here.imag, stiffness, rest)
        return (right_x + left_x) + (below_x + above_x), (right_y + left_y) + (below_y + above_y)

    @device
    def uneven_pull(other, here, lower, parameters):
        """Return the pull on a mass at `here` from one at `other`, by a spring from row or column `lower` to the
        next."""
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        if lower & one:
            stiffness, rest = parameters.stiff, parameters.stiff_rest
        return spring_acceleration_2d(other.real - here.real, other.imag - here.imag, stiffness, rest)

    @device
    def uneven_spring_sum(position, k, cell, parameters):
        """Return the sum as `spring_sum`, with every second spring stiffer: those from odd rows and columns to the
        next."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        here = load_pair(position, k)
        left = load_pair(position, k - one if j > 0 else k)
        right = load_pair(position, k + one if j < columns - 1 else k)
        above = load_pair(position, k - columns if i > 0 else k)
        below = load_pair(position, k + columns if i < rows - 1 else k)
        right_x, right_y = uneven_pull(right, here, j, parameters)
        left_x, left_y = uneven_pull(left, here, j - one, parameters)
        below_x, below_y = uneven_pull(below, here, i, parameters)
        above_x, above_y = uneven_pull(above, here, i - one, parameters)
        return (right_x + left_x) + (below_x + above_x), (right_y + left_y) + (below_y + above_y)

    return uneven_spring_sum if {"springs", "alternating"} <= parts else spring_sum


@cache
def make_point_functions(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the device functions of a variant: `spring_sum`, `add_forces`, `damp`, and the integrator's formulas."""
    device = cuda.jit(device=True, **kernel_options(math))
    pulls = device_formulas(springs, real, math)
    spring_acceleration_2d, damped = pulls.spring_acceleration_2d, pulls.damped
    spring_sum = _make_spring_sum(real, device, spring_acceleration_2d, parts)
    formulas = device_formulas(integrators, real, math, {"damped": "damping" in parts})
    particle_force = make_particle_force(real, math, 2, parts)
    has_gravity, has_damping = "gravity" in parts, "damping" in parts
    changes, zero = particle_forces_change(parts), real(0)
    explicit_damping = has_damping and integrator != "velocity-verlet"
    no_step = np.int64(0)

    @device
    def add_gravity(ay, parameters):
        if has_gravity:
            ay = ay + parameters.gravity
        return ay

    @device
    def acceleration(ax, ay, velocity, k, parameters, integers, step):
        """Return the acceleration of mass k [m/s^2] from the springs' pulls (ax, ay); with the damper if the integrator
        applies it explicitly."""
        ay = add_gravity(ay, parameters)
        ax, ay = particle_force((ax, ay), k, zero, parameters, integers, step)
        if explicit_damping:
            ax = damped(ax, velocity.real, parameters.damping)
            ay = damped(ay, velocity.imag, parameters.damping)
        return ax, ay

    @device
    def current_step(counter, pass_number):
        """Return the number of the step, if anything depends on it."""
        if changes:
            return counter[0] + pass_number
        return no_step

    return SimpleNamespace(
        spring_sum=spring_sum, add_gravity=add_gravity, particle_force=particle_force,
        acceleration=acceleration, current_step=current_step, formulas=formulas, changes=changes,
        spring_acceleration_2d=spring_acceleration_2d, damped=damped,
    )  # fmt: skip


@cache
def make_moves(real: Real, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Callable]:
    """Make the motion of one mass in a pass: `step` of one-force integrators; `opening`, `middle`, `closing` of
    velocity Verlet.

    Each is move(k, ax, ay, p, v, parameters, integers, step) -> (px, py, vx, vy): (ax, ay) is the sum of the
    springs' pulls, p and v are the mass's own. `parameters` may be the record or its values in registers.
    """
    point = make_point_functions(real, math, integrator, parts)
    add_gravity, particle_force = point.add_gravity, point.particle_force
    acceleration, formulas, changes = point.acceleration, point.formulas, point.changes
    first_half, second_half = formulas.verlet_first_half, formulas.verlet_second_half
    verlet = integrator == "velocity-verlet"
    one_force = formulas.variant(step_formula(integrator))
    zero = real(0)
    device = cuda.jit(device=True, **kernel_options(math))

    @device
    def step_mass(k, ax, ay, p, v, parameters, integers, step):
        ax, ay = acceleration(ax, ay, v, k, parameters, integers, step)
        dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
        px, vx = one_force(p.real, v.real, ax, dt, half_dt_squared)
        py, vy = one_force(p.imag, v.imag, ay, dt, half_dt_squared)
        return px, py, vx, vy

    @device
    def opening_mass(k, ax, ay, p, v, parameters, integers, step):
        ax, ay = acceleration(ax, ay, v, k, parameters, integers, step)
        dt, half_dt, rate = parameters.dt, parameters.half_dt, parameters.damping
        px, vx = first_half(p.real, v.real, ax, dt, half_dt, rate)
        py, vy = first_half(p.imag, v.imag, ay, dt, half_dt, rate)
        return px, py, vx, vy

    @device
    def closing_mass(k, ax, ay, p, v, parameters, integers, step):
        ay = add_gravity(ay, parameters)
        ax, ay = particle_force((ax, ay), k, zero, parameters, integers, step - 1)
        half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
        vx = second_half(v.real, ax, half_dt, inverse_damping)
        vy = second_half(v.imag, ay, half_dt, inverse_damping)
        return p.real, p.imag, vx, vy

    @device
    def middle_mass(k, ax, ay, p, v, parameters, integers, step):
        """Do the second half kick of one step and the first of the next: both need the force here, computed once."""
        ay = add_gravity(ay, parameters)
        bx, by = ax, ay
        ax, ay = particle_force((ax, ay), k, zero, parameters, integers, step - 1)
        if changes:
            bx, by = particle_force((bx, by), k, zero, parameters, integers, step)
        else:
            bx, by = ax, ay
        half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
        whole_x = second_half(v.real, ax, half_dt, inverse_damping)
        whole_y = second_half(v.imag, ay, half_dt, inverse_damping)
        dt, rate = parameters.dt, parameters.damping
        px, vx = first_half(p.real, whole_x, bx, dt, half_dt, rate)
        py, vy = first_half(p.imag, whole_y, by, dt, half_dt, rate)
        return px, py, vx, vy

    if verlet:
        return {"opening": opening_mass, "middle": middle_mass, "closing": closing_mass}
    return {"step": step_mass}
