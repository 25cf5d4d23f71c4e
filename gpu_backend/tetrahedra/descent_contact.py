"""Contact in vertex block descent, on CUDA: as cpu_backend/tetrahedra/descent_contact.py, for one vertex."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.contact.surfaces import SurfaceContacts
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_contact import make_contact
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import descent, friction, newton, solving


@cache
def make_meeting(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `add_contact(sums, b, p, holds, world, number)`: it adds the contribution of colliders to the sums of a vertex at
    `p`, which was at `b` at the start of substep `number` (quads). `has_bodies`: true if there are colliders."""
    inline, contact = inlined(math), make_contact(real, math, parts)
    within, outer = contact.within, device_formulas(newton, real, math).outer
    rub = device_formulas(friction, real, math)
    unit, straight, slid, heading, sliding, rubbed = (
        rub.unit, rub.straight, rub.slid, rub.heading, rub.sliding, rub.rubbed,
    )  # fmt: skip
    added, touch = device_formulas(descent, real, math).added, make_collide(real, math, parts)
    scaled = device_formulas(solving, real, math).scaled
    zero, has_friction = real(0), "friction" in parts

    @inline
    def add_contact(sums, b, p, holds, world, number):
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

    return SimpleNamespace(has_bodies=contact.has_bodies, add_contact=add_contact)


@cache
def make_carry(real: Real, math: str) -> SimpleNamespace:
    """Compile remember(position, earlier) and carry(position, earlier, inertial), one thread per particle."""
    carried = device_formulas(descent, real, math).carried

    def remember(position, earlier):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p = load_quad(position, k)
            store_quad(earlier, k, p[0], p[1], p[2], p[3])

    def carry(position, earlier, inertial):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, q, y = load_quad(position, k), load_quad(earlier, k), load_quad(inertial, k)
            store_quad(
                inertial, k, carried(y[0], p[0], q[0]), carried(y[1], p[1], q[1]), carried(y[2], p[2], q[2]), y[3]
            )  # fmt: skip

    return make_kernels((remember, carry), f"carry_{variant_name(real, math)}", **kernel_options(math))


class CarriedContacts(SurfaceContacts):
    """Contacts of surfaces, as in cpu_backend/tetrahedra/descent_contact.py. `inertial`: quads, on the device."""

    def __init__(self, *arguments: Any, inertial: Any):
        super().__init__(*arguments)
        self._inertial, self._carry = inertial, make_carry(*arguments[1:3])
        self._earlier = self._new(np.zeros(inertial.size, self._real))

    @property
    def projecting(self) -> int:
        return super().projecting + 2

    def project(self, before: DeviceArray, position: DeviceArray) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        self._carry.remember[self._of_masses](position, self._earlier)
        super().project(before, position)
        self._carry.carry[self._of_masses](position, self._earlier, self._inertial)
