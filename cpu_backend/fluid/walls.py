"""Contribution of walls to a fluid's density, LANES particles at a time (model/fluid/plan.py, Walls). A wall beyond its
range contributes zeros."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.contact.colliders import BOX, CAPSULE, FIELD, MESH, PLANE, SPHERE, make_push
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.types import Real
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
from softlab.model.fluid.plan import WALLS
from softlab.model.formulas import colliders
from softlab.model.formulas.fluid import density, surfaces


def make_wall_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make wall_rows(bodies, kinds, time, parameters, x, y, z, wall_part, gx, gy, gz).

    It writes what all colliders at `time` [s] contribute to the density of LANES particles, and its gradient.
    """
    row_of = _make_rows(compiler, real, parts)
    rows = {kind: row_of(away) for kind, away in make_aways(compiler, real, parts).items()}
    plane, sphere, capsule, box, mesh, field = (rows[kind] for kind in WALLS)
    has_plane, has_sphere, has_capsule, has_box, has_mesh, has_field = (kind in parts for kind in WALLS)
    zero = real(0)

    @compiler.compiled
    def wall_rows(bodies, kinds, time, parameters, x, y, z, wall_part, gx, gy, gz):
        for lane in range(LANES):
            wall_part[lane], gx[lane], gy[lane], gz[lane] = zero, zero, zero, zero
        scales = parameters.support, parameters.inverse_wall, parameters.wall_scale, parameters.wall_gradient
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            if has_plane and kinds[b] == PLANE:
                plane(body, time, *scales, x, y, z, wall_part, gx, gy, gz)
            if has_sphere and kinds[b] == SPHERE:
                sphere(body, time, *scales, x, y, z, wall_part, gx, gy, gz)
            if has_capsule and kinds[b] == CAPSULE:
                capsule(body, time, *scales, x, y, z, wall_part, gx, gy, gz)
            if has_box and kinds[b] == BOX:
                box(body, time, *scales, x, y, z, wall_part, gx, gy, gz)
            if has_mesh and kinds[b] == MESH:
                mesh(body, time, *scales, x, y, z, wall_part, gx, gy, gz)
            if has_field and kinds[b] == FIELD:
                field(body, time, *scales, x, y, z, wall_part, gx, gy, gz)

    return wall_rows


def make_aways(compiler: Compiler, real: Real, parts: frozenset[str]) -> dict[str, Callable]:
    """Make, by kind, away(body, time, reach, x, y, z) -> (distance, normal) of a position from a collider's surface.

    Colliders made from a mesh return `max_distance` where the surface is farther.
    """
    compiled, distances = compiler.compiled, compiler.formulas(colliders, real)
    plane, sphere, capsule, box = distances.plane, distances.sphere, distances.capsule, distances.box
    surface, point = compiler.formulas(surfaces, real), make_push(compiler, real, parts).point

    def of_surface(away_from: Callable) -> Callable:
        @compiled
        def away(body, time, max_distance, x, y, z):
            path = (
                (body[B_X], body[B_Y], body[B_Z]), (body[B_VX], body[B_VY], body[B_VZ]),
                (body[B_U], body[B_V], body[B_W]), body[B_SPIN], body[B_TURNS],
            )  # fmt: skip
            return away_from(body, np.int32(body[B_TREE]), path, time, (x, y, z), max_distance)

        return away

    @compiled
    def from_plane(body, time, max_distance, x, y, z):
        cx, cy, cz = point(body, time)
        return plane(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W])

    @compiled
    def from_sphere(body, time, max_distance, x, y, z):
        cx, cy, cz = point(body, time)
        return sphere(x - cx, y - cy, z - cz, body[B_RADIUS])

    @compiled
    def from_capsule(body, time, max_distance, x, y, z):
        cx, cy, cz = point(body, time)
        return capsule(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W], body[B_RADIUS])

    @compiled
    def from_box(body, time, max_distance, x, y, z):
        cx, cy, cz = point(body, time)
        return box(x - cx, y - cy, z - cz, body[B_U], body[B_V], body[B_W])

    aways = from_plane, from_sphere, from_capsule, from_box, of_surface(surface.mesh_collider)
    return dict(zip(WALLS, (*aways, of_surface(surface.distance_field)), strict=True))


def _make_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make row_of(away) -> row(body, time, support, inverse_range, wall_scale, wall_gradient, x, y, z, share, gx, gy,
    gz).

    It adds one more collider, LANES particles at a time.
    """
    formulas = compiler.formulas(density, real)
    beyond, wall_near, wall_density = formulas.beyond, formulas.wall_near, formulas.wall_density
    wall_slope, joined_density, joined_gradient = formulas.wall_slope, formulas.joined_density, formulas.joined_gradient

    def row_of(away: Callable) -> Callable:
        @compiler.row
        def row(body, time, support, inverse_range, scale, gradient, x, y, z, wall_part, gx, gy, gz):
            thickness = body[B_THICKNESS]
            for lane in range(LANES):
                distance, nx, ny, nz = away(body, time, support + thickness, x[lane], y[lane], z[lane])
                t = wall_near(beyond(distance, thickness), inverse_range)
                more, slope = wall_density(t, scale), wall_slope(t, gradient)
                gx[lane] = joined_gradient(gx[lane], wall_part[lane], slope, more, nx)
                gy[lane] = joined_gradient(gy[lane], wall_part[lane], slope, more, ny)
                gz[lane] = joined_gradient(gz[lane], wall_part[lane], slope, more, nz)
                wall_part[lane] = joined_density(wall_part[lane], more)

        return row

    return row_of
