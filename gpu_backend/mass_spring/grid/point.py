"""Operations on one mass: its forces, and its motion in each pass of an integrator.

Each thread sums the pulls of its four neighbours. Sums are computed as on the CPU: (right + left) + (below + above),
then gravity, external, poke, damping. A neighbour beyond the edge is replaced by the mass itself, whose
pull on itself is zero: no branch at the edges. Kernels are compiled for the parts of a scene: an absent part leaves no
instruction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.gpu_backend.core.forces import particle_force, with_forces
from softlab.gpu_backend.core.pairs import load_pair
from softlab.model.base.types import Feature
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.core.integrators import step_formula
from softlab.model.formulas.integrators import one_force, verlet_first_half, verlet_second_half
from softlab.model.formulas.springs import damped, spring_acceleration_2d
from softlab.model.mass_spring.plan import sheet_features

ONE, NO_STEP = np.int32(1), np.int64(0)


@inlined_routine
def pair(number):
    """Return a number as the complex number of both axes."""
    if FEATURE.single:
        return np.complex64(number)
    return np.complex128(number)


@routine
def uneven_pull(other, here, lower, parameters):
    """Return the pull on a mass at `here` from one at `other`, by a spring from row or column `lower` to the next."""
    stiffness, rest = parameters.stiffness, parameters.stiffness_rest
    if lower & ONE:
        stiffness, rest = parameters.stiff, parameters.stiff_rest
    return spring_acceleration_2d(other.real - here.real, other.imag - here.imag, stiffness, rest)


@routine
def spring_sum(position, k, cell, parameters):
    """Return the sum of the four pulls over mass [m/s^2] on mass k = i * columns + j, (0, 0) in a scene without
    springs. Where springs alternate, those from odd rows and columns to the next are stiffer."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    if not FEATURE.springs:
        return 0.0, 0.0
    here = load_pair(position, k)
    left = load_pair(position, k - ONE if j > 0 else k)
    right = load_pair(position, k + ONE if j < columns - 1 else k)
    above = load_pair(position, k - columns if i > 0 else k)
    below = load_pair(position, k + columns if i < rows - 1 else k)
    if FEATURE.alternating:
        right_x, right_y = uneven_pull(right, here, j, parameters)
        left_x, left_y = uneven_pull(left, here, j - ONE, parameters)
        below_x, below_y = uneven_pull(below, here, i, parameters)
        above_x, above_y = uneven_pull(above, here, i - ONE, parameters)
    else:
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        right_x, right_y = spring_acceleration_2d(right.real - here.real, right.imag - here.imag, stiffness, rest)
        left_x, left_y = spring_acceleration_2d(left.real - here.real, left.imag - here.imag, stiffness, rest)
        below_x, below_y = spring_acceleration_2d(below.real - here.real, below.imag - here.imag, stiffness, rest)
        above_x, above_y = spring_acceleration_2d(above.real - here.real, above.imag - here.imag, stiffness, rest)
    return (right_x + left_x) + (below_x + above_x), (right_y + left_y) + (below_y + above_y)


@routine
def add_gravity(ay, parameters):
    if FEATURE.gravity:
        ay = ay + parameters.gravity
    return ay


@routine
def acceleration(ax, ay, velocity, k, parameters, integers, step):
    """Return the acceleration of mass k [m/s^2] from the springs' pulls (ax, ay); with the damper if the integrator
    applies it explicitly."""
    ay = add_gravity(ay, parameters)
    ax, ay = particle_force((ax, ay), k, 0.0, parameters, integers, step)
    if FEATURE.damped and not FEATURE.verlet:
        ax = damped(ax, velocity.real, parameters.damping)
        ay = damped(ay, velocity.imag, parameters.damping)
    return ax, ay


@routine
def current_step(counter, pass_number):
    """Return the number of the step, if anything depends on it."""
    if FEATURE.changing:
        return counter[0] + pass_number
    return NO_STEP


@routine
def step_mass(k, ax, ay, p, v, parameters, integers, step):
    ax, ay = acceleration(ax, ay, v, k, parameters, integers, step)
    dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
    px, vx = one_force(p.real, v.real, ax, dt, half_dt_squared)
    py, vy = one_force(p.imag, v.imag, ay, dt, half_dt_squared)
    return px, py, vx, vy


@routine
def opening_mass(k, ax, ay, p, v, parameters, integers, step):
    ax, ay = acceleration(ax, ay, v, k, parameters, integers, step)
    dt, half_dt, rate = parameters.dt, parameters.half_dt, parameters.damping
    px, vx = verlet_first_half(p.real, v.real, ax, dt, half_dt, rate)
    py, vy = verlet_first_half(p.imag, v.imag, ay, dt, half_dt, rate)
    return px, py, vx, vy


@routine
def closing_mass(k, ax, ay, p, v, parameters, integers, step):
    ay = add_gravity(ay, parameters)
    ax, ay = particle_force((ax, ay), k, 0.0, parameters, integers, step - 1)
    half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
    vx = verlet_second_half(v.real, ax, half_dt, inverse_damping)
    vy = verlet_second_half(v.imag, ay, half_dt, inverse_damping)
    return p.real, p.imag, vx, vy


@routine
def middle_mass(k, ax, ay, p, v, parameters, integers, step):
    """Do the second half kick of one step and the first of the next: both need the force here, computed once."""
    ay = add_gravity(ay, parameters)
    bx, by = ax, ay
    ax, ay = particle_force((ax, ay), k, 0.0, parameters, integers, step - 1)
    if FEATURE.changing:
        bx, by = particle_force((bx, by), k, 0.0, parameters, integers, step)
    else:
        bx, by = ax, ay
    half_dt, inverse_damping = parameters.half_dt, parameters.inverse_damping
    whole_x = verlet_second_half(v.real, ax, half_dt, inverse_damping)
    whole_y = verlet_second_half(v.imag, ay, half_dt, inverse_damping)
    dt, rate = parameters.dt, parameters.damping
    px, vx = verlet_first_half(p.real, whole_x, bx, dt, half_dt, rate)
    py, vy = verlet_first_half(p.imag, whole_y, by, dt, half_dt, rate)
    return px, py, vx, vy


def of_scene(kernel: Callable, integrator: str, parts: frozenset[str]) -> Callable:
    """Return a kernel with the forces of a scene and the formula of an integrator."""
    return with_forces(filled(kernel, {"one_force": step_formula(integrator)}), parts)


def grid_features(integrator: str, parts: frozenset[str]) -> dict[str, Feature]:
    """Return the features of a grid's kernels."""
    return {**sheet_features(integrator, parts), "axes": 2}


def moves_of(integrator: str, parts: frozenset[str]) -> dict[str, Callable]:
    """Return the motion of one mass by the name of the pass: `step` of one-force integrators; `opening`, `middle`,
    `closing` of velocity Verlet.

    Each is move(k, ax, ay, p, v, parameters, integers, step) -> (px, py, vx, vy): (ax, ay) is the sum of the
    springs' pulls, p and v are the mass's own. `parameters` may be the record or its values in registers.
    """
    moves: dict[str, Callable] = {"step": step_mass}
    if integrator == "velocity-verlet":
        moves = {"opening": opening_mass, "middle": middle_mass, "closing": closing_mass}
    return {name: of_scene(move, integrator, parts) for name, move in moves.items()}
