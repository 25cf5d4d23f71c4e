"""Colliders in Newton's method, on CUDA: as cpu_backend/tetrahedra/newton_contact.py, for one particle."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import COLLIDERS
from softlab.model.base.types import Real
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.elastic import newton, solving


@cache
def make_contact(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `within`, `nearly_within` and `pressed`. `has_bodies`: true if there are colliders.

    `within(b, p, holds, world, number)`: penetration of a particle at `p` (a vector) and contact stiffness [N/m]; `b`:
    the quad of its old position, with its weight; `holds` [N/m]: stiffness that holds it; `nearly_within(b, p, target,
    ...)`: if there is none, that of its position a little later; `pressed(b, p, v, ...)`: its velocity including the
    push of colliders.
    """
    inline, formulas = inlined(math), device_formulas(newton, real, math)
    inertia_of, moved = formulas.inertia_of, formulas.moved
    times = device_formulas(solving, real, math).times
    touch, zero = make_collide(real, math, parts - {FRICTION_IN_PLACE}), real(0)
    contact, soon = real(newton.CONTACT), real(newton.SOON)

    @inline
    def depth(b, x, y, z, holds, world, number):
        p, q, r, _, _, _ = touch(b, x, y, z, zero, zero, zero, world, number)
        hard = times(contact, holds + inertia_of(world.parameters.newton_inertia, b[3]))
        return x - p, y - q, z - r, hard

    @inline
    def within(b, p, holds, world, number):
        return depth(b, p[0], p[1], p[2], holds, world, number)

    @inline
    def nearly_within(b, p, target, holds, world, number):
        x, y, z, hard = p[0], p[1], p[2], zero
        dx, dy, dz, fraction = zero, zero, zero, zero
        for _ in range(2):  # a loop, so that colliders are compiled once
            if (dx == zero) & (dy == zero) & (dz == zero):
                x, y, z = (
                    moved(p[0], fraction, target[0] - p[0]),
                    moved(p[1], fraction, target[1] - p[1]),
                    moved(p[2], fraction, target[2] - p[2]),
                )
                dx, dy, dz, hard = depth(b, x, y, z, holds, world, number)
                fraction = soon
        return dx, dy, dz, hard

    @inline
    def pressed(b, p, v, holds, world, number):
        x, y, z, hard = within(b, p, holds, world, number)
        parameters = world.parameters
        rate = times(hard / inertia_of(parameters.newton_inertia, b[3]), parameters.newton_rate)
        return moved(v[0], rate, x), moved(v[1], rate, y), moved(v[2], rate, z)

    return SimpleNamespace(
        has_bodies=bool(parts & COLLIDERS), within=within, nearly_within=nearly_within, pressed=pressed
    )  # fmt: skip
