"""Contact in vertex block descent, on CPU threads: colliders in a vertex visit (the spring of newton_contact.py, and
friction), and pushes of surfaces, which later visits keep."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_mass
from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.tetrahedra.newton_contact import make_contact
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import descent, friction, newton


def make_meeting(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `add_contact(k, sums, position, arguments)`: it adds the contribution of colliders to the sums of vertex k.

    `arguments`: (substep, positions at its start, stiffness that holds particles, parameters, bodies, kinds). `has_bodies`:
    true if there are colliders.
    """
    compiled, contact = compiler.compiled, make_contact(compiler, real, parts)
    within, outer = contact.within, compiler.formulas(newton, real).outer
    rub = compiler.formulas(friction, real)
    unit, straight, slid, heading, sliding, rubbed = (
        rub.unit, rub.straight, rub.slid, rub.heading, rub.sliding, rub.rubbed,
    )  # fmt: skip
    added, touch = compiler.formulas(descent, real).added, make_collide_mass(compiler, real, parts)
    zero, has_friction = real(0), "friction" in parts

    @compiled
    def response(b, p, v, number, parameters, bodies, kinds):
        """Return the velocity after collision."""
        _, velocity = touch(
            bodies, kinds, number, parameters, (b[0], b[1], b[2]), (p[0], p[1], p[2]), (v[0], v[1], v[2])
        )  # fmt: skip
        return velocity

    @compiled
    def add_contact(k, sums, position, arguments):
        number, before, holds, parameters, bodies, kinds = arguments
        x, y, z, hard = within(k, number, position, before, holds, (parameters, bodies, kinds))
        if (x == zero) & (y == zero) & (z == zero):
            return sums
        xx, xy, xz, yy, yz, zz = outer(x, y, z, hard)
        sums = added(sums, (hard * x, hard * y, hard * z, xx, yy, zz, xy, xz, yz))
        if has_friction:
            b, p = (before[k, 0], before[k, 1], before[k, 2]), (position[k, 0], position[k, 1], position[k, 2])
            n = unit(x, y, z)
            c = response(b, p, straight(n), number, parameters, bodies, kinds)
            u = slid(p, b, c, parameters.dt, n)
            t = heading(n, u)
            v = sliding(c, n, t)
            w = response(b, p, v, number, parameters, bodies, kinds)
            sums = added(sums, rubbed(v, w, n, u, t, hard, parameters.dt))
        return sums

    return SimpleNamespace(has_bodies=contact.has_bodies, add_contact=add_contact)


@cache
def make_carry(real: Real, math: str) -> Callable:
    """Compile carry(bands, position, earlier, inertial): pushes from `earlier` to `position` move `inertial`, too."""
    compiler = Compiler(f"carry_{np.dtype(real).name}_{math}", math)
    carried = compiler.formulas(descent, real).carried

    def carry(band, bands, position, earlier, inertial):
        for k in range(len(earlier) * band // bands, len(earlier) * (band + 1) // bands):
            for axis in range(3):
                inertial[k, axis] = carried(inertial[k, axis], position[k, axis], earlier[k, axis])

    return compiler.banded(carry)


class CarriedContacts(SurfaceContacts):
    """Contacts of surfaces whose pushes move `inertial` (particles, 4), too: the next sweep would take them back by
    forces that are not equal and opposite, and more sweeps would not help."""

    def __init__(self, *arguments: Any, inertial: np.ndarray):
        super().__init__(*arguments)
        self._inertial, self._carry = inertial, make_carry(*arguments[1:3])
        self._earlier = np.zeros((len(inertial), 3), inertial.dtype)

    def project(self, before: np.ndarray, position: np.ndarray) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        self._earlier[...] = position[:, :3]
        super().project(before, position)
        self._carry(self._bands, position, self._earlier, self._inertial)
