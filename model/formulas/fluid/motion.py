"""Motion of a fluid's particles apart from density: prediction, drag, and smoothing of velocities.

Viscosity as in XSPH, vorticity confinement: M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013 (eqs. 15
to 17); cohesion and the difference of normals: N. Akinci, G. Akinci and M. Teschner, "Versatile Surface Tension and
Adhesion for SPH Fluids", SIGGRAPH Asia 2013 (eqs. 1 to 5). Pair interactions conserve momentum: coefficients of a pair
are the mean of both, and its masses enter by the weights.

d is x_i - x_j as in model/formulas/fluid/density.py, t its `near`, s its `slope`. Sums follow the list's order.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from softlab.model.formulas import joined, plain

OPERATIONS_SHAPE = 40  # a neighbour: slope, three sums of normals, six of the curl
OPERATIONS_SMOOTH = 45  # a neighbour
OPERATIONS_VELOCITY = 20  # a particle


def make(real, compiled=plain):
    """Make the functions of single particles and of pairs in the arithmetic `real`."""
    zero, one, two, half = real(0), real(1), real(2), real(0.5)

    @compiled
    def accelerated(velocity, dt, acceleration):
        """Velocity [m/s] after an acceleration, one axis."""
        return velocity + dt * acceleration

    @compiled
    def buoyant(gravity, buoyancy):
        """Part of gravity [m/s^2] that acts on a fluid."""
        return gravity * buoyancy

    @compiled
    def speed_of(x, y, z):
        """Speed [m/s]."""
        return sqrt((x * x + y * y) + z * z)

    @compiled
    def slowed(velocity, speed, most):
        """Velocity limited to the speed `most`, one axis."""
        return velocity * (most / speed) if speed > most else velocity

    @compiled
    def drifted(position, velocity, dt):
        """Position [m] after dt, one axis."""
        return position + dt * velocity

    @compiled
    def wrapped_offset(position, low, high, side):
        """Offset [m] that wraps a coordinate on an axis that repeats from low to high."""
        if position < low:
            return side
        return -side if position >= high else zero

    @compiled
    def velocity_of(position, before, inverse_dt):
        """Velocity [m/s] from two positions, one axis."""
        return (position - before) * inverse_dt

    @compiled
    def limited_change(velocity, before, difference, most):
        """Velocity whose difference from that before the corrections (`before`) is limited to `most`, one axis.
        `difference`: length of the whole difference."""
        return before + (velocity - before) * (most / difference) if difference > most else velocity

    @compiled
    def braked(velocity, dt, drag, surface_drag, c):
        """Velocity after drag [1/s] and the surface's drag, one axis. The surface drag counts by the fraction by which
        the constraint c is negative."""
        fraction = min(max(-c, zero), one)
        return velocity / (one + dt * (drag + surface_drag * fraction))

    neighbours = make_pairs(real, compiled, half, two)
    alone = SimpleNamespace(
        accelerated=accelerated, buoyant=buoyant, speed_of=speed_of, slowed=slowed, drifted=drifted,
        wrapped_offset=wrapped_offset, velocity_of=velocity_of, limited_change=limited_change, braked=braked,
    )  # fmt: skip
    return joined(alone, neighbours)


def make_pairs(real, compiled, half, two):
    """Make the functions of pairs of neighbours in the arithmetic `real`."""
    zero, one, four = real(0), real(1), real(4)

    @compiled
    def smoothing_weight(t, viscosity, other_viscosity, weight, other_weight):
        """XSPH's fraction of a velocity difference that i takes from j.

        `viscosity`: of each fluid, including the kernel's scale; weights: w_i and w_j of the two fluids.
        """
        mean = half * (viscosity + other_viscosity)
        return (mean * ((two * weight) / (weight + other_weight))) * ((t * t) * t)

    @compiled
    def smooth_added(total, weight, velocity, other_velocity):
        """Sum of velocity differences plus that of a neighbour, one axis."""
        return total + weight * (other_velocity - velocity)

    @compiled
    def pull(squared_distance, inverse_support, cohesion, other_cohesion):
        """Change of velocity [1/s] over d by which j attracts i, for a particle of weight 1.

        Akinci's spline, scaled to a maximum of 1: 64 (1 - q)^3 q^3 beyond half of the support, twice that less 1
        within.
        """
        length = sqrt(squared_distance)
        q = length * inverse_support
        near = max(one - q, zero) * q
        spline = (four * near) * ((four * near) * (four * near))
        if q < half:
            spline = two * spline - one
        mean = half * (cohesion + other_cohesion)
        return mean * spline / length if length > zero and q < one else zero

    @compiled
    def pull_added(total, pull, d):
        """Sum plus the attraction towards j, one axis."""
        return total - pull * d

    @compiled
    def tension_added(total, tension, other_tension, n, other_n):
        """Sum plus the effect of different normals, which flattens a surface, one axis."""
        return total - (half * (tension + other_tension)) * (n - other_n)

    @compiled
    def smoothed(velocity, smoothing, weight, force):
        """Velocity after both sums, one axis. `weight`: the particle's."""
        return (velocity + smoothing) + weight * force

    @compiled
    def curl_added(total, s, da, db, va, vb, other_va, other_vb):
        """Sum of the vorticity [1/s], one axis, from its two other axes a and b in cyclic order: sum (v_j - v_i) x
        grad_i, grad_i = -s d."""
        return total - s * ((other_va - va) * db - (other_vb - vb) * da)

    @compiled
    def rise_added(total, s, d, length, other_length):
        """Sum of the gradient of the vorticity's length, one axis: sum (|w_j| - |w_i|) grad_j, up to scale."""
        return total - s * ((other_length - length) * d)

    @compiled
    def confined(total, strength, rise_length, ra, rb, wa, wb):
        """Sum plus vorticity confinement, one axis: strength N x w, from its two other axes a and b in cyclic order, N
        = rise / |rise|."""
        if rise_length > zero:
            return total + strength * ((ra * wb - rb * wa) / rise_length)
        return total

    return SimpleNamespace(
        smoothing_weight=smoothing_weight, smooth_added=smooth_added, pull=pull, pull_added=pull_added,
        tension_added=tension_added, smoothed=smoothed, curl_added=curl_added, rise_added=rise_added, confined=confined,
    )  # fmt: skip
