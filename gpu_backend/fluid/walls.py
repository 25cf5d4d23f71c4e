"""Effects of colliders on a fluid on CUDA: their contribution to density and its gradient, and velocities without the
rebound from walls."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.gpu_backend.contact.colliders import make_place_of
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
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, FIELDS, MESHES, PLANES, SPHERES
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, colliders
from softlab.model.formulas.fluid import density, impact, surfaces


@cache
def make_walls(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make walls(p, world, step) -> (density, gx, gy, gz).

    It returns what all colliders that are walls contribute to the constraint of a particle at p (a quad), at the end of
    substep `step` (model/fluid/plan.py).
    """
    sums, zero = device_formulas(density, real, math), real(0)
    wall_density, wall_slope, wall_near, beyond = sums.wall_density, sums.wall_slope, sums.wall_near, sums.beyond
    joined_density, joined_gradient, inline = sums.joined_density, sums.joined_gradient, inlined(math)

    @inline
    def joined(so_far, surface, bodies, at, end, parameters, turns, nothing):
        total, gx, gy, gz = so_far
        t = wall_near(beyond(surface[0], bodies[at + B_THICKNESS]), parameters.inverse_wall)
        wall_part, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
        gx = joined_gradient(gx, total, slope, wall_part, surface[1])
        gy = joined_gradient(gy, total, slope, wall_part, surface[2])
        gz = joined_gradient(gz, total, slope, wall_part, surface[3])
        return joined_density(total, wall_part), gx, gy, gz

    each = _make_each_wall(real, math, parts, joined)

    @inline
    def walls(p, world, step):
        return each((zero, zero, zero, zero), p, world, step, zero)

    return walls


def _make_each_wall(real: Real, math: str, parts: frozenset[str], visit: Callable) -> Callable:
    """Make each(so_far, p, world, step, arguments): it applies visit(so_far, surface, bodies, at, end, parameters, turns,
    given) to four numbers, collider by collider.

    `surface`: (distance, nx, ny, nz) of a particle at p (a quad) from the collider whose row begins at `at`, at the end
    of substep `step`, the time `end`; `turns`: true if such colliders may turn.
    """
    distances, inline = device_formulas(colliders, real, math), inlined(math)
    plane, sphere, capsule, box = distances.plane, distances.sphere, distances.capsule, distances.box
    instant, next_one = device_formulas(cloth, real, math).instant, np.int64(1)
    place_of = make_place_of(real, math)
    has_planes, has_spheres, has_capsules, has_boxes = (kind in parts for kind in ("plane", "sphere", "capsule", "box"))
    (mesh, field), has_meshes, has_fields = surfaces_of(real, math), "mesh_collider" in parts, "distance_field" in parts

    @inline
    def offset(p, bodies, at, time):
        """Return the vector from the collider's point at `time` to the particle."""
        x, y, z = place_of(bodies, at, time)
        return p[0] - x, p[1] - y, p[2] - z

    @inline
    def each(sums, p, world, step, arguments):
        parameters, bodies, integers, at = world.parameters, world.colliders, world.integers, FIRST_ROW
        end = instant(step + next_one, parameters.dt, parameters.first_step, parameters.first_time)
        if has_planes:
            for _ in range(np.int32(integers[PLANES])):
                dx, dy, dz = offset(p, bodies, at, end)
                surface = plane(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
                sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
        if has_spheres:
            for _ in range(np.int32(integers[SPHERES])):
                dx, dy, dz = offset(p, bodies, at, end)
                surface = sphere(dx, dy, dz, bodies[at + B_RADIUS])
                sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
        if has_capsules:
            for _ in range(np.int32(integers[CAPSULES])):
                dx, dy, dz = offset(p, bodies, at, end)
                ex, ey, ez = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
                surface = capsule(dx, dy, dz, ex, ey, ez, bodies[at + B_RADIUS])
                sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
        if has_boxes:
            for _ in range(np.int32(integers[BOXES])):
                dx, dy, dz = offset(p, bodies, at, end)
                surface = box(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
                sums, at = visit(sums, surface, bodies, at, end, parameters, False, arguments), np.uint64(at + ROW)
        if has_meshes:
            for _ in range(np.int32(integers[MESHES])):
                surface = mesh(p, bodies, at, end, parameters)
                sums, at = visit(sums, surface, bodies, at, end, parameters, True, arguments), np.uint64(at + ROW)
        if has_fields:
            for _ in range(np.int32(integers[FIELDS])):
                surface = field(p, bodies, at, end, parameters)
                sums, at = visit(sums, surface, bodies, at, end, parameters, True, arguments), np.uint64(at + ROW)
        return sums

    return each


@cache
def make_settled(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make settled(q, v, u, multiplier, weight, world, step): v without the rebound from walls.

    q, v, u: three numbers each, the position after the walls, the velocity, and that before corrections
    (model/formulas/fluid/impact.py).
    """
    f, g = device_formulas(density, real, math), device_formulas(impact, real, math)
    beyond, wall_near, wall_density, wall_slope = f.beyond, f.wall_near, f.wall_density, f.wall_slope
    joined_density, rate, wall_push = f.joined_density, f.rate, g.wall_push
    rebound, without, surface_velocity = g.rebound, g.without, g.surface_velocity
    inline, place_of, zero = inlined(math), make_place_of(real, math), real(0)

    @inline
    def settle(so_far, surface, bodies, at, end, parameters, turns, arguments):
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

    each = _make_each_wall(real, math, parts, settle)

    @inline
    def settled(q, v, u, multiplier, weight, world, step):
        if not multiplier < zero:
            return v
        _, vx, vy, vz = each((zero, v[0], v[1], v[2]), q, world, step, (q, u, multiplier, weight))
        return vx, vy, vz

    return settled


def surfaces_of(real: Real, math: str) -> tuple[Any, Any]:
    """Make (mesh, field)(p, bodies, at, time, parameters) -> (distance, nx, ny, nz) of a particle at p (a quad) from a
    collider made from a mesh, whose row begins at `at`."""
    formulas, inline = device_formulas(surfaces, real, math), inlined(math)

    def of(away: Callable) -> Callable:
        @inline
        def surface(p, bodies, at, time, parameters):
            path = (
                (bodies[at + B_X], bodies[at + B_Y], bodies[at + B_Z]),
                (bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]),
                (bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]), bodies[at + B_SPIN], bodies[at + B_TURNS],
            )  # fmt: skip
            place = np.int32(np.int32(at) + np.int32(bodies[at + B_TREE]))
            return away(bodies, place, path, time, (p[0], p[1], p[2]), parameters.support + bodies[at + B_THICKNESS])

        return surface

    return of(formulas.mesh_collider), of(formulas.distance_field)
