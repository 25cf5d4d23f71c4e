"""Springs, and the other point-wise accelerations: damper, external force."""

from __future__ import annotations

from math import sqrt

from model.formulas import plain

OPERATIONS_SPRING_2D = 12  # 2 differences, 3 for the square, 2 for 1/length, 2 for the scale, 2 products, 1 comparison


def make(real, compiled=plain):
    """Formulas of a spring in the arithmetic `real`: spring_pull_2d(dx, dy, stiffness, stiffness_rest) -> (x, y)."""
    zero = real(0)
    one = real(1)

    @compiled
    def inverse_length(squared):
        """1 / sqrt(squared); the CUDA backend replaces it in `fast` math by the approximate instruction."""
        return one / sqrt(squared)

    @compiled
    def spring_pull_2d(dx, dy, stiffness, stiffness_rest):
        """Pull on a mass whose neighbour lies at (dx, dy) [m]: Hooke's law, stiffness * (length - rest) along (dx, dy).

        `stiffness_rest` is stiffness * rest_length. With stiffness in N/m the result is a force [N]; with stiffness
        over mass [1/s^2] it is an acceleration [m/s^2], which is what the grid solvers pass. Written as
        (k - k L0 / length) * d: one root, one quotient. Exactly antisymmetric: the pull on the neighbour, computed from
        (-dx, -dy), is the exact negative in any rounding.

        Zero for coincident masses, whose direction is undefined (and where the squared length underflows).
        """
        squared = dx * dx + dy * dy
        if squared > zero:
            scale = stiffness - stiffness_rest * inverse_length(squared)
        else:
            scale = zero
        return scale * dx, scale * dy

    @compiled
    def damped(acceleration, velocity, rate):
        """Acceleration with a damper of rate = coefficient / mass [1/s] on the mass: a - rate * v."""
        return acceleration - rate * velocity

    return spring_pull_2d, damped
