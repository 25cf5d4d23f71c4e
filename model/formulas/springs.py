"""Springs, and the other point-wise accelerations: damper, external force."""

from __future__ import annotations

from model.formulas import plain
from model.formulas.lengths import make as make_lengths

OPERATIONS_SPRING_2D = 12  # 2 differences, 3 for the square, 2 for 1/length, 2 for the scale, 2 products, 1 comparison


def make(real, compiled=plain):
    """Formulas of a spring in the arithmetic `real`: spring_acceleration_2d(dx, dy, stiffness, stiffness_rest) -> (x, y)."""
    lengths = make_lengths(real, compiled)
    squared_length, inverse_length = lengths.squared_length, lengths.inverse_length

    @compiled
    def spring_acceleration_2d(dx, dy, stiffness, stiffness_rest):
        """Pull on a mass whose neighbour lies at (dx, dy) [m]: Hooke's law, stiffness * (length - rest) along (dx, dy).

        `stiffness_rest` is stiffness * rest_length. With stiffness in N/m the result is a force [N]; with stiffness
        over mass [1/s^2] it is an acceleration [m/s^2], which is what the grid solvers pass. Written as
        (k - k L0 / length) * d: one root, one quotient. Exactly antisymmetric: the pull on the neighbour, computed from
        (-dx, -dy), is the exact negative in any rounding.

        Zero for coincident masses, whose direction is undefined: there both differences are 0.
        """
        scale = stiffness - stiffness_rest * inverse_length(squared_length(dx, dy))
        return scale * dx, scale * dy

    @compiled
    def damped(acceleration, velocity, rate):
        """Acceleration with a damper of rate = coefficient / mass [1/s] on the mass: a - rate * v."""
        return acceleration - rate * velocity

    return spring_acceleration_2d, damped
