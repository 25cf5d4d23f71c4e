"""Response of a rigid body to the velocities that colliders gave to some of its particles; see
model/shape_matching/rigid_rebound.py.

Sums over a cluster have the order of cluster.py. The rigid motion of the particles' velocities is that of pace.py.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain
from softlab.model.formulas.lengths import make as make_lengths

SUMS = 4  # of a cluster: `got`, its `worth` as a rigid motion, the mass of the particles concerned, `asked`
OPERATIONS_MEMBER = 8 + 15 + 8  # of an entry
OPERATIONS_REBOUND = 24  # of an entry


def make(real, compiled=plain):
    """Make the functions of rebounds in the arithmetic `real`."""
    zero, one, two = real(0), real(1), real(2)
    squared_length_3d = make_lengths(real, compiled).squared_length_3d

    @compiled
    def weighed(total, mass, x, y, z):
        """Sum of mass times squared velocity plus that of a particle."""
        return total + mass * squared_length_3d(x, y, z)

    @compiled
    def touched(total, mass, x, y, z):
        """Sum of the masses of particles that received a velocity, plus one more."""
        return total + (mass if x != zero or y != zero or z != zero else zero)

    @compiled
    def asked(total, mass, wanted, x, y, z):
        """Sum of mass times `wanted` of particles that received a velocity, plus one more."""
        return total + (mass * wanted if x != zero or y != zero or z != zero else zero)

    @compiled
    def squared(total, impulse):
        return total + impulse * impulse

    @compiled
    def wanted(weight, contacts, squares):
        """Contribution of a particle's contacts to `asked`, over its mass: n w^2 sum p^2."""
        return contacts * (weight * weight) * squares

    @compiled
    def bound(got, mass, asked, inverse_mass):
        """Largest factor of the impulses of a body in contact with others."""
        return one / (inverse_mass * mass) * (asked / got) if got > zero else zero

    @compiled
    def rigid(centre_velocity, a, b, c, d):
        """Rigid motion at a particle, one axis: its velocity at the centre plus the cross product of spin and
        position."""
        return centre_velocity + (a * b - c * d)

    @compiled
    def enlarged(asked, worth, limit):
        """Factor of the rigid motion: `asked` over `worth`, at most `limit`."""
        return min(asked / worth, limit) if worth > zero else zero

    @compiled
    def scaled(motion, scale):
        return motion * scale

    @compiled
    def shared(restitution, bound_1, asked_1, worth_1, bound_2, asked_2, worth_2):
        """Factor of the impulses of a pair, the same for both, from `asked` and `worth` of both bodies."""
        least = min(bound_1, bound_2)
        if not (worth_1 > zero and worth_2 > zero):
            return least
        worth = worth_1 + worth_2
        mean = (bound_1 * worth_1 + bound_2 * worth_2) / worth
        return min(min((asked_1 + asked_2) / worth, mean), (two / (one + restitution)) * least)

    @compiled
    def joined(velocity, change):
        return velocity + change

    @compiled
    def rebounded(velocity, received, whole):
        """Velocity with that of the whole body in place of that which the particle received by itself, one axis."""
        return velocity + (whole - received)

    return SimpleNamespace(
        weighed=weighed, touched=touched, asked=asked, squared=squared, wanted=wanted, bound=bound, rigid=rigid,
        enlarged=enlarged, scaled=scaled, shared=shared, joined=joined, rebounded=rebounded,
    )  # fmt: skip
