"""Contribution of walls to a fluid's density, LANES particles at a time (model/fluid/plan.py, Walls). A wall beyond its
range contributes zeros."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import BOX, CAPSULE, FIELD, MESH, PLANE, SPHERE, point
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.variant import FEATURE, Open, filled, routine, row_routine
from softlab.model.contact.cloth_parameters import (
    B_RADIUS,
    B_SPIN,
    B_THICKNESS,
    B_TREE,
    B_TURNS,
    B_U,
    B_V,
    B_VX,
    B_VY,
    B_VZ,
    B_W,
    B_X,
    B_Y,
    B_Z,
    COLLIDER_FIELDS,
)
from softlab.model.formulas.colliders import box, capsule, plane, sphere
from softlab.model.formulas.fluid.density import (
    beyond,
    joined_density,
    joined_gradient,
    wall_density,
    wall_near,
    wall_slope,
)
from softlab.model.formulas.fluid.surfaces import distance_field, mesh_collider

surface = Open("surface(body, tree, path, time, position, max_distance): the formula of a collider made from a mesh")
away = Open("away(body, time, max_distance, x, y, z): (distance, normal) of a position from a collider's surface")


@routine
def from_plane(body, time, max_distance, x, y, z):
    cx, cy, cz = point(body, time)
    return plane(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W])


@routine
def from_sphere(body, time, max_distance, x, y, z):
    cx, cy, cz = point(body, time)
    return sphere(x - cx, y - cy, z - cz, body[B_RADIUS])


@routine
def from_capsule(body, time, max_distance, x, y, z):
    cx, cy, cz = point(body, time)
    return capsule(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W], body[B_RADIUS])


@routine
def from_box(body, time, max_distance, x, y, z):
    cx, cy, cz = point(body, time)
    return box(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W])


@routine
def from_surface(body, time, max_distance, x, y, z):
    """Return (distance, normal) of a position from a collider made from a mesh; `max_distance` beyond it."""
    path = (
        (body[B_X], body[B_Y], body[B_Z]), (body[B_VX], body[B_VY], body[B_VZ]),
        (body[B_U], body[B_V], body[B_W]), body[B_SPIN], body[B_TURNS],
    )  # fmt: skip
    return surface(body, np.int32(body[B_TREE]), path, time, (x, y, z), max_distance)


from_mesh = filled(from_surface, {"surface": mesh_collider})
from_field = filled(from_surface, {"surface": distance_field})


@row_routine
def wall_row(body, time, scales, position, wall_part, gradients):
    """Add one more collider, LANES particles at a time."""
    (support, inverse_range, scale, gradient), (x, y, z), (gx, gy, gz) = scales, position, gradients
    thickness = body[B_THICKNESS]
    for lane in range(LANES):
        distance, nx, ny, nz = away(body, time, support + thickness, x[lane], y[lane], z[lane])
        t = wall_near(beyond(distance, thickness), inverse_range)
        more, slope = wall_density(t, scale), wall_slope(t, gradient)
        gx[lane] = joined_gradient(gx[lane], wall_part[lane], slope, more, nx)
        gy[lane] = joined_gradient(gy[lane], wall_part[lane], slope, more, ny)
        gz[lane] = joined_gradient(gz[lane], wall_part[lane], slope, more, nz)
        wall_part[lane] = joined_density(wall_part[lane], more)


plane_row, sphere_row, capsule_row, box_row, mesh_row, field_row = (
    filled(wall_row, {"away": each})
    for each in (from_plane, from_sphere, from_capsule, from_box, from_mesh, from_field)
)


@routine
def wall_rows(time, world, position, wall_part, gradients):
    """Write the contribution of all colliders at `time` [s] to the density of LANES particles, and its gradient."""
    parameters, bodies, kinds, (gx, gy, gz) = world.parameters, world.bodies, world.kinds, gradients
    for lane in range(LANES):
        wall_part[lane], gx[lane], gy[lane], gz[lane] = 0.0, 0.0, 0.0, 0.0
    scales = parameters.support, parameters.inverse_wall, parameters.wall_scale, parameters.wall_gradient
    for b in range(kinds.size):
        body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
        if FEATURE.plane and kinds[b] == PLANE:
            plane_row(body, time, scales, position, wall_part, gradients)
        if FEATURE.sphere and kinds[b] == SPHERE:
            sphere_row(body, time, scales, position, wall_part, gradients)
        if FEATURE.capsule and kinds[b] == CAPSULE:
            capsule_row(body, time, scales, position, wall_part, gradients)
        if FEATURE.box and kinds[b] == BOX:
            box_row(body, time, scales, position, wall_part, gradients)
        if FEATURE.mesh_collider and kinds[b] == MESH:
            mesh_row(body, time, scales, position, wall_part, gradients)
        if FEATURE.distance_field and kinds[b] == FIELD:
            field_row(body, time, scales, position, wall_part, gradients)
