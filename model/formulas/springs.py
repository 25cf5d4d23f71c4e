"""Springs in a plane and in space; dampers of a mass and along a spring."""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import inverse_length, squared_length, squared_length_3d

OPERATIONS_SPRING_2D = 12  # 2 differences, 3 for the square, 2 for 1/length, 2 for the scale, 2 products, 1 comparison
OPERATIONS_SPRING = 15  # in space: 3 differences, 5 for the square, 2 for 1/length, 2 for the scale, 3 products
OPERATIONS_DAMPER = 12  # 3 differences, 5 for the product of speed and vector, 4 for its scale


@formula
def spring_acceleration_2d(dx, dy, stiffness, stiffness_rest):
    """Pull on a mass whose neighbour lies at (dx, dy) [m]: Hooke's law, stiffness * (length - rest) along (dx, dy).

    `stiffness_rest` is stiffness * rest_length. With stiffness in N/m the result is a force [N]; with stiffness over
    mass [1/s^2] it is an acceleration [m/s^2], as used by the grid solvers. Written as (k - k L0 / length) * d: one
    root, one quotient. Exactly antisymmetric: the pull on the neighbour, computed from (-dx, -dy), is the exact
    negative in any rounding.

    Zero for coincident masses, whose direction is undefined: there both differences are 0.
    """
    scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy))
    return scale * dx, scale * dy


@formula
def damped(acceleration, velocity, rate):
    """Acceleration with a damper of rate = coefficient / mass [1/s] on the mass: a - rate * v."""
    return acceleration - rate * velocity


@formula
def spring_acceleration_3d(dx, dy, dz, stiffness, stiffness_rest):
    """Pull over mass [m/s^2] on a mass whose neighbour lies at d [m]: (k - k L0 / |d|) d, k stiffness over mass.

    `stiffness_rest` is k L0. Zero for coincident masses; exactly antisymmetric in any rounding.
    """
    scale = stiffness - stiffness_rest * inverse_length(squared_length_3d(dx, dy, dz))
    return scale * dx, scale * dy, scale * dz


@formula
def damped_pull_3d(dx, dy, dz, wx, wy, wz, stiffness, stiffness_rest, damping):
    """Pull as by `spring_acceleration_3d` plus that of a damper along the spring: + damping (w.d / |d|^2) d.

    w: the neighbour's velocity minus the own one; `damping`: coefficient over mass [1/s].
    """
    inverse = inverse_length(squared_length_3d(dx, dy, dz))
    speed = ((wx * dx + wy * dy) + wz * dz) * inverse  # at which the spring lengthens
    scale = (stiffness - stiffness_rest * inverse) + damping * speed * inverse
    return scale * dx, scale * dy, scale * dz
