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

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import inverse_length

OPERATIONS_FIND = 9  # a tested particle: the distance's square and its comparison
OPERATIONS_DENSITY = 15  # a neighbour: the distance, the kernel, the sum
OPERATIONS_FACTORS = 26  # a neighbour: a root and a quotient among them
OPERATIONS_CORRECT = 24  # a neighbour
SMALLEST = 1e-30  # m^2; its inverse length is finite in any math
NOWHERE = 1e-4  # of the support: nearer particles count as coincident


@formula
def constraint(total, lattice_sum, density_scale, wall):
    """C_i. `total`: sum of `density_added` over neighbours; `wall`: `wall_density` of all walls, joined."""
    return density_scale * (total - lattice_sum) + wall


@formula
def factor(relaxation, weight, gx, gy, gz, neighbour_sum, wx, wy, wz, softness):
    """-(change of the multiplier) [m^2] over C_i: relaxation / (w_i |g + w|^2 + neighbour_sum + softness). g: gradient by
    neighbours, w: by walls."""
    ax, ay, az = gx + wx, gy + wy, gz + wz
    across = (ax * ax + ay * ay) + az * az
    return relaxation / (((weight * across) + neighbour_sum) + softness)


@formula
def change(multiplier, factor, c):
    """Change of the multiplier, whose sum is never positive (scheme `macklin`)."""
    return min(multiplier - factor * c, 0.0) - multiplier


@formula
def change_alone(factor, c):
    """Change of the multiplier from one iteration alone (scheme `averaged`)."""
    return min(-(factor * c), 0.0)


@formula
def crowded(t, inverse_t, strength):
    """Tensile correction [m^2]: strength (W / W_q)^4 = strength ((1 - q^2) inverse_t)^12."""
    ratio = t * inverse_t
    cubed = (ratio * ratio) * ratio
    square = cubed * cubed
    return strength * (square * square)


@formula
def correction_added(total, change, s, d):
    """Sum of corrections plus that of a neighbour, one axis. `change`: sum of both multipliers' changes."""
    return total - (change * s) * d


@formula
def wall_added(total, change, w):
    """Sum of corrections plus that of the walls, which comes last, one axis."""
    return total + change * w


@formula
def moved(position, weight, total):
    """Position of a particle after a correction, one axis."""
    return position + weight * total


@formula
def squared(dx, dy, dz):
    """Squared length [m^2]."""
    return (dx * dx + dy * dy) + dz * dz


@formula
def wrapped(d, side, half):
    """Shortest difference of coordinates [m] along an axis of period `side`."""
    if d > half:
        return d - side
    return d + side if d < -half else d


@formula
def within(squared_distance, support):
    """True if a particle is a neighbour."""
    return squared_distance < support * support


@formula
def apart(dy, squared_distance, support, first):
    """Second component of d [m]. Coincident particles get a vertical distance, negative for the `first` of the two
    in the arrays, so that their direction of separation is defined."""
    short = NOWHERE * support
    if squared_distance < short * short:
        return -short if first else short
    return dy


@formula
def near(squared_distance, inverse_support):
    """1 - q^2, 0 beyond the support."""
    return max(1.0 - (squared_distance * inverse_support) * inverse_support, 0.0)


@formula
def closeness(squared_distance, inverse_support):
    """1 - q, 0 beyond the support."""
    inverse = inverse_length(max(squared_distance, SMALLEST))
    return max(1.0 - (squared_distance * inverse) * inverse_support, 0.0)


@formula
def density_added(total, t):
    """Sum plus the spiky kernel of a neighbour; t: `closeness`."""
    return total + (t * t) * t


@formula
def slope(squared_distance, inverse_support, gradient_scale):
    """s [1/m^2]: a neighbour at d contributes -s d to the gradient of C_i with respect to x_i."""
    inverse = inverse_length(squared_distance)
    t = max(1.0 - (squared_distance * inverse) * inverse_support, 0.0)
    return (gradient_scale * (t * t)) * inverse


@formula
def gradient_added(total, s, d):
    """Sum of gradients with respect to x_i plus that of a neighbour, one axis."""
    return total - s * d


@formula
def squares_added(total, weight, s, squared_distance):
    """Sum of w_j |grad_j C_i|^2 plus that of a neighbour. `weight`: the lightness of its fluid."""
    return total + weight * ((s * s) * squared_distance)


@formula
def beyond(distance, thickness):
    """Distance [m] of a particle from the surface at which a collider stops it."""
    return distance - thickness


@formula
def wall_near(distance, inverse_range):
    """1 - distance / range: 1 in the wall and 0 beyond its range."""
    return min(max(1.0 - distance * inverse_range, 0.0), 1.0)


@formula
def wall_density(t, wall_scale):
    """Contribution of a wall to C; t: `wall_near`."""
    return wall_scale * ((t * t) * t)


@formula
def wall_slope(t, wall_gradient):
    """Derivative of C by the distance, negative [1/m]."""
    return -(wall_gradient * (t * t))


@formula
def rate(density, other):
    """Derivative of `joined_density` by its argument `density`; `other`: its other argument."""
    if max(density, other) < 1.0:
        return 1.0 - other
    return 1.0 if density >= other else 0.0


@formula
def joined_density(total, density):
    """Sum of the densities of walls so far (`total`) and of one more, less their overlap in a corner: m + n (1 - m), where
    m is the larger and n the smaller one, or m if m exceeds 1."""
    larger = max(total, density)
    return larger + min(total, density) * max(1.0 - larger, 0.0)


@formula
def joined_gradient(gradient, total, slope, density, n):
    """Gradient of `joined_density`, one axis. `total`: before this wall; n: its normal."""
    return gradient * rate(total, density) + (slope * n) * rate(density, total)
