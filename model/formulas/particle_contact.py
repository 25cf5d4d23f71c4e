"""Contacts of particles: the displacements of a particle by its contacts, all from one state.

The constraint |x_i - x_j| >= distance with Coulomb friction as a change of position: M. Macklin et al., "Unified
Particle Physics for Real-Time Applications", SIGGRAPH 2014, sections 4 and 6 (eq. 24). All contacts are projected at
once, each for masses that are split among their contacts, so that linear momentum is conserved for any number of
contacts: R. Tonge et al., "Mass Splitting for Jitter-Free Parallel Rigid Body Simulation", SIGGRAPH 2012. Each of n_i
contacts has a mass m_i / n_i of particle i, and the mean of its parts moves by the sum over j of w_i C n / (w_i n_i +
w_j n_j), w = 1/m. For j it is the same in the opposite direction. Normal pushes conserve angular momentum, too.
Friction acts on the particles' centres: the angular momentum that this changes, the distance times the impulse, is
restored by their clusters (shape_matching/couple.py). Adhesion pulls nearby separated particles together, at a bounded
acceleration.

Restitution acts on velocities, after they are computed from positions: M. Mueller et al., "Detailed Rigid Body
Simulation with Extended Position Based Dynamics", SCA 2020, section 3.6 (eq. 34), for the same split masses.
"""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import squared_length_3d

LEFT = 2.0**-8  # of the settling speed: separation speed allowed to two rigid bodies that were pressed apart
OPERATIONS_SEARCH = 9  # a tested particle: the distance's square and its comparison
OPERATIONS_COUNT = 9  # a neighbour
OPERATIONS_PROJECT = 60  # a contact: two lengths, the normal, friction, three sums
OPERATIONS_BOUNCE = 2 * 36  # a neighbour: counted and applied, the normal, two speeds along it
NOWHERE = 1e-6  # of the distance: nearer particles have no direction
BESIDE = 1.001  # of the distance: particles moved apart to it are nearer or farther by rounding


@formula
def squared(dx, dy, dz):
    return squared_length_3d(dx, dy, dz)


@formula
def scaled(x, inverse_cell):
    """Coordinate in cells of space."""
    return x * inverse_cell


@formula
def within(squared_distance, distance):
    """True if the length is below `distance`; never if that is 0."""
    return squared_distance < distance * distance


@formula
def split(weight, contacts, other_weight, other_contacts):
    """1 / (w_i n_i + w_j n_j); 0 if neither can move."""
    stiffness = weight * contacts + other_weight * other_contacts
    return 1.0 / stiffness if stiffness > 0.0 else 0.0


@formula
def enforced_distance(distance, bx, by, bz, push):
    """Distance [m] that the contact enforces: `distance`, or, if the pair began the substep nearer (b), at most b +
    `push`."""
    return min(distance, sqrt(squared_length_3d(bx, by, bz)) + push)


@formula
def direction(dx, dy, dz, distance, first):
    """Return (length, unit normal). Of two coincident particles the `first` moves down, the other one up."""
    length = sqrt(squared_length_3d(dx, dy, dz))
    if length > NOWHERE * distance:
        return length, dx / length, dy / length, dz / length
    return length, 0.0, -1.0 if first else 1.0, 0.0


@formula
def depth(length, enforced, distance, pull):
    """Correction [m] of the distance along the normal. Negative: adhesion pulls particles beyond `distance`
    together, by at most `pull`."""
    if length < enforced:
        return enforced - length
    return max(distance - length, -pull) if length > distance else 0.0


@formula
def slip(dx, dy, dz, bx, by, bz, nx, ny, nz):
    """Relative sliding within the substep [m]: from b to d, without the component along the normal."""
    sx, sy, sz = dx - bx, dy - by, dz - bz
    along = (sx * nx + sy * ny) + sz * nz
    return sx - along * nx, sy - along * ny, sz - along * nz


@formula
def grip(sx, sy, sz, depth, pull, static_friction, dynamic_friction):
    """Fraction of the slip that friction removes: all of it within the cone of the static coefficient (eq. 24). The
    normal load is the depth plus the pull of adhesion."""
    sliding, pressed = sqrt(squared_length_3d(sx, sy, sz)), max(depth, 0.0) + pull
    if sliding <= static_friction * pressed:
        return 1.0
    return dynamic_friction * pressed / sliding


@formula
def added(total, fraction, depth, n):
    """Sum of displacements plus that of a contact, one axis."""
    return total + fraction * (depth * n)


@formula
def pressed(total, fraction, depth):
    """Normal impulse, times h, of a contact of two rigid bodies in a substep so far."""
    return total + fraction * depth


@formula
def added_friction(total, fraction, depth, n, gripped, s):
    """Sum of displacements plus that of a contact with friction, one axis."""
    return total + fraction * (depth * n - gripped * s)


@formula
def moved(position, weight, total):
    """Position of a particle after all its contacts, one axis."""
    return position + weight * total


@formula
def touching(squared_distance, distance):
    """True if two particles touch at the substep's end."""
    limit = BESIDE * distance
    return squared_distance < limit * limit


@formula
def lacking(a, b, n, restitution, settling):
    """Speed [m/s] that is missing from the separation of two touching particles.

    Restitution requires the fraction `restitution` of the approach speed at the substep's start (a); b is the speed
    now. It is 0 where the approach speed is at most `settling`, and where they separate fast enough.
    """
    came = -((a[0] * n[0] + a[1] * n[1]) + a[2] * n[2])
    lack = restitution * came - ((b[0] * n[0] + b[1] * n[1]) + b[2] * n[2])
    return max(lack, 0.0) if came > settling else 0.0


@formula
def parting(a, b, n, restitution, settling, pressed):
    """Missing separation speed [m/s] as by `lacking`, of two rigid bodies, also for the effects of other contacts
    in the substep.

    It is negative where they separate faster than that, or than they did, and were `pressed` apart in the substep:
    an overlap is pushed out, and does not turn into speed.
    """
    came = -((a[0] * n[0] + a[1] * n[1]) + a[2] * n[2])
    parts = (b[0] * n[0] + b[1] * n[1]) + b[2] * n[2]
    came = max(came, -parts)
    goal = restitution * came if came > settling else max(-came, 0.0)
    lack = goal - parts
    if lack > 0.0:
        return lack if came > settling else 0.0
    return lack if pressed > 0.0 and -lack > LEFT * settling else 0.0


@formula
def impulse(fraction, lack, pressed, inverse_h):
    """Impulse of a contact of two rigid bodies; it removes at most the velocity that `pressed` them apart."""
    return max(fraction * lack, -(pressed * inverse_h))


@formula
def impulse_added(total, impulse, n):
    """Sum of impulses plus that of a contact, one axis."""
    return total + impulse * n


@formula
def far(dx, dy, dz):
    """Displacement of a particle in a substep [m]."""
    return sqrt(squared_length_3d(dx, dy, dz))


@formula
def shortened(position, before, length, fastest):
    """Position at the substep's end with the displacement limited to `fastest`, one axis."""
    return before + (position - before) * (fastest / length) if length > fastest else position


@formula
def rested(position, before, length, asleep):
    """Position at the substep's end, unchanged from `before` if the displacement is below `asleep`, one axis."""
    return before if length < asleep else position
