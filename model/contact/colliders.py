"""Collisions of a mass with one collider, compiled by both backends."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import FEATURE, Open, filled, routine
from softlab.model.contact.cloth_parameters import (
    B_DYNAMIC,
    B_RADIUS,
    B_RESTITUTION,
    B_SPIN,
    B_STATIC,
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
)
from softlab.model.formulas import distance_field, triangle_tree
from softlab.model.formulas.cloth import between, instant, moved, pushed
from softlab.model.formulas.colliders import (
    box,
    capsule,
    plane,
    rebound,
    respond,
    settling_speed,
    slid,
    sphere,
    sphere_entry,
)
from softlab.model.formulas.fluid.sweep import box_face, capsule_entry

touch_at = Open("touch_at(numbers, place, surface, path, begin, end, a, p, v) -> (p, v)")


@routine
def instants(step, parameters):
    """Return (begin, end, slow): start and end of the step [s], and the settling speed [m/s].

    Below the settling speed nothing bounces; it is 0 without restitution. Where friction acts on positions, `slow` is
    (that speed, the step [s]).
    """
    slow = settling_speed(parameters.gravity, parameters.dt) if FEATURE.restitution else 0.0
    clock = parameters.dt, parameters.first_step, parameters.first_time
    return instant(step, *clock), instant(step + 1, *clock), with_step(slow, parameters.dt)


@routine
def with_step(slow, h):
    return (slow, h) if FEATURE.friction_in_place else slow


@routine
def speed_of(slow):
    return slow[0] if FEATURE.friction_in_place else slow


@routine
def point(body, time):
    """Return the position of a collider at `time` [s]."""
    return (
        moved(body[B_X], body[B_VX], time), moved(body[B_Y], body[B_VY], time), moved(body[B_Z], body[B_VZ], time),
    )  # fmt: skip


@routine
def response(body, slow, v, n):
    """Return the velocity of a mass after contact."""
    static, dynamic = 0.0, 0.0
    if FEATURE.friction:
        static, dynamic = body[B_STATIC], body[B_DYNAMIC]
    u = body[B_VX], body[B_VY], body[B_VZ]
    if FEATURE.restitution:
        return rebound(v, u, n, static, dynamic, body[B_RESTITUTION], speed_of(slow))
    return respond(v, u, n, static, dynamic)


@routine
def push(body, slow, distance, normal, p, v):
    """Push a mass that is inside the collider's thickness out of it."""
    thickness, (nx, ny, nz), (px, py, pz), (vx, vy, vz) = body[B_THICKNESS], normal, p, v
    if distance < thickness:
        depth = thickness - distance
        px, py, pz = pushed(px, depth, nx), pushed(py, depth, ny), pushed(pz, depth, nz)
        vx, vy, vz = response(body, slow, v, normal)
        if FEATURE.friction_in_place:
            dx, dy, dz = slid(slow[1], (vx, vy, vz), v, normal)
            px, py, pz = px + dx, py + dy, pz + dz
    return (px, py, pz), (vx, vy, vz)


# ---------------------------------------------------------------------- one mass and one collider
# `body`: a row of model/contact/cloth_parameters.py, and what follows it; `begin`, `end`: times of the step [s]; `slow`:
# of `instants`; a: position of the mass before the step; p, v: its position and velocity after it.


@routine
def touch_plane(body, begin, end, slow, a, p, v):
    cx, cy, cz = point(body, end)
    distance, nx, ny, nz = plane(p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W])
    return push(body, slow, distance, (nx, ny, nz), p, v)


@routine
def touch_sphere(body, begin, end, slow, a, p, v):
    """Apply the swept test: a mass that enters is put at its entry point, relative to the moving centre."""
    cx, cy, cz = point(body, end)
    ox, oy, oz = point(body, begin)
    ax, ay, az = a[0] - ox, a[1] - oy, a[2] - oz
    dx, dy, dz = p[0] - cx, p[1] - cy, p[2] - cz
    radius = body[B_RADIUS]
    part = sphere_entry(ax, ay, az, dx, dy, dz, radius + body[B_THICKNESS])
    if part < 1.0:
        dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
        _, nx, ny, nz = sphere(dx, dy, dz, radius)
        return (cx + dx, cy + dy, cz + dz), response(body, slow, v, (nx, ny, nz))
    distance, nx, ny, nz = sphere(dx, dy, dz, radius)
    return push(body, slow, distance, (nx, ny, nz), p, v)


@routine
def touch_capsule(body, begin, end, slow, a, p, v):
    cx, cy, cz = point(body, end)
    dx, dy, dz = p[0] - cx, p[1] - cy, p[2] - cz
    ex, ey, ez, radius = body[B_U], body[B_V], body[B_W], body[B_RADIUS]
    if FEATURE.swept:
        ox, oy, oz = point(body, begin)
        ax, ay, az = a[0] - ox, a[1] - oy, a[2] - oz
        part = capsule_entry(ax, ay, az, dx, dy, dz, ex, ey, ez, radius + body[B_THICKNESS])
        if part < 1.0:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
            return (cx + dx, cy + dy, cz + dz), response(body, slow, v, (nx, ny, nz))
    distance, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
    return push(body, slow, distance, (nx, ny, nz), p, v)


@routine
def touch_box(body, begin, end, slow, a, p, v):
    cx, cy, cz = point(body, end)
    dx, dy, dz, hx, hy, hz = p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W]
    if FEATURE.swept:
        ox, oy, oz = point(body, begin)
        depth, nx, ny, nz = box_face(a[0] - ox, a[1] - oy, a[2] - oz, dx, dy, dz, hx, hy, hz)
        if nx != 0.0 or ny != 0.0 or nz != 0.0:
            depth = depth + body[B_THICKNESS]
            x, y, z = pushed(p[0], depth, nx), pushed(p[1], depth, ny), pushed(p[2], depth, nz)
            return (x, y, z), response(body, slow, v, (nx, ny, nz))
    distance, nx, ny, nz = box(dx, dy, dz, hx, hy, hz)
    return push(body, slow, distance, (nx, ny, nz), p, v)


@routine
def touch_surface(body, begin, end, slow, a, p, v):
    """Apply the swept test in the collider's own frame (model/formulas/frame.py)."""
    static, dynamic, restitution = 0.0, 0.0, 0.0
    if FEATURE.friction:
        static, dynamic = body[B_STATIC], body[B_DYNAMIC]
    if FEATURE.restitution:
        restitution = body[B_RESTITUTION]
    surface = body[B_THICKNESS], static, dynamic, restitution, slow
    path = (
        (body[B_X], body[B_Y], body[B_Z]), (body[B_VX], body[B_VY], body[B_VZ]),
        (body[B_U], body[B_V], body[B_W]), body[B_SPIN], body[B_TURNS],
    )  # fmt: skip
    return touch_at(body, np.int32(body[B_TREE]), surface, path, begin, end, a, p, v)


touch_mesh = filled(touch_surface, {"touch_at": triangle_tree.touch})
touch_field = filled(touch_surface, {"touch_at": distance_field.touch})
