"""Response of a rigid body to the velocities that colliders gave to some of its particles; see
model/shape_matching/rigid_rebound.py.

Sums over a cluster have the order of cluster.py. The rigid motion of the particles' velocities is that of pace.py.
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import squared_length_3d

SUMS = 4  # of a cluster: `got`, its `worth` as a rigid motion, the mass of the particles concerned, `asked`
OPERATIONS_MEMBER = 8 + 15 + 8  # of an entry
OPERATIONS_REBOUND = 24  # of an entry


@formula
def weighed(total, mass, x, y, z):
    """Sum of mass times squared velocity, with that of a particle added."""
    return total + mass * squared_length_3d(x, y, z)


@formula
def touched(total, mass, x, y, z):
    """Sum of the masses of particles that received a velocity, plus one more."""
    return total + (mass if x != 0.0 or y != 0.0 or z != 0.0 else 0.0)


@formula
def asked(total, mass, wanted, x, y, z):
    """Sum of mass times `wanted` of particles that received a velocity, plus one more."""
    return total + (mass * wanted if x != 0.0 or y != 0.0 or z != 0.0 else 0.0)


@formula
def squared(total, impulse):
    return total + impulse * impulse


@formula
def wanted(weight, contacts, squares):
    """Contribution of a particle's contacts to `asked`, over its mass: n w^2 sum p^2."""
    return contacts * (weight * weight) * squares


@formula
def bound(got, mass, asked, inverse_mass):
    """Largest factor of the impulses of a body in contact with others."""
    return 1.0 / (inverse_mass * mass) * (asked / got) if got > 0.0 else 0.0


@formula
def rigid(centre_velocity, a, b, c, d):
    """Rigid motion at a particle, one axis: its velocity at the centre plus the cross product of spin and
    position."""
    return centre_velocity + (a * b - c * d)


@formula
def enlarged(asked, worth, limit):
    """Factor of the rigid motion: `asked` over `worth`, at most `limit`."""
    return min(asked / worth, limit) if worth > 0.0 else 0.0


@formula
def scaled(motion, scale):
    return motion * scale


@formula
def shared(restitution, bound_1, asked_1, worth_1, bound_2, asked_2, worth_2):
    """Factor of the impulses of a pair, the same for both, from `asked` and `worth` of both bodies."""
    least = min(bound_1, bound_2)
    if not (worth_1 > 0.0 and worth_2 > 0.0):
        return least
    worth = worth_1 + worth_2
    mean = (bound_1 * worth_1 + bound_2 * worth_2) / worth
    return min(min((asked_1 + asked_2) / worth, mean), (2.0 / (1.0 + restitution)) * least)


@formula
def joined(velocity, change):
    return velocity + change


@formula
def rebounded(velocity, received, whole):
    """Velocity with the rebound of the whole body instead of the rebound of the particle alone, one axis."""
    return velocity + (whole - received)
