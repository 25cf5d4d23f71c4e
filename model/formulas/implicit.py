"""Implicit Euler on springs: the matrix of a Newton step per spring, conjugate gradients, and the order of passes.

D. Baraff and A. Witkin, "Large steps in cloth simulation", SIGGRAPH 1998 (the step); K.-J. Choi and H.-S. Ko, "Stable
but responsive cloth", SIGGRAPH 2002 (a compressed spring has no transverse stiffness, so that the matrix stays
definite); A. Chronopoulos and C. W. Gear, "s-step iterative methods for symmetric linear systems", J. Comput. Appl.
Math. 25 (1989) (conjugate gradients with one sum over all masses per iteration, instead of two); S. C. Eisenstat and H.
F. Walker, "Choosing the forcing terms in an inexact Newton method", SIAM J. Sci. Comput. 17 (1996), choice 2; J.
Nocedal and S. Wright, "Numerical optimization" (2006), eq. 3.7b, its upper half (when a step is too long).

The unknowns are the velocities u at the step's end, over the mass. No eigenvalue of the matrix A is below 1: the norm
of a residual bounds the error of the velocity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.lengths import inverse_length, squared_length_3d

OPERATIONS_PRODUCT = 30  # a spring: 6 differences, 5 for the square, 5 for the speed, 6 for the scales, 8 for the sum
OPERATIONS_DOT = 6
OPERATIONS_UPDATE = 8  # per axis

# The passes of a step over the sheet. Sums over all masses follow RESIDUAL (r.r, r.s, u.u) and PRODUCT (r.r, r.w).
START = 0  # v + dt (forces without springs and dampers), x = p, u = 0, with x the position without u
RESIDUAL = 1  # r at x, u
PRODUCT = 2  # w = A r
UPDATE = 3  # directions q, A q, the solution s, and r
MOVE = 4  # u + s, x
RETREAT = 5  # s / 2; u - s, x
FINISH = 6  # p, v from x, u; colliders

DONE = ("steps", "matrices", "iterations", "halvings")  # counters of a simulation
STEPS, MATRICES, ITERATIONS, HALVINGS = range(len(DONE))

MAX_NEWTON = 50  # matrices a step
MAX_ITERATIONS = 5000  # of conjugate gradients, for one matrix
MAX_HALVINGS = 10  # of a Newton step
NEWTON_TOLERANCE = 1e-8  # of the step's first residual
LINEAR_TOLERANCE = 1e-6  # of the residual, where one matrix is all
LOOSEST = 1e-2  # fraction of a residual that conjugate gradients may leave to the next Newton step
FORCING = 0.9
OVERSHOOT = 0.9  # fraction of the slope that may have changed sign at a Newton step's end

MOST_LEFT = LOOSEST**2
LEAST_LEFT = LINEAR_TOLERANCE**2
TOLERANCE = NEWTON_TOLERANCE**2
FORCING_SQUARE = FORCING**2
NONE, ONE = np.int64(0), np.int64(1)


@formula
def product_3d(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping):
    """-B (own - other) of a spring: the product of its matrix with w.

    w: the other end's entry of a vector minus the own one; n = d / |d|. The result is (dt^2 k [n n^T + max(0, 1 -
    L0 / |d|) (I - n n^T)] + dt c n n^T) w, all over the mass. `stiffness`: dt^2 k; `stiffness_rest`: dt^2 k L0;
    `damping`: dt c. Exactly antisymmetric in any rounding.
    """
    inverse = inverse_length(squared_length_3d(dx, dy, dz))
    across = max(0.0, stiffness - stiffness_rest * inverse)
    along = ((stiffness + damping) - across) * ((((wx * dx + wy * dy) + wz * dz) * inverse) * inverse)
    return across * wx + along * dx, across * wy + along * dy, across * wz + along * dz


@formula
def end_pull_3d(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping, dt):
    """Pull over mass [m/s^2] of a spring with a damper at the step's end.

    d: vector to its other end at the start; w: that end's velocity minus the own one. It uses differences, since
    coordinates p + dt u far from the origin would lose more digits.
    """
    dx, dy, dz = dx + dt * wx, dy + dt * wy, dz + dt * wz
    inverse = inverse_length(squared_length_3d(dx, dy, dz))
    speed = ((wx * dx + wy * dy) + wz * dz) * inverse
    scale = (stiffness - stiffness_rest * inverse) + damping * speed * inverse
    return scale * dx, scale * dy, scale * dz


@formula
def residual(begin, velocity, acceleration, dt, dt_rate):
    """Residual of u = begin + dt a - dt rate u, one axis [m/s]. `begin`: v + dt (forces at the step's start)."""
    return ((begin - velocity) + dt * acceleration) - dt_rate * velocity


@formula
def applied(entry, pulls, diagonal):
    """A times the entry, one axis. `pulls`: the sum of `product_3d` over the springs; `diagonal`: 1 + dt rate."""
    return diagonal * entry - pulls


@formula
def added(value, factor, other):
    """value + factor other, one axis."""
    return value + factor * other


class Counts(NamedTuple):
    """Integers between passes: matrices of a step, halvings of a Newton step, iterations for this matrix."""

    matrices: int | np.int64
    halvings: int | np.int64
    iterations: int | np.int64


class Values(NamedTuple):
    """Numbers between passes: squared norms of the step's first residual, of the previous one, and the target of the
    iterations; r.s of the last step; of conjugate gradients r.r, alpha and beta."""

    first: float
    before: float
    limit: float
    slope: float
    squared: float
    alpha: float
    beta: float


@formula
def noise(velocity_squared, springs_squared, roundoff):
    """Squared norm [m^2/s^2] of the rounding error of a residual.

    Half a unit in the last place of the velocities (`u.u`) and of the velocity that a mass's springs would add in a
    step if they were twice as long (`springs_squared`, of all masses).
    """
    return roundoff * roundoff * (springs_squared + velocity_squared)


@formula
def after_residual(counts, values, sums, springs_squared, roundoff):
    """Return (next pass, Counts, Values) for a known residual. A Newton step that went too far is halved. The solution
    has converged if the residual is below NEWTON_TOLERANCE of the step's first or is rounding (`noise`).
    """
    newton, halvings, v = counts.matrices, counts.halvings, values
    squared, along, velocity_squared = sums
    if newton > 0 and halvings < MAX_HALVINGS and along < -(OVERSHOOT * v.slope):
        halved = Values(v.first, v.before, v.limit, 0.5 * v.slope, v.squared, v.alpha, v.beta)
        return RETREAT, Counts(newton, halvings + ONE, NONE), halved
    first = v.first
    most_left = LEAST_LEFT if FEATURE.linear else MOST_LEFT
    left = most_left
    if newton == 0:
        first = squared
    elif squared < v.before:
        left = min(most_left, max(LEAST_LEFT, FORCING_SQUARE * (squared / v.before) * (squared / v.before)))
    rounding = noise(velocity_squared, springs_squared, roundoff)
    kind = FINISH
    if squared > max(TOLERANCE * first, rounding) and newton < (1 if FEATURE.linear else MAX_NEWTON):
        kind = PRODUCT
    limit = max(left * squared, 0.01 * rounding)
    return kind, Counts(newton, NONE, NONE), Values(first, squared, limit, 0.0, 0.0, 0.0, 0.0)


@formula
def after_product(counts, values, squared, curvature):
    """Return (next pass, Counts, Values) for known r.r and r.A r: conjugate gradients continue, or their sum is
    applied."""
    newton, halvings, iterations = counts
    v, beta, divisor = values, 0.0, curvature
    if iterations > 0:
        beta = squared / v.squared
        divisor = curvature - beta * squared / v.alpha
    if squared > v.limit and divisor > 0.0 and iterations < MAX_ITERATIONS:
        alpha = squared / divisor
        slope = v.slope + alpha * squared  # r.s with the residual at the start of conjugate gradients
        later = Values(v.first, v.before, v.limit, slope, squared, alpha, beta)
        return UPDATE, Counts(newton, halvings, iterations + ONE), later
    kind = FINISH if iterations == 0 else MOVE
    later = Values(v.first, v.before, v.limit, v.slope, v.squared, v.alpha, beta)
    return kind, Counts(newton + ONE, NONE, iterations), later
