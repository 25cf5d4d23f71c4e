"""What walls add to a fluid's density, one particle at a time (model/fluid/plan.py, at its end)."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.contact.colliders import BOX, CAPSULE, PLANE, SPHERE, make_push
from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from model.fluid.plan import WALLS
from model.formulas import colliders
from model.formulas.fluid import density
from model.mass_spring.cloth_parameters import (
    B_RADIUS,
    B_THICKNESS,
    B_U,
    B_V,
    B_W,
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
    has_plane, has_sphere, has_capsule, has_box = (kind in parts for kind in WALLS)
    zero = real(0)

    @compiled
    def away(body, kind, dx, dy, dz):
        """(distance, normal) of a place from the surface of a collider that is at 0."""
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
            kind = kinds[b]
            is_wall = (
                (has_plane and kind == PLANE) or (has_sphere and kind == SPHERE) or (has_capsule and kind == CAPSULE)
            ) or (has_box and kind == BOX)  # fmt: skip
            if not is_wall:
                continue
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            cx, cy, cz = point(body, time)
            distance, nx, ny, nz = away(body, kind, x - cx, y - cy, z - cz)
            t = wall_near(beyond(distance, body[B_THICKNESS]), parameters.inverse_support)
            if t > zero:
                share, slope = wall_density(t, parameters.wall_scale), wall_slope(t, parameters.wall_gradient)
                gx = joined_gradient(gx, total, slope, share, nx)
                gy = joined_gradient(gy, total, slope, share, ny)
                gz = joined_gradient(gz, total, slope, share, nz)
                total = joined_density(total, share)
        return total, gx, gy, gz

    return walls
