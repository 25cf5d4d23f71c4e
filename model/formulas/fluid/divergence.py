"""A fluid that keeps its density by velocities: divergences, densities that are foreseen, and how both are solved for.

J. Bender and D. Koschier, "Divergence-Free SPH for Incompressible and Viscous Fluids", TVCG 2017 (SCA 2015): a pressure that
takes away how densities change, and one that takes away what they are about to be too much. Both ask for the least
multiplier that is never positive and makes c = target + (what `shift` adds to C) no more than 0; a shift [m] is dt times a
change of velocity. Gradients, factors and what a multiplier does to two neighbours are those of
model/formulas/fluid/density.py. An iteration is the paper's, of Jacobi, from where the last two iterates lead to: Y.
Nesterov's acceleration, projected as A. Beck and M. Teboulle (SIAM J. Imaging Sciences 2009, eqs. 4.1 to 4.3) do.

d is x_i - x_j, e the difference of their shifts or velocities; sums go in the order of the list.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

OPERATIONS_APPROACH = 27  # a neighbour: slope, and a difference of velocities along it
OPERATIONS_MOVE = 20  # a particle
SPARSE = (
    0.09  # of density: a particle that lacks more is at a surface and may approach freely; a surface layer lacks 0.12
)


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero, one, three, sparse = real(0), real(1), real(3), real(SPARSE)

    @compiled
    def approach_added(total, s, dx, dy, dz, ex, ey, ez):
        """The sum of grad_j C_i . e; s: `slope`."""
        return total - s * ((dx * ex + dy * ey) + dz * ez)

    @compiled
    def approach_of_wall(total, wx, wy, wz, x, y, z):
        """The wall's part, which comes last; w: its gradient, (x, y, z): the particle's own shift or velocity."""
        return total + ((wx * x + wy * y) + wz * z)

    @compiled
    def compressed(c, approach, dt, came):
        """The target of the first solve: by what density grows in a substep; `came`: of it what moving walls add. Who
        lacks more than SPARSE of it is as good as alone."""
        return dt * approach + came if c > -sparse else -one

    @compiled
    def foreseen(c, approach, dt):
        """The target of the second one: C at the substep's end."""
        return c + dt * approach

    @compiled
    def pressed(ahead, factor, c):
        """An iterate: from `ahead`, at which c is what it is."""
        return min(ahead - factor * c, zero)

    @compiled
    def lead(turn, iterations):
        """How much of the way from the last iterate to this one the next goes on; the last one does not."""
        return real(turn) / (real(turn) + three) if turn + 1 < iterations else zero

    @compiled
    def led(now, before, lead):
        """Where the next iteration starts."""
        return now + lead * (now - before)

    @compiled
    def gained(velocity, shift, inverse_dt):
        """One axis of a velocity after a solve."""
        return velocity + shift * inverse_dt

    return SimpleNamespace(
        approach_added=approach_added, approach_of_wall=approach_of_wall, compressed=compressed, foreseen=foreseen,
        pressed=pressed, lead=lead, led=led, gained=gained,
    )  # fmt: skip
