"""Colliders in a vertex visit of vertex block descent, on CPU threads: the spring of newton_contact.py, and
friction."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from softlab.cpu_backend.contact.colliders import make_collide_mass
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.tetrahedra.newton_contact import make_contact
from softlab.model.formulas.elastic import descent, friction, newton


def make_meeting(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """Make `met(k, sums, position, given)`: it adds the contribution of colliders to the sums of vertex k.

    `given`: (substep, positions at its start, stiffness that holds particles, parameters, bodies, kinds). `has_bodies`:
    true if there are colliders.
    """
    compiled, contact = compiler.compiled, make_contact(compiler, real, parts)
    within, outer = contact.within, newton.make(real, compiled).outer
    rub = friction.make(real, compiled)
    unit, straight, slid, heading, sliding, rubbed = (
        rub.unit, rub.straight, rub.slid, rub.heading, rub.sliding, rub.rubbed,
    )  # fmt: skip
    added, touch = descent.make_vertex(real, compiled).added, make_collide_mass(compiler, real, parts)
    zero, has_friction = real(0), "friction" in parts

    @compiled
    def answer(b, p, v, number, parameters, bodies, kinds):
        """Return the velocity after collision."""
        _, _, _, x, y, z = touch(
            bodies, kinds, number, parameters, b[0], b[1], b[2], p[0], p[1], p[2], v[0], v[1], v[2]
        )  # fmt: skip
        return x, y, z

    @compiled
    def met(k, sums, position, given):
        number, before, holds, parameters, bodies, kinds = given
        x, y, z, hard = within(k, number, position, before, holds, (parameters, bodies, kinds))
        if (x == zero) & (y == zero) & (z == zero):
            return sums
        xx, xy, xz, yy, yz, zz = outer(x, y, z, hard)
        sums = added(sums, (hard * x, hard * y, hard * z, xx, yy, zz, xy, xz, yz))
        if has_friction:
            b, p = (before[k, 0], before[k, 1], before[k, 2]), (position[k, 0], position[k, 1], position[k, 2])
            n = unit(x, y, z)
            c = answer(b, p, straight(n), number, parameters, bodies, kinds)
            u = slid(p, b, c, parameters.dt, n)
            t = heading(n, u)
            v = sliding(c, n, t)
            w = answer(b, p, v, number, parameters, bodies, kinds)
            sums = added(sums, rubbed(v, w, n, u, t, hard, parameters.dt))
        return sums

    return SimpleNamespace(has_bodies=contact.has_bodies, met=met)
