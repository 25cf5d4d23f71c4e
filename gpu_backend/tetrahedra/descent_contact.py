"""Colliders in a vertex visit of vertex block descent, on CUDA: as cpu_backend/tetrahedra/descent_contact.py, for one
vertex."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.tetrahedra.newton_contact import make_contact
from softlab.model.formulas.elastic import descent, friction, newton, solving


@cache
def make_meeting(real: Any, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `met(sums, b, p, holds, world, number)`: it adds the contribution of colliders to the sums of a vertex at
    `p`, which was at `b` at the start of substep `number` (quads). `has_bodies`: true if there are colliders."""
    inline, contact = inlined(math), make_contact(real, math, parts)
    within, outer = contact.within, device_formulas(newton.make, real, math).outer
    rub = device_formulas(friction.make, real, math)
    unit, straight, slid, heading, sliding, rubbed = (
        rub.unit, rub.straight, rub.slid, rub.heading, rub.sliding, rub.rubbed,
    )  # fmt: skip
    added, touch = device_formulas(descent.make_vertex, real, math).added, make_collide(real, math, parts)
    scaled = device_formulas(solving.make, real, math).scaled
    zero, has_friction = real(0), "friction" in parts

    @inline
    def met(sums, b, p, holds, world, number):
        x, y, z, hard = within(b, p, holds, world, number)
        if (x != zero) | (y != zero) | (z != zero):
            xx, xy, xz, yy, yz, zz = outer(x, y, z, hard)
            fx, fy, fz = scaled(hard, x, y, z)
            sums = added(sums, (fx, fy, fz, xx, yy, zz, xy, xz, yz))
            if has_friction:
                n, h = unit(x, y, z), world.parameters.dt
                v = straight(n)
                _, _, _, cx, cy, cz = touch(b, p[0], p[1], p[2], v[0], v[1], v[2], world, number)
                c = cx, cy, cz
                u = slid(p, b, c, h, n)
                t = heading(n, u)
                v = sliding(c, n, t)
                _, _, _, wx, wy, wz = touch(b, p[0], p[1], p[2], v[0], v[1], v[2], world, number)
                sums = added(sums, rubbed(v, (wx, wy, wz), n, u, t, hard, h))
        return sums

    return SimpleNamespace(has_bodies=contact.has_bodies, met=met)
