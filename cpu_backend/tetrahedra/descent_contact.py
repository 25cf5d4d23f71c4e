"""Contact in vertex block descent, on CPU threads: colliders in a vertex visit (the spring of newton_contact.py, and
friction), and pushes of surfaces, which later visits keep."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.surfaces import SurfaceContacts
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.tetrahedra.newton_contact import touch, within
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.formulas.elastic.descent import added, carried
from softlab.model.formulas.elastic.friction import heading, rubbed, slid, sliding, straight, unit
from softlab.model.formulas.elastic.newton import outer
from softlab.model.scene.scene import Scene


@routine
def response(b, p, v, number, parameters, bodies, kinds):
    """Return the velocity after collision."""
    _, velocity = touch(
        bodies, kinds, number, parameters, (b[0], b[1], b[2]), (p[0], p[1], p[2]), (v[0], v[1], v[2])
    )  # fmt: skip
    return velocity


@routine
def add_contact(k, sums, position, arguments):
    """Add the contribution of colliders to the sums of vertex k. `arguments`: (substep, positions at its start, stiffness
    that holds particles, parameters, bodies, kinds)."""
    number, before, holds, parameters, bodies, kinds = arguments
    x, y, z, hard = within(k, number, position, before, holds, (parameters, bodies, kinds))
    if (x == 0.0) & (y == 0.0) & (z == 0.0):
        return sums
    xx, xy, xz, yy, yz, zz = outer(x, y, z, hard)
    sums = added(sums, (hard * x, hard * y, hard * z, xx, yy, zz, xy, xz, yz))
    if FEATURE.friction:
        b, p = (before[k, 0], before[k, 1], before[k, 2]), (position[k, 0], position[k, 1], position[k, 2])
        n = unit(x, y, z)
        c = response(b, p, straight(n), number, parameters, bodies, kinds)
        u = slid(p, b, c, parameters.dt, n)
        t = heading(n, u)
        v = sliding(c, n, t)
        w = response(b, p, v, number, parameters, bodies, kinds)
        sums = added(sums, rubbed(v, w, n, u, t, hard, parameters.dt))
    return sums


@routine
def carry(band, bands, position, earlier, inertial):
    """Move `inertial` by the pushes from `earlier` to `position`."""
    for k in range(len(earlier) * band // bands, len(earlier) * (band + 1) // bands):
        for axis in range(3):
            inertial[k, axis] = carried(inertial[k, axis], position[k, axis], earlier[k, axis])


@cache
def make_carry(real: Real, math: str) -> Callable:
    """Compile carry(bands, position, earlier, inertial)."""
    compiler = Compiler(f"carry_{np.dtype(real).name}_{math}", math)
    return compiler.banded(compiler.variant_of(real).copied(carry))


class CarriedContacts(SurfaceContacts):
    """Contacts of surfaces whose pushes move `inertial` (particles, 4), too: the next sweep would take them back by
    forces that are not equal and opposite, and more sweeps would not help."""

    def __init__(self, scene: Scene, real: Any, math: str, threads: int, weights: np.ndarray, inertial: np.ndarray):
        super().__init__(scene, real, math, threads, weights)
        self._inertial, self._carry = inertial, make_carry(real, math)
        self._earlier = np.zeros((len(inertial), 3), inertial.dtype)

    def project(self, before: np.ndarray, position: np.ndarray) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        self._earlier[...] = position[:, :3]
        super().project(before, position)
        self._carry(self._bands, position, self._earlier, self._inertial)
