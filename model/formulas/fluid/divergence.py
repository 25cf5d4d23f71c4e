"""A fluid that conserves its density by velocities: divergences, predicted densities, and the solves for both.

J. Bender and D. Koschier, "Divergence-Free SPH for Incompressible and Viscous Fluids", TVCG 2017 (SCA 2015): one
pressure removes the change of density, another the predicted excess of density. Both solves look for the smallest
multiplier that is never positive and makes c = target + (contribution of `shift` to C) at most 0; a shift [m] is dt
times a change of velocity. Gradients, factors and the effect of a multiplier on two neighbours are those of
model/formulas/fluid/density.py. An iteration is the paper's Jacobi iteration from an extrapolation of the last two
iterates: Y. Nesterov's acceleration, projected as by A. Beck and M. Teboulle (SIAM J. Imaging Sciences 2009, eqs. 4.1
to 4.3).

d is x_i - x_j, e the difference of their shifts or velocities. Sums follow the list's order.
"""

from __future__ import annotations

from softlab.model.base.variant import formula, real

OPERATIONS_APPROACH = 27  # a neighbour: slope, and the difference of velocities along it
OPERATIONS_MOVE = 20  # a particle
SPARSE = (
    0.09  # of density: a particle that lacks more is at a surface and may approach freely; a surface layer lacks 0.12
)


@formula
def approach_added(total, s, dx, dy, dz, ex, ey, ez):
    """Sum of grad_j C_i . e plus that of a neighbour; s: `slope`."""
    return total - s * ((dx * ex + dy * ey) + dz * ez)


@formula
def approach_of_wall(total, wx, wy, wz, x, y, z):
    """Sum plus the walls' contribution, which comes last. w: their gradient; (x, y, z): the particle's shift or
    velocity."""
    return total + ((wx * x + wy * y) + wz * z)


@formula
def compressed(c, approach, dt, came):
    """Target of the first solve: the increase of density in a substep.

    `came`: the part of it from moving walls. A particle that lacks more than SPARSE of its density counts as
    isolated.
    """
    return dt * approach + came if c > -SPARSE else -1.0


@formula
def foreseen(c, approach, dt):
    """Target of the second solve: C at the substep's end."""
    return c + dt * approach


@formula
def pressed(ahead, factor, c):
    """Next iterate, from `ahead`, at which the constraint has the value c."""
    return min(ahead - factor * c, 0.0)


@formula
def lead(turn, iterations):
    """Extrapolation factor for the next iteration: times the difference of the last two iterates. It is 0 after the
    last one."""
    return real(turn) / (real(turn) + 3.0) if turn + 1 < iterations else 0.0


@formula
def led(now, before, lead):
    """Starting point of the next iteration."""
    return now + lead * (now - before)


@formula
def gained(velocity, shift, inverse_dt):
    """Velocity after a solve, one axis."""
    return velocity + shift * inverse_dt
