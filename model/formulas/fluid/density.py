"""The density constraint of a fluid: kernels, walls, multipliers, corrections.

C_i = scale (sum_j (1 - q)^3 - lattice sum) + wall <= 0, q = r / support: the relative error of the number of particles
around i, which is the same for fluids of several densities (B. Solenthaler and R. Pajarola, "Density Contrast SPH
Interfaces", SCA 2008). C is 0 on the starting lattice, and a small dilatation e changes C by -3 e there. Multipliers and
corrections: M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013 (eqs. 8 to 14). The multiplier of all
iterations of a substep together is never positive: a fluid pushes and does not pull.

The correction must follow the exact gradient of C. Then it does no work along motions that keep C, and water at rest gains no
energy. The paper takes density from one kernel (poly6) and the gradient from another (spiky); that force is not conservative
and makes water at rest boil, the faster the shorter the substep. Here both are the spiky kernel's, (1 - q)^3.

A wall adds scale (1 - distance / range)^3. The layer of the lattice next to it, half a rest distance away, lacks
nothing then, and is pushed by the wall as by its neighbours on the other side. (In place of particles there: N. Akinci et
al., "Versatile Rigid-Fluid Coupling", SIGGRAPH 2012.)

d is always x_i - x_j, of particle i and its neighbour j; a sum over neighbours begins at 0 and goes in the order of the list.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import joined, plain
from model.formulas.lengths import make as make_lengths

OPERATIONS_FIND = 9  # a particle that is looked at: the distance's square and its comparison
OPERATIONS_DENSITY = 15  # a neighbour: the distance, the kernel, the sum
OPERATIONS_FACTORS = 26  # a neighbour: a root and a quotient among them
OPERATIONS_CORRECT = 24  # a neighbour


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero = real(0)

    @compiled
    def constraint(total, lattice_sum, density_scale, wall):
        """C_i; `total`: sum of `density_added` over neighbours, `wall`: `wall_density` of all walls, joined."""
        return density_scale * (total - lattice_sum) + wall

    @compiled
    def factor(relaxation, weight, gx, gy, gz, own, wx, wy, wz, softness):
        """-(change of the multiplier) [m^2] over C_i: relaxation / (w_i |g + w|^2 + own + softness), g: gradient by
        neighbours, w: by walls."""
        ax, ay, az = gx + wx, gy + wy, gz + wz
        across = (ax * ax + ay * ay) + az * az
        return relaxation / (((weight * across) + own) + softness)

    @compiled
    def change(multiplier, factor, c):
        """What is added to the multiplier, which is never positive (scheme `macklin`)."""
        return min(multiplier - factor * c, zero) - multiplier

    @compiled
    def change_alone(factor, c):
        """The same of an iteration by itself (scheme `averaged`)."""
        return min(-(factor * c), zero)

    @compiled
    def crowded(t, inverse_t, strength):
        """The tensile correction [m^2]: strength (W / W_q)^4 = strength ((1 - q^2) inverse_t)^12."""
        ratio = t * inverse_t
        cubed = (ratio * ratio) * ratio
        square = cubed * cubed
        return strength * (square * square)

    @compiled
    def correction_added(total, change, s, d):
        """One axis of the sum of corrections; `change`: both multipliers' changes together."""
        return total - (change * s) * d

    @compiled
    def wall_added(total, change, w):
        """One axis: the wall's part, which comes last."""
        return total + change * w

    @compiled
    def moved(position, weight, total):
        """One axis of a particle's position after a correction."""
        return position + weight * total

    iteration = SimpleNamespace(
        constraint=constraint, factor=factor, change=change, change_alone=change_alone, crowded=crowded,
        correction_added=correction_added, wall_added=wall_added, moved=moved,
    )  # fmt: skip
    return joined(make_neighbours(real, compiled), iteration, make_walls(real, compiled))


def make_neighbours(real, compiled=plain):
    """Of two particles: their distance, kernels and slopes; in the arithmetic `real`."""
    zero, one = real(0), real(1)
    inverse_length = make_lengths(real, compiled).inverse_length
    smallest = real(1e-30)  # m^2, whose inverse length is finite in any math
    nowhere = real(1e-4)  # of the support: what is nearer than that is in one place

    @compiled
    def squared(dx, dy, dz):
        """[m^2]"""
        return (dx * dx + dy * dy) + dz * dz

    @compiled
    def wrapped(d, side, half):
        """A difference of coordinates [m] along an axis that repeats after `side`: the shortest."""
        if d > half:
            return d - side
        return d + side if d < -half else d

    @compiled
    def within(squared_distance, support):
        """Whether a particle is a neighbour."""
        return squared_distance < support * support

    @compiled
    def apart(dy, squared_distance, support, first):
        """The second component of d [m]; of two particles in one place, of which that is `first` that comes first in the
        arrays, an upright distance, so that they know which way to part."""
        short = nowhere * support
        if squared_distance < short * short:
            return -short if first else short
        return dy

    @compiled
    def near(squared_distance, inverse_support):
        """1 - q^2, 0 beyond the support."""
        return max(one - (squared_distance * inverse_support) * inverse_support, zero)

    @compiled
    def closeness(squared_distance, inverse_support):
        """1 - q, 0 beyond the support."""
        inverse = inverse_length(max(squared_distance, smallest))
        return max(one - (squared_distance * inverse) * inverse_support, zero)

    @compiled
    def density_added(total, t):
        """The sum with the spiky kernel of a neighbour; t: `closeness`."""
        return total + (t * t) * t

    @compiled
    def slope(squared_distance, inverse_support, gradient_scale):
        """s [1/m^2]: -s d is the gradient of C_i with respect to x_i that a neighbour at d makes."""
        inverse = inverse_length(squared_distance)
        t = max(one - (squared_distance * inverse) * inverse_support, zero)
        return (gradient_scale * (t * t)) * inverse

    @compiled
    def gradient_added(total, s, d):
        """One axis of the sum of gradients with respect to x_i."""
        return total - s * d

    @compiled
    def own_added(total, weight, s, squared_distance):
        """The sum of w_j |grad_j C_i|^2; `weight`: the neighbour's, its fluid's lightness."""
        return total + weight * ((s * s) * squared_distance)

    return SimpleNamespace(
        squared=squared, wrapped=wrapped, within=within, apart=apart, near=near, closeness=closeness,
        density_added=density_added, slope=slope, gradient_added=gradient_added, own_added=own_added,
    )  # fmt: skip


def make_walls(real, compiled=plain):
    """`wall_density`, `wall_slope`: of a wall at a distance; `joined_density`, `joined_gradient`: of several; in the
    arithmetic `real`."""
    zero, one = real(0), real(1)

    @compiled
    def beyond(distance, thickness):
        """How far [m] a particle is from what a collider keeps it from."""
        return distance - thickness

    @compiled
    def wall_near(distance, inverse_range):
        """1 - distance / range: 1 in the wall and 0 beyond its range."""
        return min(max(one - distance * inverse_range, zero), one)

    @compiled
    def wall_density(t, wall_scale):
        """What a wall adds to C; t: `wall_near`."""
        return wall_scale * ((t * t) * t)

    @compiled
    def wall_slope(t, wall_gradient):
        """How fast C changes with the distance, negative [1/m]."""
        return -(wall_gradient * (t * t))

    @compiled
    def rate(share, other):
        """Derivative of `joined_density` with respect to one of its arguments; `other`: the other one."""
        if max(share, other) < one:
            return one - other
        return one if share >= other else zero

    @compiled
    def joined_density(total, share):
        """Sum of the walls so far and one more, less their overlap in a corner: m + n (1 - m) of the larger one m and the
        smaller one n, or m where it exceeds 1."""
        larger = max(total, share)
        return larger + min(total, share) * max(one - larger, zero)

    @compiled
    def joined_gradient(gradient, total, slope, share, n):
        """One axis of the gradient of that; `total`: before this wall, n: its normal."""
        return gradient * rate(total, share) + (slope * n) * rate(share, total)

    return SimpleNamespace(
        beyond=beyond, wall_near=wall_near, wall_density=wall_density, wall_slope=wall_slope, rate=rate,
        joined_density=joined_density, joined_gradient=joined_gradient,
    )  # fmt: skip
