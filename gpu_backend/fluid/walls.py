"""What colliders add to a fluid's density, on CUDA: the share of their half spaces, and its gradient."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gpu_backend.contact.colliders import make_place_of
from gpu_backend.contact.rows import (
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
from gpu_backend.core.compile import inlined
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.integers import BOXES, CAPSULES, FIELDS, MESHES, PLANES, SPHERES
from model.formulas import cloth, colliders
from model.formulas.fluid import density, surfaces


@cache
def make_walls(real: Any, math: str, parts: frozenset[str]) -> Any:
    """walls(p, world, step) -> (density, gx, gy, gz): what all colliders that are walls add to the constraint of a
    particle at p (a quad), as they are at the end of substep `step`; see model/fluid/plan.py."""
    distances, sums = device_formulas(colliders.make, real, math), device_formulas(density.make, real, math)
    plane, sphere, capsule, box = distances.plane, distances.sphere, distances.capsule, distances.box
    wall_density, wall_slope, wall_near, beyond = sums.wall_density, sums.wall_slope, sums.wall_near, sums.beyond
    joined_density, joined_gradient = sums.joined_density, sums.joined_gradient
    instant, inline, zero, next_one = (
        device_formulas(cloth.make, real, math).instant,
        inlined(math),
        real(0),
        np.int64(1),
    )
    place_of = make_place_of(real, math)
    has_planes, has_spheres, has_capsules, has_boxes = (kind in parts for kind in ("plane", "sphere", "capsule", "box"))
    (mesh, field), has_meshes, has_fields = surfaces_of(real, math), "mesh_collider" in parts, "distance_field" in parts

    @inline
    def way(p, bodies, at, time):
        """From the collider's point at `time` to the particle."""
        x, y, z = place_of(bodies, at, time)
        return p[0] - x, p[1] - y, p[2] - z

    @inline
    def joined(so_far, surface, bodies, at, parameters):
        total, gx, gy, gz = so_far
        t = wall_near(beyond(surface[0], bodies[at + B_THICKNESS]), parameters.inverse_wall)
        share, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
        gx = joined_gradient(gx, total, slope, share, surface[1])
        gy = joined_gradient(gy, total, slope, share, surface[2])
        gz = joined_gradient(gz, total, slope, share, surface[3])
        return joined_density(total, share), gx, gy, gz

    @inline
    def walls(p, world, step):
        parameters, bodies, integers = world.parameters, world.colliders, world.integers
        found, at = (zero, zero, zero, zero), FIRST_ROW
        end = instant(step + next_one, parameters.dt, parameters.first_step, parameters.first_time)
        if has_planes:
            for _ in range(np.int32(integers[PLANES])):
                dx, dy, dz = way(p, bodies, at, end)
                surface = plane(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
                found, at = joined(found, surface, bodies, at, parameters), np.uint64(at + ROW)
        if has_spheres:
            for _ in range(np.int32(integers[SPHERES])):
                dx, dy, dz = way(p, bodies, at, end)
                surface = sphere(dx, dy, dz, bodies[at + B_RADIUS])
                found, at = joined(found, surface, bodies, at, parameters), np.uint64(at + ROW)
        if has_capsules:
            for _ in range(np.int32(integers[CAPSULES])):
                dx, dy, dz = way(p, bodies, at, end)
                ex, ey, ez = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
                surface = capsule(dx, dy, dz, ex, ey, ez, bodies[at + B_RADIUS])
                found, at = joined(found, surface, bodies, at, parameters), np.uint64(at + ROW)
        if has_boxes:
            for _ in range(np.int32(integers[BOXES])):
                dx, dy, dz = way(p, bodies, at, end)
                surface = box(dx, dy, dz, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
                found, at = joined(found, surface, bodies, at, parameters), np.uint64(at + ROW)
        if has_meshes:
            for _ in range(np.int32(integers[MESHES])):
                found = joined(found, mesh(p, bodies, at, end, parameters), bodies, at, parameters)
                at = np.uint64(at + ROW)
        if has_fields:
            for _ in range(np.int32(integers[FIELDS])):
                found = joined(found, field(p, bodies, at, end, parameters), bodies, at, parameters)
                at = np.uint64(at + ROW)
        return found

    return walls


def surfaces_of(real: Any, math: str) -> tuple[Any, Any]:
    """(mesh, field)(p, bodies, at, time, parameters) -> (distance, nx, ny, nz) of a particle at p (a quad) from a collider
    made from a mesh, whose row begins at `at`."""
    found, inline = device_formulas(surfaces.make, real, math), inlined(math)

    def of(away: Any) -> Any:
        @inline
        def surface(p, bodies, at, time, parameters):
            return away(
                bodies, np.int32(np.int32(at) + np.int32(bodies[at + B_TREE])), bodies[at + B_X], bodies[at + B_Y],
                bodies[at + B_Z], bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ], bodies[at + B_U], bodies[at + B_V],
                bodies[at + B_W], bodies[at + B_SPIN], bodies[at + B_TURNS], time, p[0], p[1], p[2],
                parameters.support + bodies[at + B_THICKNESS],
            )  # fmt: skip

        return surface

    return of(found.mesh_collider), of(found.distance_field)
