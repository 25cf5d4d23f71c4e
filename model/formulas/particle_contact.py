"""Particles that meet: the ways that a particle takes out of its contacts, all from one state.

The constraint |x_i - x_j| >= distance with Coulomb friction as a change of position: M. Macklin et al., "Unified Particle
Physics for Real-Time Applications", SIGGRAPH 2014, sections 4 and 6 (eq. 24). All contacts are projected at once, each
for masses that are split among their contacts, so that linear momentum is kept however many meet: R. Tonge et al., "Mass
Splitting for Jitter-Free Parallel Rigid Body Simulation", SIGGRAPH 2012. Of n_i contacts each has a mass m_i / n_i of
particle i, and the mean of its parts moves by the sum over j of w_i C n / (w_i n_i + w_j n_j), w = 1/m. Seen from j it is
the same, the other way. Normal pushes keep angular momentum, too. Friction acts on the particles' middles: the angular
momentum that this changes, the distance times the impulse, is taken back by their clusters (shape_matching/couple.py).
Adhesion pulls together what is just apart, at a bounded acceleration.

Restitution acts on velocities, once they follow from positions: M. Mueller et al., "Detailed Rigid Body Simulation with
Extended Position Based Dynamics", SCA 2020, section 3.6 (eq. 34), for the same split masses.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from model.formulas import joined, plain
from model.formulas.lengths import make as make_lengths

LEFT = 2.0**-8  # of the speed at which bodies settle: what two rigid ones that were pressed apart may part with
OPERATIONS_SEARCH = 9  # a particle that is looked at: the distance's square and its comparison
OPERATIONS_COUNT = 9  # a neighbour
OPERATIONS_PROJECT = 60  # a contact: two lengths, the normal, friction, three sums
OPERATIONS_BOUNCE = 2 * 36  # a neighbour: counted and answered, the normal, two speeds along it


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`. Vectors are three numbers, from the other particle to the asking one."""
    zero, one, nowhere = real(0), real(1), real(1e-6)
    squared_length_3d = make_lengths(real, compiled).squared_length_3d

    @compiled
    def squared(dx, dy, dz):
        return squared_length_3d(dx, dy, dz)

    @compiled
    def scaled(x, inverse_cell):
        """A coordinate in cells of space."""
        return x * inverse_cell

    @compiled
    def within(squared_distance, distance):
        """Whether it is shorter than that; never, where the distance is 0."""
        return squared_distance < distance * distance

    @compiled
    def split(weight, contacts, other_weight, other_contacts):
        """1 / (w_i n_i + w_j n_j); 0 where neither can move."""
        stiffness = weight * contacts + other_weight * other_contacts
        return one / stiffness if stiffness > zero else zero

    @compiled
    def held(distance, bx, by, bz, push):
        """What the contact keeps [m]: the distance; of what began the substep nearer (b) no more than `push` beyond it."""
        return min(distance, sqrt(squared_length_3d(bx, by, bz)) + push)

    @compiled
    def direction(dx, dy, dz, distance, first):
        """(length, unit normal); of two in one place the one that is asked for `first` goes down, the other one up."""
        length = sqrt(squared_length_3d(dx, dy, dz))
        if length > nowhere * distance:
            return length, dx / length, dy / length, dz / length
        return length, zero, -one if first else one, zero

    @compiled
    def depth(length, kept, distance, pull):
        """How far [m] along the normal both are moved apart; negative: together, by adhesion, which moves what is farther
        than the distance by `pull` at most."""
        if length < kept:
            return kept - length
        return max(distance - length, -pull) if length > distance else zero

    @compiled
    def slip(dx, dy, dz, bx, by, bz, nx, ny, nz):
        """How one slid along the other within the substep [m]: from b to d, less what is along the normal."""
        sx, sy, sz = dx - bx, dy - by, dz - bz
        along = (sx * nx + sy * ny) + sz * nz
        return sx - along * nx, sy - along * ny, sz - along * nz

    @compiled
    def grip(sx, sy, sz, depth, pull, static_friction, dynamic_friction):
        """The part of the slip that friction takes back: all of it within the cone of the static coefficient (eq. 24). What
        presses is the depth, and the pull of adhesion."""
        sliding, pressed = sqrt(squared_length_3d(sx, sy, sz)), max(depth, zero) + pull
        if sliding <= static_friction * pressed:
            return one
        return dynamic_friction * pressed / sliding

    @compiled
    def added(total, share, depth, n):
        """A sum of ways with that of a contact, one axis."""
        return total + share * (depth * n)

    @compiled
    def pressed(total, share, depth):
        """The impulse, times h, of a contact of two rigid bodies in a substep so far, along its normal."""
        return total + share * depth

    @compiled
    def added_friction(total, share, depth, n, gripped, s):
        """The same with friction."""
        return total + share * (depth * n - gripped * s)

    @compiled
    def moved(position, weight, total):
        """A particle after all its contacts, one axis."""
        return position + weight * total

    contacts = SimpleNamespace(
        squared=squared, scaled=scaled, within=within, split=split, held=held, direction=direction, depth=depth, slip=slip,
        grip=grip, added=added, pressed=pressed, added_friction=added_friction, moved=moved,
    )  # fmt: skip
    return joined(contacts, make_end(real, compiled, squared_length_3d))


def make_end(real, compiled, squared_length_3d):
    """At a substep's end: who bounces, goes too fast, or sleeps; in the arithmetic `real`."""
    zero, left = real(0), real(LEFT)
    beside = real(1.001)  # of the distance: what was moved apart to it is a rounding nearer or farther

    @compiled
    def touching(squared_distance, distance):
        """Whether two touch at the substep's end."""
        reach = beside * distance
        return squared_distance < reach * reach

    @compiled
    def lacking(ax, ay, az, bx, by, bz, nx, ny, nz, restitution, settling):
        """How much faster [m/s] two that touch must part: than they do (b), for the part `restitution` of the speed at which
        they came when the substep began (a). 0 where that is not over `settling`, and where they part fast enough."""
        came = -((ax * nx + ay * ny) + az * nz)
        lack = restitution * came - ((bx * nx + by * ny) + bz * nz)
        return max(lack, zero) if came > settling else zero

    @compiled
    def parting(ax, ay, az, bx, by, bz, nx, ny, nz, restitution, settling, pressed):
        """As `lacking`, of two rigid bodies, also for what others did to them within the substep. Negative where they part
        faster than that, or than they did, and were `pressed` apart in the substep: an overlap is pushed out of it, and no
        speed made of it."""
        came = -((ax * nx + ay * ny) + az * nz)
        parts = (bx * nx + by * ny) + bz * nz
        came = max(came, -parts)
        goal = restitution * came if came > settling else max(-came, zero)
        lack = goal - parts
        if lack > zero:
            return lack if came > settling else zero
        return lack if pressed > zero and -lack > left * settling else zero

    @compiled
    def impulse(share, lack, pressed, inverse_h):
        """That of a contact of two rigid bodies: it takes back no more than it `pressed` them apart with."""
        return max(share * lack, -(pressed * inverse_h))

    @compiled
    def struck(total, impulse, n):
        """A sum of impulses with that of a contact, one axis."""
        return total + impulse * n

    @compiled
    def far(dx, dy, dz):
        """How far a particle went in a substep [m]."""
        return sqrt(squared_length_3d(dx, dy, dz))

    @compiled
    def shortened(position, before, length, fastest):
        """A particle at the substep's end that went no farther than it may, one axis."""
        return before + (position - before) * (fastest / length) if length > fastest else position

    @compiled
    def rested(position, before, length, asleep):
        """A particle at the substep's end that stays where it was if it hardly moved, one axis."""
        return before if length < asleep else position

    return SimpleNamespace(
        touching=touching, lacking=lacking, parting=parting, impulse=impulse, struck=struck, far=far, shortened=shortened,
        rested=rested,
    )  # fmt: skip
