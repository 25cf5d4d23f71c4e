"""Rigid motions and frames of clusters, and what they do to one particle, compiled by both backends.

A backend fills in how it reads its arrays. `clusters`: those of particles, of which this one's are at `first` to before
`last`.
"""

from __future__ import annotations

from typing import NamedTuple

from softlab.model.base.variant import Open, inlined_routine
from softlab.model.formulas.shape_matching.cluster import displacement_added, goal
from softlab.model.formulas.shape_matching.couple import cross_added, gone
from softlab.model.formulas.shape_matching.pace import slowed
from softlab.model.formulas.shape_matching.rebound import rigid

motion_of = Open("motion_of(motions, c) -> Motion of cluster c")
frame_of = Open("frame_of(frames, c) -> Frame of cluster c")
member_of = Open("member_of(members, n) -> (rest offset (3), factor) of a particle in its cluster")
spin_of = Open("spin_of(spins, c) -> (centre (3), turn (3)) of cluster c")


class Motion(NamedTuple):
    """A cluster's rigid motion: its centre, the velocity there, its spin."""

    x: float
    y: float
    z: float
    u: float
    v: float
    w: float
    spin_x: float
    spin_y: float
    spin_z: float


class Frame(NamedTuple):
    """A cluster's matrix, by rows, and its centre."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float
    x: float
    y: float
    z: float


@inlined_routine
def velocity_at(motion, x, y, z):
    """Return the velocity of a particle at (x, y, z) that moves with its cluster."""
    m, dx, dy, dz = motion, x - motion.x, y - motion.y, z - motion.z
    return (
        rigid(m.u, m.spin_y, dz, m.spin_z, dy), rigid(m.v, m.spin_z, dx, m.spin_x, dz),
        rigid(m.w, m.spin_x, dy, m.spin_y, dx),
    )  # fmt: skip


@inlined_routine
def displacement_to_goals(p, first, last, clusters, members, frames):
    """Return the displacement of a particle at p towards the goals of its clusters."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(first, last):
        (a, b, c, factor), f = member_of(members, n), frame_of(frames, clusters[n])
        x = displacement_added(x, factor, goal(f.x, f.xx, f.xy, f.xz, a, b, c), p[0])
        y = displacement_added(y, factor, goal(f.y, f.yx, f.yy, f.yz, a, b, c), p[1])
        z = displacement_added(z, factor, goal(f.z, f.zx, f.zy, f.zz, a, b, c), p[2])
    return x, y, z


@inlined_routine
def slowed_velocity(p, v, first, last, clusters, factors, motions):
    """Return the velocity of a particle at p with velocity v, moved towards those of its clusters."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(first, last):
        c, factor = clusters[n], factors[n]
        m = motion_of(motions, c)
        dx, dy, dz = p[0] - m.x, p[1] - m.y, p[2] - m.z
        x = slowed(x, factor, m.u, m.spin_y, dz, m.spin_z, dy, v[0])
        y = slowed(y, factor, m.v, m.spin_z, dx, m.spin_x, dz, v[1])
        z = slowed(z, factor, m.w, m.spin_x, dy, m.spin_y, dx, v[2])
    return v[0] + x, v[1] + y, v[2] + z


@inlined_routine
def rotated(p, is_free, first, last, clusters, weights, spins):
    """Return the position of a particle at p that turns with its clusters, if it is free to move."""
    x, y, z = 0.0, 0.0, 0.0
    if is_free:
        for n in range(first, last):
            c, weight = clusters[n], weights[n]
            cx, cy, cz, ox, oy, oz = spin_of(spins, c)
            dx, dy, dz = p[0] - cx, p[1] - cy, p[2] - cz
            x = cross_added(x, weight, oy, dz, oz, dy)
            y = cross_added(y, weight, oz, dx, ox, dz)
            z = cross_added(z, weight, ox, dy, oy, dx)
    return gone(p[0], x), gone(p[1], y), gone(p[2], z)
