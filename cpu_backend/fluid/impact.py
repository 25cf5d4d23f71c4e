"""Velocities of fluid particles at walls, on CPU threads (model/fluid/plan.py, 1 and 6)."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import (
    BOX,
    CAPSULE,
    FIELD,
    MESH,
    PLANE,
    SPHERE,
    make_collide_mass,
    make_instants,
    make_push,
)
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.walls import make_aways
from softlab.model.base.types import Real
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
from softlab.model.fluid.plan import WALLS
from softlab.model.formulas.fluid import density, impact, motion


def make_impact(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `impact` and `settled` (model/formulas/fluid/impact.py).

    `impact(bodies, kinds, number, parameters, b (3), u (3), p (3), v (3), most)` returns the position (3) and velocity
    (3) of a particle after the colliders, if it moves from b at the predicted velocity u, and its velocity (3) at p,
    which is v if no collider was in its way. `settled(bodies, kinds, number, parameters, q (3), v (3), u (3),
    multiplier, weight)` returns the velocity (3) without the rebound from walls.
    """
    compiled, m = compiler.compiled, compiler.formulas(motion, real)
    drifted, limited_change, speed_of = m.drifted, m.limited_change, m.speed_of
    after_impact, is_limited = compiler.formulas(impact, real).after_impact, "held-back" in parts
    touch = make_collide_mass(compiler, real, parts)

    @compiled
    def impact_of(bodies, kinds, number, parameters, bx, by, bz, ux, uy, uz, px, py, pz, vx, vy, vz, most):
        h, rate = parameters.dt, parameters.inverse_dt
        x, y, z = drifted(bx, ux, h), drifted(by, uy, h), drifted(bz, uz, h)
        (qx, qy, qz), (ux, uy, uz) = touch(bodies, kinds, number, parameters, (bx, by, bz), (x, y, z), (ux, uy, uz))
        if qx != x or qy != y or qz != z:
            vx, vy = after_impact(ux, px, qx, rate), after_impact(uy, py, qy, rate)
            vz = after_impact(uz, pz, qz, rate)
            if is_limited:
                far = speed_of(vx - ux, vy - uy, vz - uz)
                vx, vy, vz = (
                    limited_change(vx, ux, far, most),
                    limited_change(vy, uy, far, most),
                    limited_change(vz, uz, far, most),
                )
        return qx, qy, qz, ux, uy, uz, vx, vy, vz

    return SimpleNamespace(impact=impact_of, settled=_make_settled(compiler, real, parts))


def _make_settled(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    compiled, zero, one_wall = compiler.compiled, real(0), _make_one_wall(compiler, real, parts)
    plane, sphere, capsule, box, mesh, field = (one_wall(kind) for kind in WALLS)
    has_plane, has_sphere, has_capsule, has_box, has_mesh, has_field = (kind in parts for kind in WALLS)
    instants = make_instants(compiler, real, parts)

    @compiled
    def settled(bodies, kinds, number, parameters, qx, qy, qz, vx, vy, vz, ux, uy, uz, multiplier, weight):
        if not multiplier < zero:
            return vx, vy, vz
        total, (_, end, _) = zero, instants(number, parameters)
        arguments = parameters, end, qx, qy, qz, ux, uy, uz, multiplier, weight
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            if has_plane and kinds[b] == PLANE:
                total, vx, vy, vz = plane(body, arguments, total, vx, vy, vz)
            if has_sphere and kinds[b] == SPHERE:
                total, vx, vy, vz = sphere(body, arguments, total, vx, vy, vz)
            if has_capsule and kinds[b] == CAPSULE:
                total, vx, vy, vz = capsule(body, arguments, total, vx, vy, vz)
            if has_box and kinds[b] == BOX:
                total, vx, vy, vz = box(body, arguments, total, vx, vy, vz)
            if has_mesh and kinds[b] == MESH:
                total, vx, vy, vz = mesh(body, arguments, total, vx, vy, vz)
            if has_field and kinds[b] == FIELD:
                total, vx, vy, vz = field(body, arguments, total, vx, vy, vz)
        return vx, vy, vz

    return settled


def _make_one_wall(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make one_wall(kind) -> settle(body, given, total, vx, vy, vz), which returns (total, velocity) after one more
    collider. `total` is the wall density of the colliders so far."""
    compiled, f, g = compiler.compiled, compiler.formulas(density, real), compiler.formulas(impact, real)
    beyond, wall_near, wall_density, wall_slope = f.beyond, f.wall_near, f.wall_density, f.wall_slope
    joined_density, rate, wall_push = f.joined_density, f.rate, g.wall_push
    rebound, without, surface_velocity = g.rebound, g.without, g.surface_velocity
    aways, point = make_aways(compiler, real, parts), make_push(compiler, real, parts).point

    def one_wall(kind: str) -> Callable:
        away, turns = aways[kind], kind in ("mesh_collider", "distance_field")

        @compiled
        def settle(body, arguments, total, vx, vy, vz):
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

        return settle

    return one_wall
