"""Collisions of a cloth's mass with all colliders, in the scene's order, as a device function."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType, SimpleNamespace

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
from softlab.gpu_backend.contact.swept import make_swept
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import BOXES, CAPSULES, COLLIDERS, FIELDS, MESHES, PLANES, SPHERES
from softlab.model.base.types import Real
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas import cloth, colliders, distance_field, triangle_tree


@cache
def make_place_of(real: Real, math: str) -> Callable:
    """Make place_of(bodies, at, time) -> (x, y, z): position [m] at `time` [s] of the collider whose row begins at
    `at`."""
    moved = device_formulas(cloth, real, math).moved

    @inlined(math)
    def place_of(bodies, at, time):
        return (
            moved(bodies[at + B_X], bodies[at + B_VX], time),
            moved(bodies[at + B_Y], bodies[at + B_VY], time),
            moved(bodies[at + B_Z], bodies[at + B_VZ], time),
        )

    return place_of


def _make_answers(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `place_of`, `response` (velocity of a mass after contact) and `push`, for the collider whose row begins at
    `at`."""
    formulas, place_of = device_formulas(colliders, real, math), make_place_of(real, math)
    respond, rebound, pushed = formulas.respond, formulas.rebound, device_formulas(cloth, real, math).pushed
    bounces, has_friction, zero, inline = "restitution" in parts, "friction" in parts, real(0), inlined(math)
    in_place, slid = FRICTION_IN_PLACE in parts, formulas.slid

    @inline
    def speed_of(slow):
        return slow[0] if in_place else slow

    @inline
    def response(v, n, slow, bodies, at):
        static, dynamic = zero, zero
        if has_friction:
            static, dynamic = bodies[at + B_STATIC], bodies[at + B_DYNAMIC]
        u = bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]
        if bounces:
            return rebound(v, u, n, static, dynamic, bodies[at + B_RESTITUTION], speed_of(slow))
        return respond(v, u, n, static, dynamic)

    @inline
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
            if in_place:
                dx, dy, dz = slid(slow[1], (vx, vy, vz), v, (nx, ny, nz))
                px, py, pz = px + dx, py + dy, pz + dz
        return (px, py, pz), (vx, vy, vz)

    return SimpleNamespace(place_of=place_of, response=response, push=push)


def _make_meetings(real: Real, math: str, parts: frozenset[str]) -> tuple[Callable, ...]:
    """Make, for a plane, a sphere, a capsule, a box, a mesh and a field, meet(before, p, v, slow, bodies, at, begin, end)
    -> (p, v): the collision of a mass, which was at `before`."""
    formulas, answers = device_formulas(colliders, real, math), _make_answers(real, math, parts)
    plane, sphere, capsule, box = formulas.plane, formulas.sphere, formulas.capsule, formulas.box
    sphere_entry, between = formulas.sphere_entry, device_formulas(cloth, real, math).between
    place_of, response, push = answers.place_of, answers.response, answers.push
    bounces, has_friction, zero, one = "restitution" in parts, "friction" in parts, real(0), real(1)
    inline = inlined(math)

    @inline
    def push_from_sphere(before, p, v, slow, bodies, at, begin, end):
        x, y, z = place_of(bodies, at, end)
        dx, dy, dz = p[0] - x, p[1] - y, p[2] - z
        old_x, old_y, old_z = place_of(bodies, at, begin)
        ax, ay, az = before[0] - old_x, before[1] - old_y, before[2] - old_z
        radius = bodies[at + B_RADIUS]
        part = sphere_entry(ax, ay, az, dx, dy, dz, radius + bodies[at + B_THICKNESS])
        if part < one:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = sphere(dx, dy, dz, radius)
            return (x + dx, y + dy, z + dz), response(v, (nx, ny, nz), slow, bodies, at)
        return push(p, v, sphere(dx, dy, dz, radius), slow, bodies, at)

    @inline
    def push_from_plane(before, p, v, slow, bodies, at, begin, end):
        x, y, z = place_of(bodies, at, end)
        surface = plane(p[0] - x, p[1] - y, p[2] - z, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
        return push(p, v, surface, slow, bodies, at)

    @inline
    def push_from_capsule(before, p, v, slow, bodies, at, begin, end):
        x, y, z = place_of(bodies, at, end)
        surface = capsule(
            p[0] - x, p[1] - y, p[2] - z, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W], bodies[at + B_RADIUS]
        )
        return push(p, v, surface, slow, bodies, at)

    @inline
    def push_from_box(before, p, v, slow, bodies, at, begin, end):
        x, y, z = place_of(bodies, at, end)
        surface = box(p[0] - x, p[1] - y, p[2] - z, bodies[at + B_U], bodies[at + B_V], bodies[at + B_W])
        return push(p, v, surface, slow, bodies, at)

    def of_surface(topic: ModuleType) -> Callable:
        """Make the collision in the collider's own frame (model/formulas/frame.py)."""
        touch_at = device_formulas(
            topic, real, math, {"bounces": bounces, "in_place": FRICTION_IN_PLACE in parts}
        ).touch

        @inline
        def push_from_surface(before, p, v, slow, bodies, at, begin, end):
            static, dynamic, restitution = zero, zero, zero
            if has_friction:
                static, dynamic = bodies[at + B_STATIC], bodies[at + B_DYNAMIC]
            if bounces:
                restitution = bodies[at + B_RESTITUTION]
            surface = bodies[at + B_THICKNESS], static, dynamic, restitution, slow
            path = (
                (bodies[at + B_X], bodies[at + B_Y], bodies[at + B_Z]),
                (bodies[at + B_VX], bodies[at + B_VY], bodies[at + B_VZ]),
                (bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]), bodies[at + B_SPIN], bodies[at + B_TURNS],
            )  # fmt: skip
            place = np.int32(np.int32(at) + np.int32(bodies[at + B_TREE]))
            return touch_at(bodies, place, surface, path, begin, end, (before[0], before[1], before[2]), p, v)

        return push_from_surface

    return (
        push_from_plane,
        push_from_sphere,
        push_from_capsule,
        push_from_box,
        of_surface(triangle_tree),
        of_surface(distance_field),
    )


@cache
def make_collide(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make collide(before, px, py, pz, vx, vy, vz, world, step) -> (px, py, pz, vx, vy, vz).

    `before`: the mass at the step's start (a quad); the rest: its state at the step's end. `bodies`: the rows of
    model/contact/cloth_parameters.py one after the other, then trees and fields; `integers` has the number of each
    kind.
    """
    push_from_plane, push_from_sphere, push_from_capsule, push_from_box, push_from_mesh, push_from_field = (
        _make_meetings(real, math, parts)
    )
    settling_speed = device_formulas(colliders, real, math).settling_speed
    swept = "swept" in parts
    sweep_capsule, sweep_box = make_swept(real, math, _make_answers(real, math, parts))
    instant, bounces = device_formulas(cloth, real, math).instant, "restitution" in parts
    has_planes, has_spheres, has_capsules = "plane" in parts, "sphere" in parts, "capsule" in parts
    has_boxes, has_meshes, has_fields = "box" in parts, "mesh_collider" in parts, "distance_field" in parts
    has_colliders, zero, next_one = bool(parts & COLLIDERS), real(0), np.int64(1)
    in_place = FRICTION_IN_PLACE in parts

    @inlined(math)
    def with_step(slow, h):
        return (slow, h) if in_place else slow

    @inlined(math)
    def collide(before, px, py, pz, vx, vy, vz, world, step):
        parameters, bodies, integers = world.parameters, world.colliders, world.integers
        p, v = (px, py, pz), (vx, vy, vz)
        if has_colliders:
            clock, at = (parameters.dt, parameters.first_step, parameters.first_time), FIRST_ROW
            end = instant(step + next_one, *clock)
            slow = with_step(settling_speed(parameters.gravity, parameters.dt) if bounces else zero, parameters.dt)
            if has_planes:
                for _ in range(np.int32(integers[PLANES])):
                    p, v = push_from_plane(before, p, v, slow, bodies, at, end, end)
                    at = np.uint64(at + ROW)
            if has_spheres:
                begin = instant(step, *clock)
                for _ in range(np.int32(integers[SPHERES])):
                    p, v = push_from_sphere(before, p, v, slow, bodies, at, begin, end)
                    at = np.uint64(at + ROW)
            if has_capsules:
                for _ in range(np.int32(integers[CAPSULES])):
                    if swept:
                        begin = instant(step, *clock)
                        p, v = sweep_capsule(before, p, v, slow, bodies, at, begin, end)
                    else:
                        p, v = push_from_capsule(before, p, v, slow, bodies, at, end, end)
                    at = np.uint64(at + ROW)
            if has_boxes:
                for _ in range(np.int32(integers[BOXES])):
                    if swept:
                        begin = instant(step, *clock)
                        p, v = sweep_box(before, p, v, slow, bodies, at, begin, end)
                    else:
                        p, v = push_from_box(before, p, v, slow, bodies, at, end, end)
                    at = np.uint64(at + ROW)
            if has_meshes:
                begin = instant(step, *clock)
                for _ in range(np.int32(integers[MESHES])):
                    p, v = push_from_mesh(before, p, v, slow, bodies, at, begin, end)
                    at = np.uint64(at + ROW)
            if has_fields:
                begin = instant(step, *clock)
                for _ in range(np.int32(integers[FIELDS])):
                    p, v = push_from_field(before, p, v, slow, bodies, at, begin, end)
                    at = np.uint64(at + ROW)
        return p[0], p[1], p[2], v[0], v[1], v[2]

    return collide
