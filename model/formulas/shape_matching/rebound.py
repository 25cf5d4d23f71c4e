"""What a rigid body makes of the velocities that a collider gave to some of its particles; see
model/shape_matching/rigid_rebound.py.

Sums over a cluster have the order of cluster.py. The rigid motion of what particles got is that of pace.py.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.lengths import make as make_lengths

SUMS = 4  # of a cluster: what it got, what it is worth as a rigid motion, the mass of what got anything, what that asked for
OPERATIONS_MEMBER = 8 + 15 + 8  # of an entry
OPERATIONS_REBOUND = 24  # of an entry


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero, one, two = real(0), real(1), real(2)
    squared_length_3d = make_lengths(real, compiled).squared_length_3d

    @compiled
    def weighed(total, mass, x, y, z):
        """A sum of mass times a velocity's square."""
        return total + mass * squared_length_3d(x, y, z)

    @compiled
    def touched(total, mass, x, y, z):
        """A sum of the masses of particles that got anything."""
        return total + (mass if x != zero or y != zero or z != zero else zero)

    @compiled
    def asked(total, mass, wanted, x, y, z):
        """A sum of what the contacts of particles that got anything asked for by themselves."""
        return total + (mass * wanted if x != zero or y != zero or z != zero else zero)

    @compiled
    def squared(total, impulse):
        return total + impulse * impulse

    @compiled
    def wanted(weight, contacts, squares):
        """What the contacts of a particle ask for by themselves, over its mass: n w^2 sum p^2."""
        return contacts * (weight * weight) * squares

    @compiled
    def bound(got, mass, asked, inverse_mass):
        """The most that impulses of a body which meets others are multiplied by."""
        return one / (inverse_mass * mass) * (asked / got) if got > zero else zero

    @compiled
    def rigid(pace, a, b, c, d):
        """A rigid motion at a particle, one axis: of its velocity at the centre, and of spin and place."""
        return pace + (a * b - c * d)

    @compiled
    def enlarged(asked, worth, limit):
        """What the rigid motion is multiplied by."""
        return min(asked / worth, limit) if worth > zero else zero

    @compiled
    def scaled(motion, scale):
        return motion * scale

    @compiled
    def shared(restitution, bound_1, asked_1, worth_1, bound_2, asked_2, worth_2):
        """What the impulses of a pair are multiplied by, of what both bodies asked for and make of it: the same for both."""
        least = min(bound_1, bound_2)
        if not (worth_1 > zero and worth_2 > zero):
            return least
        worth = worth_1 + worth_2
        mean = (bound_1 * worth_1 + bound_2 * worth_2) / worth
        return min(min((asked_1 + asked_2) / worth, mean), (two / (one + restitution)) * least)

    @compiled
    def joined(velocity, given):
        return velocity + given

    @compiled
    def rebounded(velocity, struck, whole):
        """A velocity with that of the whole body for what the particle got by itself, one axis."""
        return velocity + (whole - struck)

    return SimpleNamespace(
        weighed=weighed, touched=touched, asked=asked, squared=squared, wanted=wanted, bound=bound, rigid=rigid,
        enlarged=enlarged, scaled=scaled, shared=shared, joined=joined, rebounded=rebounded,
    )  # fmt: skip
