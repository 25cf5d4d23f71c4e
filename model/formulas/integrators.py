"""The time steps, one axis of one mass at a time: (position, velocity, acceleration) -> (position, velocity).

Orders are of the error at a fixed time against Newton's law. Limits are for x'' = -w^2 x - gamma x' with the damper
evaluated at the step's start (velocity Verlet: implicit in the second half kick); model/core/integrators.py computes
them. Sources: Hairer, Lubich and Wanner, "Geometric numerical integration", 2nd ed. (2006), I.1 (Euler methods,
Verlet); Swope, Andersen, Berens and Wilson (1982) for the velocity form; Kutta (1901) for RK4; the step called `lab` is
the hand-out's, the one called `taylor` the compute-shader cloth's.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, Open, formula

one_force = Open(
    "one_force(position, velocity, acceleration, dt, half_dt_squared): a step after one evaluation of forces"
)


@formula
def difference(a, b):
    """a - b, rounded. A backend whose fast math would cancel terms of `a` replaces it by an instruction that does
    not."""
    return a - b


@formula
def quotient(a, b):
    """a / b. In `fast` math a backend may replace it by a product with 1 / b, which is the same for every mass."""
    return a / b


@formula
def lab(position, velocity, acceleration, dt, half_dt_squared):
    """The hand-out's step, unchanged: p' = p + v dt + a dt^2/2, v' = (p' - p)/dt.

    It integrates half of the acceleration (it is semi-implicit Euler for doubled masses): order 0 against Newton's
    law, order 1 against x'' = a/2. Limit: dt^2 w^2 + 2 dt gamma < 8 and dt gamma < 4. In float32 the subtraction p'
    - p loses the velocity's digits far from the origin; that is part of the method, and both maths preserve it.
    """
    new_position = position + velocity * dt + acceleration * half_dt_squared
    return new_position, quotient(difference(new_position, position), dt)


@formula
def semi_implicit_euler(position, velocity, acceleration, dt, half_dt_squared):
    """v' = v + a dt, p' = p + v' dt. Order 1, symplectic. Limit: dt^2 w^2 + 2 dt gamma < 4 and dt gamma < 2."""
    new_velocity = velocity + acceleration * dt
    return position + new_velocity * dt, new_velocity


@formula
def explicit_euler(position, velocity, acceleration, dt, half_dt_squared):
    """p' = p + v dt, v' = v + a dt. Order 1. Limit: dt < gamma / w^2 (never stable without damping)."""
    return position + velocity * dt, velocity + acceleration * dt


@formula
def taylor(position, velocity, acceleration, dt, half_dt_squared):
    """p' = p + v dt + a dt^2/2, v' = v + a dt. Order 1. Limit: dt < 2 gamma / w^2 (never without damping)."""
    return position + velocity * dt + acceleration * half_dt_squared, velocity + acceleration * dt


@formula
def verlet_first_half(position, velocity, acceleration, dt, half_dt, rate):
    """First half of velocity Verlet: v+ = v + dt/2 (a - rate v), p' = p + dt v+. Returns (p', v+).

    With `verlet_second_half`: order 2 with damping too, symplectic without. Limit: dt w < 2.
    """
    if FEATURE.damped:
        acceleration = acceleration - rate * velocity
    half_velocity = velocity + half_dt * acceleration
    return position + half_velocity * dt, half_velocity


@formula
def verlet_second_half(half_velocity, acceleration, half_dt, inverse_damping):
    """Second half: v' = (v+ + dt/2 a') / (1 + dt rate / 2), a' at the new positions, the damper implicit.

    An explicit damper here would silently make the scheme first order.
    """
    velocity = half_velocity + half_dt * acceleration
    if FEATURE.damped:
        velocity = velocity * inverse_damping
    return velocity


@formula
def rk4_stage(base, rate, total, derivative_dt, total_dt):
    """One stage of the classical Runge-Kutta method for one unknown whose derivative is `rate`.

    Returns (base + derivative_dt * rate, total + total_dt * rate): the next stage's value and the running sum.
    Order 4; not symplectic. Limit: |R(dt lambda)| <= 1, R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24 (dt w < 2 sqrt 2
    undamped).
    """
    return base + derivative_dt * rate, total + total_dt * rate
