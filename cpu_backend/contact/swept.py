"""Swept collisions with capsules and boxes, which no path within a substep crosses, for the CPU's kernels
(model/formulas/fluid/sweep.py)."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import B_RADIUS, B_THICKNESS, B_U, B_V, B_W
from softlab.model.formulas import cloth, colliders
from softlab.model.formulas.fluid import sweep


def make_swept(compiler: Compiler, real: Real, pushing: SimpleNamespace) -> tuple[Callable, Callable]:
    """Make `touch_capsule` and `touch_box`, as in cpu_backend/contact/colliders.py; `pushing`: of `make_push`."""
    compiled, point, response, push = compiler.compiled, pushing.point, pushing.response, pushing.push
    formulas, sums, sweeps = (
        compiler.formulas(colliders, real),
        compiler.formulas(cloth, real),
        compiler.formulas(sweep, real),
    )
    capsule, box, between, pushed = formulas.capsule, formulas.box, sums.between, sums.pushed
    capsule_entry, box_face = sweeps.capsule_entry, sweeps.box_face
    zero, one = real(0), real(1)

    @compiled
    def touch_capsule(body, begin, end, slow, a, p, v):
        cx, cy, cz = point(body, end)
        ox, oy, oz = point(body, begin)
        ax, ay, az = a[0] - ox, a[1] - oy, a[2] - oz
        dx, dy, dz = p[0] - cx, p[1] - cy, p[2] - cz
        ex, ey, ez, radius = body[B_U], body[B_V], body[B_W], body[B_RADIUS]
        part = capsule_entry(ax, ay, az, dx, dy, dz, ex, ey, ez, radius + body[B_THICKNESS])
        if part < one:
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
            return (cx + dx, cy + dy, cz + dz), response(body, slow, v, (nx, ny, nz))
        distance, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
        return push(body, slow, distance, (nx, ny, nz), p, v)

    @compiled
    def touch_box(body, begin, end, slow, a, p, v):
        cx, cy, cz = point(body, end)
        ox, oy, oz = point(body, begin)
        dx, dy, dz, hx, hy, hz = p[0] - cx, p[1] - cy, p[2] - cz, body[B_U], body[B_V], body[B_W]
        depth, nx, ny, nz = box_face(a[0] - ox, a[1] - oy, a[2] - oz, dx, dy, dz, hx, hy, hz)
        if nx != zero or ny != zero or nz != zero:
            depth = depth + body[B_THICKNESS]
            x, y, z = pushed(p[0], depth, nx), pushed(p[1], depth, ny), pushed(p[2], depth, nz)
            return (x, y, z), response(body, slow, v, (nx, ny, nz))
        distance, nx, ny, nz = box(dx, dy, dz, hx, hy, hz)
        return push(body, slow, distance, (nx, ny, nz), p, v)

    return touch_capsule, touch_box
