"""Velocities of fluid particles at walls, on CPU threads (model/fluid/plan.py, 1 and 6)."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import (
    BOX,
    CAPSULE,
    FIELD,
    MESH,
    PLANE,
    SPHERE,
    collide_mass,
    instants,
    point,
)
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.walls import (
    away,
    from_box,
    from_capsule,
    from_field,
    from_mesh,
    from_plane,
    from_sphere,
)
from softlab.model.base.variant import FEATURE, filled, open_constant, routine
from softlab.model.contact.cloth_parameters import (
    B_SPIN,
    B_THICKNESS,
    B_U,
    B_V,
    B_VX,
    B_VY,
    B_VZ,
    B_W,
    COLLIDER_FIELDS,
)
from softlab.model.formulas.fluid.density import beyond, joined_density, rate, wall_density, wall_near, wall_slope
from softlab.model.formulas.fluid.impact import after_impact, rebound, surface_velocity, wall_push, without
from softlab.model.formulas.fluid.motion import drifted, limited_change, speed_of

turns = open_constant("True if colliders of the kind may turn")


@routine
def impact_of(at, world, b, u, p, v, most):
    """Return the position and velocity of a particle after the colliders, if it moves from b at the predicted velocity u,
    and its velocity at p, which is v if no collider was in its way (model/formulas/fluid/impact.py)."""
    parameters, (bx, by, bz), (ux, uy, uz), (px, py, pz), (vx, vy, vz) = world.parameters, b, u, p, v
    h, rate = parameters.dt, parameters.inverse_dt
    x, y, z = drifted(bx, ux, h), drifted(by, uy, h), drifted(bz, uz, h)
    (qx, qy, qz), (ux, uy, uz) = collide_mass(world.bodies, world.kinds, at.number, parameters, b, (x, y, z), u)
    if qx != x or qy != y or qz != z:
        vx, vy = after_impact(ux, px, qx, rate), after_impact(uy, py, qy, rate)
        vz = after_impact(uz, pz, qz, rate)
        if FEATURE.limited_change:
            far = speed_of(vx - ux, vy - uy, vz - uz)
            vx, vy, vz = (
                limited_change(vx, ux, far, most),
                limited_change(vy, uy, far, most),
                limited_change(vz, uz, far, most),
            )
    return (qx, qy, qz), (ux, uy, uz), (vx, vy, vz)


@routine
def settle_at(body, arguments, total, vx, vy, vz):
    """Return (total, velocity) after one more collider. `total`: the wall density of the colliders so far."""
    parameters, end, qx, qy, qz, ux, uy, uz, multiplier, weight = arguments
    thickness, wx, wy, wz = body[B_THICKNESS], body[B_VX], body[B_VY], body[B_VZ]
    distance, nx, ny, nz = away(body, end, parameters.support + thickness, qx, qy, qz)
    if turns:
        wx, wy, wz = surface_velocity(
            (wx, wy, wz), body[B_SPIN], (body[B_U], body[B_V], body[B_W]), (qx, qy, qz), point(body, end)
        )
    t = wall_near(beyond(distance, thickness), parameters.inverse_wall)
    wall_part, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
    push = wall_push(multiplier, weight, slope, rate(wall_part, total), parameters.inverse_dt)
    speed = rebound((vx, vy, vz), (ux, uy, uz), (wx, wy, wz), (nx, ny, nz), push)
    total = joined_density(total, wall_part)
    return total, without(vx, speed, nx), without(vy, speed, ny), without(vz, speed, nz)


at_plane, at_sphere, at_capsule, at_box, at_mesh, at_field = (
    filled(settle_at, {"away": each, "turns": each in (from_mesh, from_field)})
    for each in (from_plane, from_sphere, from_capsule, from_box, from_mesh, from_field)
)


@routine
def settled(at, world, q, v, u, multiplier, weight):
    """Return the velocity v of a particle at q without the rebound from walls; u: that before corrections."""
    if not multiplier < 0.0:
        return v
    parameters, bodies, kinds = world.parameters, world.bodies, world.kinds
    (qx, qy, qz), (vx, vy, vz), (ux, uy, uz) = q, v, u
    total, (_, end, _) = 0.0, instants(at.number, parameters)
    arguments = parameters, end, qx, qy, qz, ux, uy, uz, multiplier, weight
    for b in range(kinds.size):
        body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
        if FEATURE.plane and kinds[b] == PLANE:
            total, vx, vy, vz = at_plane(body, arguments, total, vx, vy, vz)
        if FEATURE.sphere and kinds[b] == SPHERE:
            total, vx, vy, vz = at_sphere(body, arguments, total, vx, vy, vz)
        if FEATURE.capsule and kinds[b] == CAPSULE:
            total, vx, vy, vz = at_capsule(body, arguments, total, vx, vy, vz)
        if FEATURE.box and kinds[b] == BOX:
            total, vx, vy, vz = at_box(body, arguments, total, vx, vy, vz)
        if FEATURE.mesh_collider and kinds[b] == MESH:
            total, vx, vy, vz = at_mesh(body, arguments, total, vx, vy, vz)
        if FEATURE.distance_field and kinds[b] == FIELD:
            total, vx, vy, vz = at_field(body, arguments, total, vx, vy, vz)
    return vx, vy, vz
