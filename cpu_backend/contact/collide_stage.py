"""The colliders of the kernel `stages`, over the whole sheet."""

from __future__ import annotations

from collections.abc import Callable

from numba import prange

from softlab.cpu_backend.contact.colliders import make_collide_mass
from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real


def make_collide_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile collide(bodies, kinds, step, parameters, before, state): masses at the step's end; `before`: at its
    start."""
    collide_mass = make_collide_mass(compiler, real, parts)

    def collide(bodies, kinds, step, record, before, state):
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

    return compiler.kernel(collide)
