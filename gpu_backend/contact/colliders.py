"""Collisions of a cloth's mass with all colliders, in the scene's order, as device functions."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.contact.rows import (
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
    FIRST_ROW,
    ROW,
)
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, FIELDS, MESHES, PLANES, SPHERES
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
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


@inlined_routine
def place_of(bodies, at, time):
    """Return the position [m] at `time` [s] of the collider whose row begins at `at`."""
    return (
        moved(bodies[at + B_X], bodies[at + B_VX], time),
        moved(bodies[at + B_Y], bodies[at + B_VY], time),
        moved(bodies[at + B_Z], bodies[at + B_VZ], time),
    )


@inlined_routine
def with_step(slow, h):
    return (slow, h) if FEATURE.friction_in_place else slow


@inlined_routine
def speed_of(slow):
    return slow[0] if FEATURE.friction_in_place else slow


@inlined_routine
def response(v, n, slow, bodies, at):
    """Return the velocity of a mass after contact."""
    static, dynamic = 0.0, 0.0
    if FEATURE.friction:
        static, dynamic = bodies[at + B_STATIC], bodies[at + B_DYNAMIC]
    u = bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]
    if FEATURE.restitution:
        return rebound(v, u, n, static, dynamic, bodies[at + B_RESTITUTION], speed_of(slow))
    return respond(v, u, n, static, dynamic)


@inlined_routine
def push(p, v, surface, slow, bodies, at):
    """Push a mass that is inside the collider's thickness out of it. `surface`: (distance, nx, ny, nz); `slow`:
    settling speed, below which nothing bounces, and, where friction acts on positions, the step [s]."""
    distance, nx, ny, nz = surface
    (px, py, pz), (vx, vy, vz) = p, v
    thickness = bodies[at + B_THICKNESS]
    if distance < thickness:
        depth = thickness - distance
        px, py, pz = pushed(px, depth, nx), pushed(py, depth, ny), pushed(pz, depth, nz)
        vx, vy, vz = response(v, (nx, ny, nz), slow, bodies, at)
        if FEATURE.friction_in_place:
            dx, dy, dz = slid(slow[1], (vx, vy, vz), v, (nx, ny, nz))
            px, py, pz = px + dx, py + dy, pz + dz
    return (px, py, pz), (vx, vy, vz)


# ---------------------------------------------------------------------- one mass and one collider
# They return the position and velocity of a mass, which was at `before`, after the collider whose row begins at `at`.


@inlined_routine
def relative_path(before, p, bodies, at, begin, end):
    """Return start and end of a mass's path relative to the collider: six numbers."""
    x, y, z = place_of(bodies, at, end)
    ox, oy, oz = place_of(bodies, at, begin)
    return before[0] - ox, before[1] - oy, before[2] - oz, p[0] - x, p[1] - y, p[2] - z


@inlined_routine
def push_from_sphere(before, p, v, slow, bodies, at, begin, end):
    x, y, z = place_of(bodies, at, end)
    ax, ay, az, dx, dy, dz = relative_path(before, p, bodies, at, begin, end)
    radius = bodies[at + B_RADIUS]
    part = sphere_entry(ax, ay, az, dx, dy, dz, radius + bodies[at + B_THICKNESS])
    if part < 1.0:
        dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
        _, nx, ny, nz = sphere(dx, dy, dz, radius)
        return (x + dx, y + dy, z + dz), response(v, (nx, ny, nz), slow, bodies, at)
    return push(p, v, sphere(dx, dy, dz, radius), slow, bodies, at)


@inlined_routine
def push_from_plane(before, p, v, slow, bodies, at, begin, end):
    x, y, z = place_of(bodies, at, end)
    surface = plane(p[0] - x, p[1] - y, p[2] - z, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
    return push(p, v, surface, slow, bodies, at)


@inlined_routine
def push_from_capsule(before, p, v, slow, bodies, at, begin, end):
    x, y, z = place_of(bodies, at, end)
    dx, dy, dz = p[0] - x, p[1] - y, p[2] - z
    ex, ey, ez, radius = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W], bodies[at + B_RADIUS]
    if FEATURE.swept:
        ax, ay, az, dx, dy, dz = relative_path(before, p, bodies, at, begin, end)
        part = capsule_entry(ax, ay, az, dx, dy, dz, ex, ey, ez, radius + bodies[at + B_THICKNESS])
        if part < 1.0:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
            return (x + dx, y + dy, z + dz), response(v, (nx, ny, nz), slow, bodies, at)
    return push(p, v, capsule(dx, dy, dz, ex, ey, ez, radius), slow, bodies, at)


@inlined_routine
def push_from_box(before, p, v, slow, bodies, at, begin, end):
    x, y, z = place_of(bodies, at, end)
    dx, dy, dz = p[0] - x, p[1] - y, p[2] - z
    hx, hy, hz = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
    if FEATURE.swept:
        ax, ay, az, dx, dy, dz = relative_path(before, p, bodies, at, begin, end)
        depth, nx, ny, nz = box_face(ax, ay, az, dx, dy, dz, hx, hy, hz)
        if nx != 0.0 or ny != 0.0 or nz != 0.0:
            depth = depth + bodies[at + B_THICKNESS]
            x, y, z = pushed(p[0], depth, nx), pushed(p[1], depth, ny), pushed(p[2], depth, nz)
            return (x, y, z), response(v, (nx, ny, nz), slow, bodies, at)
    return push(p, v, box(dx, dy, dz, hx, hy, hz), slow, bodies, at)


@inlined_routine
def push_from_surface(before, p, v, slow, bodies, at, begin, end):
    """Apply the swept test in the collider's own frame (model/formulas/frame.py)."""
    static, dynamic, restitution = 0.0, 0.0, 0.0
    if FEATURE.friction:
        static, dynamic = bodies[at + B_STATIC], bodies[at + B_DYNAMIC]
    if FEATURE.restitution:
        restitution = bodies[at + B_RESTITUTION]
    surface = bodies[at + B_THICKNESS], static, dynamic, restitution, slow
    path = (
        (bodies[at + B_X], bodies[at + B_Y], bodies[at + B_Z]),
        (bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]),
        (bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]), bodies[at + B_SPIN], bodies[at + B_TURNS],
    )  # fmt: skip
    place = np.int32(np.int32(at) + np.int32(bodies[at + B_TREE]))
    return touch_at(bodies, place, surface, path, begin, end, (before[0], before[1], before[2]), p, v)


push_from_mesh = filled(push_from_surface, {"touch_at": triangle_tree.touch})
push_from_field = filled(push_from_surface, {"touch_at": distance_field.touch})


@inlined_routine
def collide(before, px, py, pz, vx, vy, vz, world, step):
    """Return the state of a mass after all colliders: (px, py, pz, vx, vy, vz).

    `before`: the mass at the step's start (a quad); the rest: its state at the step's end. `world.colliders`: the rows
    of model/contact/cloth_parameters.py one after the other, then trees and fields; `world.integers` has the number of
    each kind.
    """
    if not (
        FEATURE.plane or FEATURE.sphere or FEATURE.capsule or FEATURE.box or FEATURE.mesh_collider
        or FEATURE.distance_field
    ):  # fmt: skip
        return px, py, pz, vx, vy, vz
    parameters, bodies, integers = world.parameters, world.colliders, world.integers
    p, v, at = (px, py, pz), (vx, vy, vz), FIRST_ROW
    clock = parameters.dt, parameters.first_step, parameters.first_time
    begin, end = instant(step, *clock), instant(step + 1, *clock)
    slow = settling_speed(parameters.gravity, parameters.dt) if FEATURE.restitution else 0.0
    settling = with_step(slow, parameters.dt)
    if FEATURE.plane:
        for _ in range(np.int32(integers[PLANES])):
            p, v = push_from_plane(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    if FEATURE.sphere:
        for _ in range(np.int32(integers[SPHERES])):
            p, v = push_from_sphere(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    if FEATURE.capsule:
        for _ in range(np.int32(integers[CAPSULES])):
            p, v = push_from_capsule(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    if FEATURE.box:
        for _ in range(np.int32(integers[BOXES])):
            p, v = push_from_box(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    if FEATURE.mesh_collider:
        for _ in range(np.int32(integers[MESHES])):
            p, v = push_from_mesh(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    if FEATURE.distance_field:
        for _ in range(np.int32(integers[FIELDS])):
            p, v = push_from_field(before, p, v, settling, bodies, at, begin, end)
            at = np.uint64(at + ROW)
    return p[0], p[1], p[2], v[0], v[1], v[2]
