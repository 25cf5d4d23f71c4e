"""Motion of a fluid's particles apart from density: prediction, drag, and smoothing of velocities.

Viscosity as in XSPH, vorticity confinement: M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013 (eqs. 15
to 17); cohesion and the difference of normals: N. Akinci, G. Akinci and M. Teschner, "Versatile Surface Tension and
Adhesion for SPH Fluids", SIGGRAPH Asia 2013 (eqs. 1 to 5). Pair interactions conserve momentum: coefficients of a pair
are the mean of both, and its masses enter by the weights.

d is x_i - x_j as in model/formulas/fluid/density.py, t its `near`, s its `slope`. Sums follow the list's order.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula

OPERATIONS_SHAPE = 40  # a neighbour: slope, three sums of normals, six of the curl
OPERATIONS_SMOOTH = 45  # a neighbour
OPERATIONS_VELOCITY = 20  # a particle


@formula
def accelerated(velocity, dt, acceleration):
    """Velocity [m/s] after an acceleration, one axis."""
    return velocity + dt * acceleration


@formula
def buoyant(gravity, buoyancy):
    """Part of gravity [m/s^2] that acts on a fluid."""
    return gravity * buoyancy


@formula
def speed_of(x, y, z):
    """Speed [m/s]."""
    return sqrt((x * x + y * y) + z * z)


@formula
def slowed(velocity, speed, most):
    """Velocity limited to the speed `most`, one axis."""
    return velocity * (most / speed) if speed > most else velocity


@formula
def drifted(position, velocity, dt):
    """Position [m] after dt, one axis."""
    return position + dt * velocity


@formula
def wrapped_offset(position, low, high, side):
    """Offset [m] that wraps a coordinate on an axis that repeats from low to high."""
    if position < low:
        return side
    return -side if position >= high else 0.0


@formula
def velocity_of(position, before, inverse_dt):
    """Velocity [m/s] from two positions, one axis."""
    return (position - before) * inverse_dt


@formula
def limited_change(velocity, before, difference, most):
    """Velocity whose difference from that before the corrections (`before`) is limited to `most`, one axis.
    `difference`: length of the whole difference."""
    return before + (velocity - before) * (most / difference) if difference > most else velocity


@formula
def braked(velocity, dt, drag, surface_drag, c):
    """Velocity after drag [1/s] and the surface's drag, one axis. The surface drag counts by the fraction by which
    the constraint c is negative."""
    fraction = min(max(-c, 0.0), 1.0)
    return velocity / (1.0 + dt * (drag + surface_drag * fraction))


@formula
def smoothing_weight(t, viscosity, other_viscosity, weight, other_weight):
    """XSPH's fraction of a velocity difference that i takes from j.

    `viscosity`: of each fluid, including the kernel's scale; weights: w_i and w_j of the two fluids.
    """
    mean = 0.5 * (viscosity + other_viscosity)
    return (mean * ((2.0 * weight) / (weight + other_weight))) * ((t * t) * t)


@formula
def smooth_added(total, weight, velocity, other_velocity):
    """Sum of velocity differences plus that of a neighbour, one axis."""
    return total + weight * (other_velocity - velocity)


@formula
def pull(squared_distance, inverse_support, cohesion, other_cohesion):
    """Change of velocity [1/s] over d by which j attracts i, for a particle of weight 1.

    Akinci's spline, scaled to a maximum of 1: 64 (1 - q)^3 q^3 beyond half of the support, twice that less 1
    within.
    """
    length = sqrt(squared_distance)
    q = length * inverse_support
    near = max(1.0 - q, 0.0) * q
    spline = (4.0 * near) * ((4.0 * near) * (4.0 * near))
    if q < 0.5:
        spline = 2.0 * spline - 1.0
    mean = 0.5 * (cohesion + other_cohesion)
    return mean * spline / length if length > 0.0 and q < 1.0 else 0.0


@formula
def pull_added(total, pull, d):
    """Sum plus the attraction towards j, one axis."""
    return total - pull * d


@formula
def tension_added(total, tension, other_tension, n, other_n):
    """Sum plus the effect of different normals, which flattens a surface, one axis."""
    return total - (0.5 * (tension + other_tension)) * (n - other_n)


@formula
def smoothed(velocity, smoothing, weight, force):
    """Velocity after both sums, one axis. `weight`: the particle's."""
    return (velocity + smoothing) + weight * force


@formula
def curl_added(total, s, da, db, va, vb, other_va, other_vb):
    """Sum of the vorticity [1/s], one axis, from its two other axes a and b in cyclic order: sum (v_j - v_i) x
    grad_i, grad_i = -s d."""
    return total - s * ((other_va - va) * db - (other_vb - vb) * da)


@formula
def rise_added(total, s, d, length, other_length):
    """Sum of the gradient of the vorticity's length, one axis: sum (|w_j| - |w_i|) grad_j, up to scale."""
    return total - s * ((other_length - length) * d)


@formula
def confined(total, strength, rise_length, ra, rb, wa, wb):
    """Sum plus vorticity confinement, one axis: strength N x w, from its two other axes a and b in cyclic order, N
    = rise / |rise|."""
    if rise_length > 0.0:
        return total + strength * ((ra * wb - rb * wa) / rise_length)
    return total
