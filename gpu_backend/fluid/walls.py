"""Effects of colliders on a fluid on CUDA: their contribution to density and its gradient, and velocities without the
rebound from walls."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.contact.colliders import place_of
from softlab.gpu_backend.contact.rows import (
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
    FIRST_ROW,
    ROW,
)
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, FIELDS, MESHES, PLANES, SPHERES
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.colliders import box, capsule, plane, sphere
from softlab.model.formulas.fluid.density import (
    beyond,
    joined_density,
    joined_gradient,
    rate,
    wall_density,
    wall_near,
    wall_slope,
)
from softlab.model.formulas.fluid.impact import rebound, surface_velocity, wall_push, without
from softlab.model.formulas.fluid.surfaces import distance_field, mesh_collider

away = Open("away(bodies, tree, path, time, position, max_distance): the formula of a collider made from a mesh")
visit = Open("visit(sums, surface, bodies, at, end, parameters, turns, arguments): the four sums with a collider")


@inlined_routine
def offset(p, bodies, at, time):
    """Return the vector from the collider's point at `time` to the particle."""
    x, y, z = place_of(bodies, at, time)
    return p[0] - x, p[1] - y, p[2] - z


@inlined_routine
def surface_of_mesh(p, bodies, at, time, parameters):
    """Return (distance, nx, ny, nz) of a particle at p (a quad) from a collider made from a mesh."""
    path = (
        (bodies[at + B_X], bodies[at + B_Y], bodies[at + B_Z]),
        (bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]),
        (bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]), bodies[at + B_SPIN], bodies[at + B_TURNS],
    )  # fmt: skip
    place = np.int32(np.int32(at) + np.int32(bodies[at + B_TREE]))
    return away(bodies, place, path, time, (p[0], p[1], p[2]), parameters.support + bodies[at + B_THICKNESS])


mesh = filled(surface_of_mesh, {"away": mesh_collider})
field = filled(surface_of_mesh, {"away": distance_field})


@inlined_routine
def over_walls(sums, p, world, step, arguments):
    """Apply `visit` to four numbers, collider by collider.

    `surface`: (distance, nx, ny, nz) of a particle at p (a quad) from the collider whose row begins at `at`, at the end
    of substep `step`, the time `end`; `turns`: true if such colliders may turn.
    """
    parameters, bodies, integers, at = world.parameters, world.colliders, world.integers, FIRST_ROW
    end = instant(step + 1, parameters.dt, parameters.first_step, parameters.first_time)
    if FEATURE.plane:
        for _ in range(np.int32(integers[PLANES])):
            dx, dy, dz = offset(p, bodies, at, end)
            surface = plane(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
            sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
    if FEATURE.sphere:
        for _ in range(np.int32(integers[SPHERES])):
            dx, dy, dz = offset(p, bodies, at, end)
            surface = sphere(dx, dy, dz, bodies[at + B_RADIUS])
            sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
    if FEATURE.capsule:
        for _ in range(np.int32(integers[CAPSULES])):
            dx, dy, dz = offset(p, bodies, at, end)
            ex, ey, ez = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
            surface = capsule(dx, dy, dz, ex, ey, ez, bodies[at + B_RADIUS])
            sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
    if FEATURE.box:
        for _ in range(np.int32(integers[BOXES])):
            dx, dy, dz = offset(p, bodies, at, end)
            surface = box(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
            sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
    if FEATURE.mesh_collider:
        for _ in range(np.int32(integers[MESHES])):
            surface = mesh(p, bodies, at, end, parameters)
            sums, at = visit(sums, surface, bodies, at, end, parameters, True, arguments), np.uint64(at + ROW)
    if FEATURE.distance_field:
        for _ in range(np.int32(integers[FIELDS])):
            surface = field(p, bodies, at, end, parameters)
            sums, at = visit(sums, surface, bodies, at, end, parameters, True, arguments), np.uint64(at + ROW)
    return sums


@inlined_routine
def joined(so_far, surface, bodies, at, end, parameters, turns, nothing):
    """Add one more wall to the sums of density and gradient."""
    total, gx, gy, gz = so_far
    t = wall_near(beyond(surface[0], bodies[at + B_THICKNESS]), parameters.inverse_wall)
    wall_part, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
    gx = joined_gradient(gx, total, slope, wall_part, surface[1])
    gy = joined_gradient(gy, total, slope, wall_part, surface[2])
    gz = joined_gradient(gz, total, slope, wall_part, surface[3])
    return joined_density(total, wall_part), gx, gy, gz


over_joined = filled(over_walls, {"visit": joined})


@inlined_routine
def walls(p, world, step):
    """Return (density, gx, gy, gz), which all colliders that are walls contribute to the constraint of a particle at p (a
    quad), at the end of substep `step` (model/fluid/plan.py)."""
    return over_joined((0.0, 0.0, 0.0, 0.0), p, world, step, 0.0)


@inlined_routine
def settle(so_far, surface, bodies, at, end, parameters, turns, arguments):
    """Remove the rebound from one more wall from a velocity."""
    total, vx, vy, vz = so_far
    q, u, multiplier, weight = arguments
    distance, nx, ny, nz = surface
    wx, wy, wz = bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]
    if turns:
        axis = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
        wx, wy, wz = surface_velocity((wx, wy, wz), bodies[at + B_SPIN], axis, q, place_of(bodies, at, end))
    t = wall_near(beyond(distance, bodies[at + B_THICKNESS]), parameters.inverse_wall)
    wall_part, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
    push = wall_push(multiplier, weight, slope, rate(wall_part, total), parameters.inverse_dt)
    speed = rebound((vx, vy, vz), u, (wx, wy, wz), (nx, ny, nz), push)
    return joined_density(total, wall_part), without(vx, speed, nx), without(vy, speed, ny), without(vz, speed, nz)


over_settled = filled(over_walls, {"visit": settle})


@inlined_routine
def settled(q, v, u, multiplier, weight, world, step):
    """Return v without the rebound from walls.

    q, v, u: three numbers each, the position after the walls, the velocity, and that before corrections
    (model/formulas/fluid/impact.py).
    """
    if not multiplier < 0.0:
        return v
    _, vx, vy, vz = over_settled((0.0, v[0], v[1], v[2]), q, world, step, (q, u, multiplier, weight))
    return vx, vy, vz
