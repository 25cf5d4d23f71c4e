"""Swept collisions with capsules and boxes, which no path within a substep crosses, as device functions
(model/formulas/fluid/sweep.py)."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.gpu_backend.contact.rows import (
    B_RADIUS,
    B_THICKNESS,
    B_U,
    B_V,
    B_W,
)
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, colliders
from softlab.model.formulas.fluid import sweep


def make_swept(real: Real, math: str, answers: SimpleNamespace) -> tuple[Callable, Callable]:
    """Make `push_from_capsule` and `push_from_box`, as in gpu_backend/contact/colliders.py; `answers`: of that."""
    formulas, sums = device_formulas(colliders, real, math), device_formulas(cloth, real, math)
    sweeps, inline = device_formulas(sweep, real, math), inlined(math)
    capsule, box, between, pushed = formulas.capsule, formulas.box, sums.between, sums.pushed
    capsule_entry, box_face = sweeps.capsule_entry, sweeps.box_face
    place_of, response, push = answers.place_of, answers.response, answers.push
    zero, one = real(0), real(1)

    @inline
    def relative_path(before, p, bodies, at, begin, end):
        """Return start and end of a particle's path relative to the collider: six numbers."""
        x, y, z = place_of(bodies, at, end)
        ox, oy, oz = place_of(bodies, at, begin)
        return before[0] - ox, before[1] - oy, before[2] - oz, p[0] - x, p[1] - y, p[2] - z

    @inline
    def push_from_capsule(before, p, v, slow, bodies, at, begin, end):
        ax, ay, az, dx, dy, dz = relative_path(before, p, bodies, at, begin, end)
        ex, ey, ez, radius = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W], bodies[at + B_RADIUS]
        part = capsule_entry(ax, ay, az, dx, dy, dz, ex, ey, ez, radius + bodies[at + B_THICKNESS])
        if part < one:
            x, y, z = place_of(bodies, at, end)
            dx, dy, dz = between(ax, dx, part), between(ay, dy, part), between(az, dz, part)
            _, nx, ny, nz = capsule(dx, dy, dz, ex, ey, ez, radius)
            return (x + dx, y + dy, z + dz), response(v, (nx, ny, nz), slow, bodies, at)
        return push(p, v, capsule(dx, dy, dz, ex, ey, ez, radius), slow, bodies, at)

    @inline
    def push_from_box(before, p, v, slow, bodies, at, begin, end):
        ax, ay, az, dx, dy, dz = relative_path(before, p, bodies, at, begin, end)
        hx, hy, hz = bodies[at + B_U], bodies[at + B_V], bodies[at + B_W]
        depth, nx, ny, nz = box_face(ax, ay, az, dx, dy, dz, hx, hy, hz)
        if nx != zero or ny != zero or nz != zero:
            depth = depth + bodies[at + B_THICKNESS]
            x, y, z = pushed(p[0], depth, nx), pushed(p[1], depth, ny), pushed(p[2], depth, nz)
            return (x, y, z), response(v, (nx, ny, nz), slow, bodies, at)
        return push(p, v, box(dx, dy, dz, hx, hy, hz), slow, bodies, at)

    return push_from_capsule, push_from_box
