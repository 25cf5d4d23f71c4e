"""Pinned particles that move, in Newton's method on CUDA: the position of one of them at a substep's end."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.gpu_backend.contact.pins import make_pins
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import P_MOTION
from softlab.model.formulas import cloth

MOTION = "motion"  # among the parts


@cache
def make_driven(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `driven(k, b, pins, world, number)` -> (x, y, z, vx, vy, vz): the pinned particle k, which was at `b` (a
    quad), at the end of substep `number`: at rest there, unless it follows a motion. `moves`: true if any pin does."""
    inline, moves = inlined(math), MOTION in parts
    follow = make_pins(real, math, frozenset({MOTION})).follow
    instant = device_formulas(cloth, real, math).instant
    zero, one, nowhere = real(0), np.int64(1), np.int32(0)

    @inline
    def driven(k, b, pins, world, number):
        x, y, z, vx, vy, vz = b[0], b[1], b[2], zero, zero, zero
        pin = pins[k]
        if pin > nowhere:
            if world.colliders[pin + P_MOTION] >= zero:
                parameters = world.parameters
                time = instant(number + one, parameters.dt, parameters.first_step, parameters.first_time)
                x, y, z, vx, vy, vz = follow(world.colliders, pin, time)
        return x, y, z, vx, vy, vz

    return SimpleNamespace(moves=moves, driven=driven)
