"""What walls add to a fluid's density, one particle at a time (model/fluid/plan.py, at its end)."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.contact.colliders import CAPSULE, FIELD, MESH, PLANE, SPHERE, make_push
from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from model.fluid.plan import WALLS
from model.formulas import colliders
from model.formulas.fluid import density, surfaces
from model.mass_spring.cloth_parameters import (
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


def make_walls(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """walls(bodies, kinds, time, parameters, x, y, z) -> (density, gradient of it, three): of all at `time` [s]."""
    compiled = compiler.compiled
    distances, formulas = colliders.make(real, compiled), density.make(real, compiled)
    point = make_push(compiler, real, parts).point
    plane, sphere, capsule, box = distances.plane, distances.sphere, distances.capsule, distances.box
    beyond, wall_near, wall_density = formulas.beyond, formulas.wall_near, formulas.wall_density
    wall_slope, joined_density, joined_gradient = formulas.wall_slope, formulas.joined_density, formulas.joined_gradient
    surface = surfaces.make(real, compiled)
    mesh, field = surface.mesh_collider, surface.distance_field
    has_plane, has_sphere, has_capsule, _, has_mesh, has_field = (kind in parts for kind in WALLS)
    zero = real(0)

    @compiled
    def beyond_surface(body, away, time, reach, x, y, z):
        """Of one made from a mesh; `away`: of model/formulas/fluid/surfaces.py."""
        return away(
            body, np.int32(body[B_TREE]), body[B_X], body[B_Y], body[B_Z], body[B_VX], body[B_VY], body[B_VZ], body[B_U],
            body[B_V], body[B_W], body[B_SPIN], body[B_TURNS], time, x, y, z, reach,
        )  # fmt: skip

    @compiled
    def away(body, kind, time, reach, x, y, z):
        """(distance, normal) of a place from the surface of a collider; `reach` where one made from a mesh is farther."""
        if has_mesh and kind == MESH:
            return beyond_surface(body, mesh, time, reach, x, y, z)
        if has_field and kind == FIELD:
            return beyond_surface(body, field, time, reach, x, y, z)
        cx, cy, cz = point(body, time)
        dx, dy, dz = x - cx, y - cy, z - cz
        if has_plane and kind == PLANE:
            return plane(dx, dy, dz, body[B_U], body[B_V], body[B_W])
        if has_sphere and kind == SPHERE:
            return sphere(dx, dy, dz, body[B_RADIUS])
        if has_capsule and kind == CAPSULE:
            return capsule(dx, dy, dz, body[B_U], body[B_V], body[B_W], body[B_RADIUS])
        return box(dx, dy, dz, body[B_U], body[B_V], body[B_W])

    @compiled
    def walls(bodies, kinds, time, parameters, x, y, z):
        total, gx, gy, gz = zero, zero, zero, zero
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            distance, nx, ny, nz = away(body, kinds[b], time, parameters.support + body[B_THICKNESS], x, y, z)
            t = wall_near(beyond(distance, body[B_THICKNESS]), parameters.inverse_support)
            if t > zero:
                share, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
                gx = joined_gradient(gx, total, slope, share, nx)
                gy = joined_gradient(gy, total, slope, share, ny)
                gz = joined_gradient(gz, total, slope, share, nz)
                total = joined_density(total, share)
        return total, gx, gy, gz

    return walls
