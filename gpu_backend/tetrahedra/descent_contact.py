"""Contact in vertex block descent, on CUDA: as cpu_backend/tetrahedra/descent_contact.py, for one vertex."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.surfaces import SurfaceContacts
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_contact import touch, within
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.formulas.elastic.descent import added, carried
from softlab.model.formulas.elastic.friction import heading, rubbed, slid, sliding, straight, unit
from softlab.model.formulas.elastic.newton import outer
from softlab.model.formulas.elastic.solving import scaled
from softlab.model.scene.scene import Scene


@inlined_routine
def add_contact(sums, b, p, holds, world, number):
    """Add the contribution of colliders to the sums of a vertex at `p`, which was at `b` at the start of substep `number`
    (quads)."""
    x, y, z, hard = within(b, p, holds, world, number)
    if (x != 0.0) | (y != 0.0) | (z != 0.0):
        xx, xy, xz, yy, yz, zz = outer(x, y, z, hard)
        fx, fy, fz = scaled(hard, x, y, z)
        sums = added(sums, (fx, fy, fz, xx, yy, zz, xy, xz, yz))
        if FEATURE.friction:
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


@routine
def remember(position, earlier):
    """Store positions before contacts push them."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        store_quad(earlier, k, p[0], p[1], p[2], p[3])


@routine
def carry(position, earlier, inertial):
    """Move `inertial` by the pushes from `earlier` to `position`."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, q, y = load_quad(position, k), load_quad(earlier, k), load_quad(inertial, k)
        store_quad(
            inertial, k, carried(y[0], p[0], q[0]), carried(y[1], p[1], q[1]), carried(y[2], p[2], q[2]), y[3]
        )  # fmt: skip


@cache
def make_carry(real: Real, math: str) -> SimpleNamespace:
    """Compile `remember` and `carry`, one thread per particle."""
    return kernels_of(device_variant(real, math), math, (remember, carry), f"carry_{variant_name(real, math)}")


class CarriedContacts(SurfaceContacts):
    """Contacts of surfaces, as in cpu_backend/tetrahedra/descent_contact.py. `inertial`: quads, on the device."""

    def __init__(self, scene: Scene, real: Any, math: str, weights: np.ndarray, stream: Any, inertial: Any):
        super().__init__(scene, real, math, weights, stream)
        self._inertial, self._carry = inertial, make_carry(real, math)
        self._earlier = self._new(np.zeros(inertial.size, self._real))

    @property
    def projecting(self) -> int:
        return super().projecting + 2

    def project(self, before: DeviceArray, position: DeviceArray) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        self._carry.remember[self._of_masses](position, self._earlier)
        super().project(before, position)
        self._carry.carry[self._of_masses](position, self._earlier, self._inertial)
