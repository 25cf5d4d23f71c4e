"""Positions of a cloth's pinned masses that follow a motion, as a device function.

The fourth number of a mass's position marks it: 0 free, STILL pinned, else the offset of its row in `bodies` (the flat
array `body_rows` of model/contact/cloth_parameters.py, where rows of pins follow others, so never at 0 or 1).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.contact.cloth_parameters import P_MOTION, PIN_FIELDS
from softlab.model.contact.pins import follow
from softlab.model.core.build import Body
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.motion import middle

STILL = 1.0
ROW = np.int32(PIN_FIELDS)


def pin_marks(body: Body, bodies: np.ndarray, first: int) -> np.ndarray:
    """Return (particles,) the masses' marks in the arithmetic of `bodies`. `bodies`, `first`: of `body_rows`.

    Raises SceneError for more rows of pins than integers that this arithmetic can represent.
    """
    marks = (body.inverse_mass == 0).astype(bodies.dtype)
    if first:
        places = first + PIN_FIELDS * np.arange(len(body.pinned))
        most = int(2 / float(np.finfo(bodies.dtype).eps))
        if len(bodies) > most:
            raise SceneError(
                "cloth.pinned", len(body.pinned),
                f"at most {most // PIN_FIELDS} pins beside a motion in {bodies.dtype}; use float64",
            )  # fmt: skip
        moving = bodies[places + P_MOTION] >= 0
        marks[body.pinned[moving]] = places[moving]
    return marks


@inlined_routine
def pin(mark, p, step, halfway, world):
    """Return (x, y, z, vx, vy, vz), the state of a pinned mass, which was at p, at the end of step number `step`, or
    half-way through it."""
    parameters, bodies = world.parameters, world.colliders
    x, y, z, vx, vy, vz = p[0], p[1], p[2], 0.0, 0.0, 0.0
    if FEATURE.motion:
        if mark > STILL:
            clock = parameters.dt, parameters.first_step, parameters.first_time
            time = middle(step, *clock) if halfway else instant(step + 1, *clock)
            x, y, z, vx, vy, vz = follow(bodies, np.int32(mark), time)
    return x, y, z, vx, vy, vz


@routine
def drive(position, velocity, record, bodies, driven, first, pins, counter, place, substeps, substep):
    """Set position and velocity of pinned particles at a substep's end by their motions: of `driven` (pins,), all
    pinned particles, whose rows begin at `first` of `bodies`; those without a motion are unchanged."""
    parameters = record[0]
    n = np.int32(cuda.grid(1))
    if n < pins:
        at = np.int32(first + ROW * n)
        if bodies[at + P_MOTION] >= 0.0:
            number = (counter[0] + place) * substeps + substep
            time = instant(number + 1, parameters.dt, parameters.first_step, parameters.first_time)
            x, y, z, vx, vy, vz = follow(bodies, at, time)
            k = driven[n]
            store_quad(position, k, x, y, z, load_quad(position, k)[3])
            store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_drive(real: Real, math: str) -> Kernel:
    """Compile `drive`."""
    return kernels_of(device_variant(real, math), math, (drive,), f"pins_{variant_name(real, math)}").drive
