"""The colliders of the kernel `stages`, over the whole sheet."""

from __future__ import annotations

from collections.abc import Callable

from numba import prange

from softlab.cpu_backend.contact.colliders import collide_mass
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import features_of, routine


@routine
def collide(bodies, kinds, step, record, before, state):
    """Collide masses at the step's end, `state`, whose positions at its start are `before`."""
    rows, columns = before[0].shape
    ax, ay, az = before
    x, y, z, vx, vy, vz = state
    for i in prange(rows):
        for j in range(columns):
            p, v = collide_mass(
                bodies, kinds, step, record[0], (ax[i, j], ay[i, j], az[i, j]), (x[i, j], y[i, j], z[i, j]),
                (vx[i, j], vy[i, j], vz[i, j]),
            )  # fmt: skip
            x[i, j], y[i, j], z[i, j] = p
            vx[i, j], vy[i, j], vz[i, j] = v


def make_collide_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile `collide`."""
    return compiler.kernel(compiler.variant_of(real, features_of(parts)).copied(collide))
