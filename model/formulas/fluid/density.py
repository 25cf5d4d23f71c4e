"""Density constraint of a fluid: kernels, walls, multipliers, corrections.

C_i = scale (sum_j (1 - q)^3 - lattice sum) + wall <= 0, q = r / support: the relative error of the number of particles
around i, which is the same for fluids of several densities (B. Solenthaler and R. Pajarola, "Density Contrast SPH
Interfaces", SCA 2008). C is 0 on the starting lattice, and a small dilatation e changes C by -3 e there. Multipliers
and corrections: M. Macklin and M. Mueller, "Position Based Fluids", SIGGRAPH 2013 (eqs. 8 to 14). The sum of the
multipliers of all iterations of a substep is never positive: a fluid pushes and does not pull.

The correction must follow the exact gradient of C. Then it does no work along motions that conserve C, and water at
rest gains no energy. The paper takes density from one kernel (poly6) and the gradient from another (spiky). That force
is not conservative and makes water at rest boil, the faster the shorter the substep. Here both are the spiky kernel's,
(1 - q)^3.

A wall adds scale (1 - distance / range)^3. The layer of the lattice next to it, half a rest distance away, then has the
full density, and the wall pushes it as its neighbours on the other side do. (With particles instead: N. Akinci et al.,
"Versatile Rigid-Fluid Coupling", SIGGRAPH 2012.)

d is always x_i - x_j, of particle i and its neighbour j. A sum over neighbours begins at 0 and follows the list's
order.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import joined, plain
from softlab.model.formulas.lengths import make as make_lengths

OPERATIONS_FIND = 9  # a tested particle: the distance's square and its comparison
OPERATIONS_DENSITY = 15  # a neighbour: the distance, the kernel, the sum
OPERATIONS_FACTORS = 26  # a neighbour: a root and a quotient among them
OPERATIONS_CORRECT = 24  # a neighbour


def make(real, compiled=plain):
    """Make the functions of neighbours, an iteration and walls in the arithmetic `real`."""
    zero = real(0)

    @compiled
    def constraint(total, lattice_sum, density_scale, wall):
        """C_i. `total`: sum of `density_added` over neighbours; `wall`: `wall_density` of all walls, joined."""
        return density_scale * (total - lattice_sum) + wall

    @compiled
    def factor(relaxation, weight, gx, gy, gz, neighbour_sum, wx, wy, wz, softness):
        """-(change of the multiplier) [m^2] over C_i: relaxation / (w_i |g + w|^2 + neighbour_sum + softness). g: gradient by
        neighbours, w: by walls."""
        ax, ay, az = gx + wx, gy + wy, gz + wz
        across = (ax * ax + ay * ay) + az * az
        return relaxation / (((weight * across) + neighbour_sum) + softness)

    @compiled
    def change(multiplier, factor, c):
        """Change of the multiplier, whose sum is never positive (scheme `macklin`)."""
        return min(multiplier - factor * c, zero) - multiplier

    @compiled
    def change_alone(factor, c):
        """Change of the multiplier from one iteration alone (scheme `averaged`)."""
        return min(-(factor * c), zero)

    @compiled
    def crowded(t, inverse_t, strength):
        """Tensile correction [m^2]: strength (W / W_q)^4 = strength ((1 - q^2) inverse_t)^12."""
        ratio = t * inverse_t
        cubed = (ratio * ratio) * ratio
        square = cubed * cubed
        return strength * (square * square)

    @compiled
    def correction_added(total, change, s, d):
        """Sum of corrections plus that of a neighbour, one axis. `change`: sum of both multipliers' changes."""
        return total - (change * s) * d

    @compiled
    def wall_added(total, change, w):
        """Sum of corrections plus that of the walls, which comes last, one axis."""
        return total + change * w

    @compiled
    def moved(position, weight, total):
        """Position of a particle after a correction, one axis."""
        return position + weight * total

    iteration = SimpleNamespace(
        constraint=constraint, factor=factor, change=change, change_alone=change_alone, crowded=crowded,
        correction_added=correction_added, wall_added=wall_added, moved=moved,
    )  # fmt: skip
    return joined(make_neighbours(real, compiled), iteration, make_walls(real, compiled))


def make_neighbours(real, compiled=plain):
    """Make the functions of two particles (distance, kernels, slopes) in the arithmetic `real`."""
    zero, one = real(0), real(1)
    inverse_length = make_lengths(real, compiled).inverse_length
    smallest = real(1e-30)  # m^2; its inverse length is finite in any math
    nowhere = real(1e-4)  # of the support: nearer particles count as coincident

    @compiled
    def squared(dx, dy, dz):
        """Squared length [m^2]."""
        return (dx * dx + dy * dy) + dz * dz

    @compiled
    def wrapped(d, side, half):
        """Shortest difference of coordinates [m] along an axis of period `side`."""
        if d > half:
            return d - side
        return d + side if d < -half else d

    @compiled
    def within(squared_distance, support):
        """True if a particle is a neighbour."""
        return squared_distance < support * support

    @compiled
    def apart(dy, squared_distance, support, first):
        """Second component of d [m]. Coincident particles get a vertical distance, negative for the `first` of the two
        in the arrays, so that their direction of separation is defined."""
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
        """Sum plus the spiky kernel of a neighbour; t: `closeness`."""
        return total + (t * t) * t

    @compiled
    def slope(squared_distance, inverse_support, gradient_scale):
        """s [1/m^2]: a neighbour at d contributes -s d to the gradient of C_i with respect to x_i."""
        inverse = inverse_length(squared_distance)
        t = max(one - (squared_distance * inverse) * inverse_support, zero)
        return (gradient_scale * (t * t)) * inverse

    @compiled
    def gradient_added(total, s, d):
        """Sum of gradients with respect to x_i plus that of a neighbour, one axis."""
        return total - s * d

    @compiled
    def squares_added(total, weight, s, squared_distance):
        """Sum of w_j |grad_j C_i|^2 plus that of a neighbour. `weight`: the lightness of its fluid."""
        return total + weight * ((s * s) * squared_distance)

    return SimpleNamespace(
        squared=squared, wrapped=wrapped, within=within, apart=apart, near=near, closeness=closeness,
        density_added=density_added, slope=slope, gradient_added=gradient_added, squares_added=squares_added,
    )  # fmt: skip


def make_walls(real, compiled=plain):
    """Make the functions of walls in the arithmetic `real`.

    `wall_density`, `wall_slope`: one wall at a distance; `joined_density`, `joined_gradient`: several walls.
    """
    zero, one = real(0), real(1)

    @compiled
    def beyond(distance, thickness):
        """Distance [m] of a particle from the surface at which a collider stops it."""
        return distance - thickness

    @compiled
    def wall_near(distance, inverse_range):
        """1 - distance / range: 1 in the wall and 0 beyond its range."""
        return min(max(one - distance * inverse_range, zero), one)

    @compiled
    def wall_density(t, wall_scale):
        """Contribution of a wall to C; t: `wall_near`."""
        return wall_scale * ((t * t) * t)

    @compiled
    def wall_slope(t, wall_gradient):
        """Derivative of C by the distance, negative [1/m]."""
        return -(wall_gradient * (t * t))

    @compiled
    def rate(density, other):
        """Derivative of `joined_density` by its argument `density`; `other`: its other argument."""
        if max(density, other) < one:
            return one - other
        return one if density >= other else zero

    @compiled
    def joined_density(total, density):
        """Sum of the walls so far and one more, less their overlap in a corner: m + n (1 - m) of the larger one m and
        the smaller one n, or m where it exceeds 1."""
        larger = max(total, density)
        return larger + min(total, density) * max(one - larger, zero)

    @compiled
    def joined_gradient(gradient, total, slope, density, n):
        """Gradient of `joined_density`, one axis. `total`: before this wall; n: its normal."""
        return gradient * rate(total, density) + (slope * n) * rate(density, total)

    return SimpleNamespace(
        beyond=beyond, wall_near=wall_near, wall_density=wall_density, wall_slope=wall_slope, rate=rate,
        joined_density=joined_density, joined_gradient=joined_gradient,
    )  # fmt: skip
