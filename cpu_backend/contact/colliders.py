"""Collisions of a cloth's masses with colliders, for the CPU's kernels, one mass or one row at a time."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.swept import make_swept
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.model.base.types import Real
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
    COLLIDER_FIELDS,
)
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas import cloth, colliders, distance_field, triangle_tree
from softlab.model.tables.cloth import COLLIDER_KINDS

PLANE, SPHERE, CAPSULE, BOX, MESH, FIELD = range(len(COLLIDER_KINDS))  # numbers of the kinds of colliders in kernels


def make_push(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `point`, `response` and `push`. `point(body, time)`: position of a collider. `response(body, slow, v, n)`:
    velocity of a mass after contact. `push`: see the inner function."""
    compiled, sums = compiler.compiled, compiler.formulas(cloth, real)
    formulas, moved, pushed = compiler.formulas(colliders, real), sums.moved, sums.pushed
    respond, rebound, slid, zero = formulas.respond, formulas.rebound, formulas.slid, real(0)
    has_friction, bounces, in_place = "friction" in parts, "restitution" in parts, FRICTION_IN_PLACE in parts

    @compiled
    def speed_of(slow):
        return slow[0] if in_place else slow

    @compiled
    def point(body, time):
        return (
            moved(body[B_X], body[B_VX], time), moved(body[B_Y], body[B_VY], time), moved(body[B_Z], body[B_VZ], time),
        )  # fmt: skip

    @compiled
    def response(body, slow, v, n):
        static, dynamic = zero, zero
        if has_friction:
            static, dynamic = body[B_STATIC], body[B_DYNAMIC]
        u = body[B_VX], body[B_VY], body[B_VZ]
        if bounces:
            return rebound(v, u, n, static, dynamic, body[B_RESTITUTION], speed_of(slow))
        return respond(v, u, n, static, dynamic)

    @compiled
    def push(body, slow, distance, normal, p, v):
        """Push a mass that is inside the collider's thickness out of it."""
        thickness, (nx, ny, nz), (px, py, pz), (vx, vy, vz) = body[B_THICKNESS], normal, p, v
        if distance < thickness:
            depth = thickness - distance
            px, py, pz = pushed(px, depth, nx), pushed(py, depth, ny), pushed(pz, depth, nz)
            vx, vy, vz = response(body, slow, v, normal)
            if in_place:
                dx, dy, dz = slid(slow[1], (vx, vy, vz), v, normal)
                px, py, pz = px + dx, py + dy, pz + dz
        return (px, py, pz), (vx, vy, vz)

    return SimpleNamespace(point=point, response=response, push=push)


def make_touches(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make, by kind, touch(body, begin, end, slow, a, p, v) -> (p, v), each a vector (x, y, z).
    `body`: a row of model/contact/cloth_parameters.py, and what follows it; `begin`, `end`: times of the step [s];
    `slow`: of `make_instants`; a: position of the mass before the step; p, v: its position and velocity after it."""
    compiled = compiler.compiled
    formulas, between = compiler.formulas(colliders, real), compiler.formulas(cloth, real).between
    plane, sphere, capsule, box = formulas.plane, formulas.sphere, formulas.capsule, formulas.box
    pushing, sphere_entry = make_push(compiler, real, parts), formulas.sphere_entry
    point, response, push = pushing.point, pushing.response, pushing.push
    has_friction, bounces, in_place = "friction" in parts, "restitution" in parts, FRICTION_IN_PLACE in parts
    zero, one = real(0), real(1)

    @compiled
    def touch_plane(body, begin, end, slow, a, p, v):
        cx, cy, cz = point(body, end)
        distance, nx, ny, nz = plane(p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W])
        return push(body, slow, distance, (nx, ny, nz), p, v)

    @compiled
    def touch_sphere(body, begin, end, slow, a, p, v):
        """Apply the swept test: a mass that enters is put at its entry point, relative to the moving centre."""
        cx, cy, cz = point(body, end)
        ox, oy, oz = point(body, begin)
        ax, ay, az = a[0] - ox, a[1] - oy, a[2] - oz
        dx, dy, dz = p[0] - cx, p[1] - cy, p[2] - cz
        radius = body[B_RADIUS]
        part = sphere_entry(ax, ay, az, dx, dy, dz, radius + body[B_THICKNESS])
        if part < one:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = sphere(dx, dy, dz, radius)
            return (cx + dx, cy + dy, cz + dz), response(body, slow, v, (nx, ny, nz))
        distance, nx, ny, nz = sphere(dx, dy, dz, radius)
        return push(body, slow, distance, (nx, ny, nz), p, v)

    @compiled
    def touch_capsule(body, begin, end, slow, a, p, v):
        cx, cy, cz = point(body, end)
        distance, nx, ny, nz = capsule(
            p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W], body[B_RADIUS]
        )  # fmt: skip
        return push(body, slow, distance, (nx, ny, nz), p, v)

    @compiled
    def touch_box(body, begin, end, slow, a, p, v):
        cx, cy, cz = point(body, end)
        distance, nx, ny, nz = box(p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W])
        return push(body, slow, distance, (nx, ny, nz), p, v)

    if "swept" in parts:
        touch_capsule, touch_box = make_swept(compiler, real, pushing)

    def of_surface(topic: ModuleType) -> Callable:
        """Make the swept test in the collider's own frame (model/formulas/frame.py)."""
        touch_at = compiler.formulas(topic, real, {"bounces": bounces, "in_place": in_place}).touch

        @compiled
        def touch_surface(body, begin, end, slow, a, p, v):
            static, dynamic, restitution = zero, zero, zero
            if has_friction:
                static, dynamic = body[B_STATIC], body[B_DYNAMIC]
            if bounces:
                restitution = body[B_RESTITUTION]
            surface = body[B_THICKNESS], static, dynamic, restitution, slow
            path = (
                (body[B_X], body[B_Y], body[B_Z]), (body[B_VX], body[B_VY], body[B_VZ]),
                (body[B_U], body[B_V], body[B_W]), body[B_SPIN], body[B_TURNS],
            )  # fmt: skip
            return touch_at(body, np.int32(body[B_TREE]), surface, path, begin, end, a, p, v)

        return touch_surface

    return SimpleNamespace(
        plane=touch_plane, sphere=touch_sphere, capsule=touch_capsule, box=touch_box,
        mesh_collider=of_surface(triangle_tree), distance_field=of_surface(distance_field),
    )  # fmt: skip


def make_instants(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make instants(step, parameters) -> (begin, end, slow): start and end of the step [s], and the settling speed
    [m/s]. Below the settling speed nothing bounces; it is 0 without restitution. Where friction acts on positions,
    `slow` is (that speed, the step [s])."""
    instant = compiler.formulas(cloth, real).instant
    settling_speed = compiler.formulas(colliders, real).settling_speed
    bounces, in_place, zero = "restitution" in parts, FRICTION_IN_PLACE in parts, real(0)

    @compiler.compiled
    def with_step(slow, h):
        return (slow, h) if in_place else slow

    @compiler.compiled
    def instants(step, parameters):
        slow = settling_speed(parameters.gravity, parameters.dt) if bounces else zero
        clock = parameters.dt, parameters.first_step, parameters.first_time
        return instant(step, *clock), instant(step + 1, *clock), with_step(slow, parameters.dt)

    return instants


def make_collide_mass(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make collide_mass(bodies, kinds, step, parameters, a, p, v) -> (p, v), vectors. It applies all colliders to one
    mass, in their order. `bodies`: of `collider_numbers`; `kinds`: PLANE and so on."""
    touches, instants = make_touches(compiler, real, parts), make_instants(compiler, real, parts)
    plane, sphere, capsule, box = touches.plane, touches.sphere, touches.capsule, touches.box
    mesh, field = touches.mesh_collider, touches.distance_field
    has_plane, has_sphere, has_capsule, has_box, has_mesh, has_field = (kind in parts for kind in COLLIDER_KINDS)

    @compiler.compiled
    def collide_mass(bodies, kinds, step, parameters, a, p, v):
        begin, end, slow = instants(step, parameters)
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            if has_plane and kinds[b] == PLANE:
                p, v = plane(body, begin, end, slow, a, p, v)
            if has_sphere and kinds[b] == SPHERE:
                p, v = sphere(body, begin, end, slow, a, p, v)
            if has_capsule and kinds[b] == CAPSULE:
                p, v = capsule(body, begin, end, slow, a, p, v)
            if has_box and kinds[b] == BOX:
                p, v = box(body, begin, end, slow, a, p, v)
            if has_mesh and kinds[b] == MESH:
                p, v = mesh(body, begin, end, slow, a, p, v)
            if has_field and kinds[b] == FIELD:
                p, v = field(body, begin, end, slow, a, p, v)
        return p, v

    return collide_mass


def make_touch_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> tuple[Callable, ...]:
    """Make, by kind, touch_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz): a row."""
    touches, block = make_touches(compiler, real, parts), block_of(real)

    def make_loop(kind: str) -> Callable:
        touch = getattr(touches, kind)

        def touch_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz):
            for j in range(blocks * block):
                (px, py, pz), (qx, qy, qz) = touch(
                    body, begin, end, slow, (ax[j], ay[j], az[j]), (x[j], y[j], z[j]), (vx[j], vy[j], vz[j])
                )
                x[j] = px
                y[j] = py
                z[j] = pz
                vx[j] = qx
                vy[j] = qy
                vz[j] = qz

        touch_row.__name__ = f"{kind}_touch_row"
        return compiler.row(touch_row)

    return tuple(make_loop(kind) for kind in COLLIDER_KINDS)


def make_collide_planes(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make collide_planes(bodies, kinds, step, parameters, blocks, ax, ay, az, x, y, z, vx, vy, vz). It applies all
    colliders to masses stored contiguously in planes."""
    plane_row, sphere_row, capsule_row, box_row, mesh_row, field_row = make_touch_rows(compiler, real, parts)
    instants = make_instants(compiler, real, parts)
    has_plane, has_sphere, has_capsule, has_box, has_mesh, has_field = (kind in parts for kind in COLLIDER_KINDS)

    @compiler.compiled
    def collide_planes(bodies, kinds, step, parameters, blocks, ax, ay, az, x, y, z, vx, vy, vz):
        begin, end, slow = instants(step, parameters)
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            if has_plane and kinds[b] == PLANE:
                plane_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
            if has_sphere and kinds[b] == SPHERE:
                sphere_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
            if has_capsule and kinds[b] == CAPSULE:
                capsule_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
            if has_box and kinds[b] == BOX:
                box_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
            if has_mesh and kinds[b] == MESH:
                mesh_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)
            if has_field and kinds[b] == FIELD:
                field_row(blocks, body, begin, end, slow, ax, ay, az, x, y, z, vx, vy, vz)

    return collide_planes


def make_collide_row(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make collide_row(bodies, kinds, step, parameters, blocks, source, here, plane, target, there, target_plane). It
    applies all colliders to a row of masses. The row begins at `here` in `source` (before the step) and at `there` in
    `target` (after it)."""
    instants = make_instants(compiler, real, parts)
    plane_row, sphere_row, capsule_row, box_row, mesh_row, field_row = make_touch_rows(compiler, real, parts)
    has_plane, has_sphere, has_capsule, has_box, has_mesh, has_field = (kind in parts for kind in COLLIDER_KINDS)

    @compiler.compiled
    def collide_row(bodies, kinds, step, parameters, blocks, source, here, plane, target, there, target_plane):
        begin, end, slow = instants(step, parameters)
        x, y, z = row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane)
        new_x, new_y = row_at(target, there), row_at(target, there + target_plane)
        new_z, new_vx = row_at(target, there + 2 * target_plane), row_at(target, there + 3 * target_plane)
        new_vy, new_vz = row_at(target, there + 4 * target_plane), row_at(target, there + 5 * target_plane)
        for b in range(kinds.size):
            body = row_at(bodies, np.int64(b * COLLIDER_FIELDS))
            if has_plane and kinds[b] == PLANE:
                plane_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)
            if has_sphere and kinds[b] == SPHERE:
                sphere_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)
            if has_capsule and kinds[b] == CAPSULE:
                capsule_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)
            if has_box and kinds[b] == BOX:
                box_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)
            if has_mesh and kinds[b] == MESH:
                mesh_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)
            if has_field and kinds[b] == FIELD:
                field_row(blocks, body, begin, end, slow, x, y, z, new_x, new_y, new_z, new_vx, new_vy, new_vz)

    return collide_row
