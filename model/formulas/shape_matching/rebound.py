"""What a rigid body makes of the velocities that a collider gave to some of its particles; see
model/shape_matching/rigid_rebound.py.

Sums over a cluster have the order of cluster.py. The rigid motion of what particles got is that of pace.py.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.lengths import make as make_lengths

SUMS = 2  # of a cluster: what was asked for, what it is worth as a rigid motion
OPERATIONS_MEMBER = 8 + 15 + 8  # of an entry
OPERATIONS_REBOUND = 24  # of an entry


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero = real(0)
    squared_length_3d = make_lengths(real, compiled).squared_length_3d

    @compiled
    def weighed(total, mass, x, y, z):
        """A sum of mass times a velocity's square."""
        return total + mass * squared_length_3d(x, y, z)

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
    def shared(first, second):
        """What the impulses of a pair are multiplied by, of what each body's would be: the same for both."""
        return min(first, second)

    @compiled
    def joined(velocity, given):
        return velocity + given

    @compiled
    def rebounded(velocity, struck, whole):
        """A velocity with that of the whole body for what the particle got by itself, one axis."""
        return velocity + (whole - struck)

    return SimpleNamespace(
        weighed=weighed, rigid=rigid, enlarged=enlarged, scaled=scaled, shared=shared, joined=joined, rebounded=rebounded
    )  # fmt: skip
