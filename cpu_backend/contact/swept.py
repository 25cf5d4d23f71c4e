"""Swept collisions with capsules and boxes, which no path within a substep crosses, for the CPU's kernels
(model/formulas/fluid/sweep.py)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.contact.cloth_parameters import B_RADIUS, B_THICKNESS, B_U, B_V, B_W
from softlab.model.formulas import cloth, colliders
from softlab.model.formulas.fluid import sweep


def make_swept(compiler: Compiler, real: Any, pushing: SimpleNamespace) -> tuple[Any, Any]:
    """Make `touch_capsule` and `touch_box`, as in cpu_backend/contact/colliders.py; `pushing`: of `make_push`."""
    compiled, point, answer, push = compiler.compiled, pushing.point, pushing.answer, pushing.push
    formulas, sums, sweeps = colliders.make(real, compiled), cloth.make(real, compiled), sweep.make(real, compiled)
    capsule, box, between, pushed = formulas.capsule, formulas.box, sums.between, sums.pushed
    capsule_entry, box_face = sweeps.capsule_entry, sweeps.box_face
    zero, one = real(0), real(1)

    @compiled
    def touch_capsule(body, begin, end, slow, ax, ay, az, px, py, pz, vx, vy, vz):
        cx, cy, cz = point(body, end)
        ox, oy, oz = point(body, begin)
        ax, ay, az = ax - ox, ay - oy, az - oz
        dx, dy, dz = px - cx, py - cy, pz - cz
        ex, ey, ez, radius = body[B_U], body[B_V], body[B_W], body[B_RADIUS]
        part = capsule_entry(ax, ay, az, dx, dy, dz, ex, ey, ez, radius + body[B_THICKNESS])
        if part < one:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
            vx, vy, vz = answer(body, slow, vx, vy, vz, nx, ny, nz)
            return cx + dx, cy + dy, cz + dz, vx, vy, vz
        distance, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
        return push(body, slow, distance, nx, ny, nz, px, py, pz, vx, vy, vz)

    @compiled
    def touch_box(body, begin, end, slow, ax, ay, az, px, py, pz, vx, vy, vz):
        cx, cy, cz = point(body, end)
        ox, oy, oz = point(body, begin)
        dx, dy, dz, hx, hy, hz = px - cx, py - cy, pz - cz, body[B_U], body[B_V], body[B_W]
        depth, nx, ny, nz = box_face(ax - ox, ay - oy, az - oz, dx, dy, dz, hx, hy, hz)
        if nx != zero or ny != zero or nz != zero:
            depth = depth + body[B_THICKNESS]
            px, py, pz = pushed(px, depth, nx), pushed(py, depth, ny), pushed(pz, depth, nz)
            vx, vy, vz = answer(body, slow, vx, vy, vz, nx, ny, nz)
            return px, py, pz, vx, vy, vz
        distance, nx, ny, nz = box(dx, dy, dz, hx, hy, hz)
        return push(body, slow, distance, nx, ny, nz, px, py, pz, vx, vy, vz)

    return touch_capsule, touch_box
