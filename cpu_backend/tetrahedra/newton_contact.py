"""Colliders in the energy that a step minimises, on CPU threads: a spring pushes a particle inside a collider out.

The remaining penetration is removed after the step, as in all solvers; without the spring this would strain a stiff
body.
"""

from __future__ import annotations

from softlab.model.base.variant import Open, routine
from softlab.model.formulas.elastic.newton import CONTACT, SOON, inertia_of, moved

touch = Open("touch(bodies, kinds, step, parameters, a, p, v) -> (p, v), all colliders; friction acts after the solve")


@routine
def depth(k, number, x, y, z, before, holds, colliders):
    """Return the penetration of particle k at a point (a vector), and the contact stiffness [N/m]."""
    parameters, bodies, kinds = colliders
    start = before[k, 0], before[k, 1], before[k, 2]
    (p, q, r), _ = touch(bodies, kinds, number, parameters, start, (x, y, z), (0.0, 0.0, 0.0))
    return x - p, y - q, z - r, CONTACT * (holds[k, 0] + inertia_of(parameters.newton_inertia, before[k, 3]))


@routine
def within(k, number, position, before, holds, colliders):
    """Return `depth` of particle k. `holds` (particles, 1): stiffness that holds each [N/m]; `colliders`: (parameters,
    bodies, kinds)."""
    return depth(k, number, position[k, 0], position[k, 1], position[k, 2], before, holds, colliders)


@routine
def nearly_within(k, number, position, target, before, holds, colliders):
    """Return `depth` of particle k, or, where it is outside colliders, that of its position a little later."""
    x, y, z = position[k, 0], position[k, 1], position[k, 2]
    p, q, r, hard = depth(k, number, x, y, z, before, holds, colliders)
    if (p == 0.0) & (q == 0.0) & (r == 0.0):
        x, y, z = moved(x, SOON, target[k, 0] - x), moved(y, SOON, target[k, 1] - y), moved(z, SOON, target[k, 2] - z)
        return depth(k, number, x, y, z, before, holds, colliders)
    return p, q, r, hard


@routine
def pressed(first, last, number, position, velocity, before, holds, colliders):
    """Add the push of colliders to velocities at a substep's end, so that friction knows the normal impulse."""
    parameters, _, _ = colliders
    for k in range(first, last):
        if before[k, 3] > 0.0:
            x, y, z, hard = within(k, number, position, before, holds, colliders)
            rate = hard / (inertia_of(parameters.newton_inertia, before[k, 3])) * parameters.newton_rate
            velocity[k, 0] = velocity[k, 0] + rate * x
            velocity[k, 1] = velocity[k, 1] + rate * y
            velocity[k, 2] = velocity[k, 2] + rate * z
