"""Colliders in Newton's method, on CUDA: as cpu_backend/tetrahedra/newton_contact.py, for one particle."""

from __future__ import annotations

from softlab.model.base.variant import Open, inlined_routine
from softlab.model.formulas.elastic.newton import CONTACT, SOON, inertia_of, moved
from softlab.model.formulas.elastic.solving import times

touch = Open("touch(b, x, y, z, vx, vy, vz, world, number) -> (x, y, z, vx, vy, vz); friction acts after the solve")


@inlined_routine
def depth(b, x, y, z, holds, world, number):
    """Return the penetration of a particle at a point (a vector), and the contact stiffness [N/m]."""
    p, q, r, _, _, _ = touch(b, x, y, z, 0.0, 0.0, 0.0, world, number)
    hard = times(CONTACT, holds + inertia_of(world.parameters.newton_inertia, b[3]))
    return x - p, y - q, z - r, hard


@inlined_routine
def within(b, p, holds, world, number):
    """Return `depth` of a particle at `p`; `b`: the quad of its old position, with its weight; `holds` [N/m]: stiffness that
    holds it."""
    return depth(b, p[0], p[1], p[2], holds, world, number)


@inlined_routine
def nearly_within(b, p, target, holds, world, number):
    """Return `depth` of a particle, or, where it is outside colliders, that of its position a little later."""
    x, y, z, hard = p[0], p[1], p[2], 0.0
    dx, dy, dz, fraction = 0.0, 0.0, 0.0, 0.0
    for _ in range(2):  # a loop, so that colliders are compiled once
        if (dx == 0.0) & (dy == 0.0) & (dz == 0.0):
            x, y, z = (
                moved(p[0], fraction, target[0] - p[0]),
                moved(p[1], fraction, target[1] - p[1]),
                moved(p[2], fraction, target[2] - p[2]),
            )
            dx, dy, dz, hard = depth(b, x, y, z, holds, world, number)
            fraction = SOON
    return dx, dy, dz, hard


@inlined_routine
def pressed(b, p, v, holds, world, number):
    """Return a particle's velocity including the push of colliders."""
    x, y, z, hard = within(b, p, holds, world, number)
    parameters = world.parameters
    rate = times(hard / inertia_of(parameters.newton_inertia, b[3]), parameters.newton_rate)
    return moved(v[0], rate, x), moved(v[1], rate, y), moved(v[2], rate, z)
