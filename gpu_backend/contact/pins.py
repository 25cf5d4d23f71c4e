"""Positions of a cloth's pinned masses that follow a motion, as a device function.

The fourth number of a mass's position marks it: 0 free, STILL pinned, else the offset of its row in `bodies` (the flat
array `body_rows` of model/contact/cloth_parameters.py, where rows of pins follow others, so never at 0 or 1).
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real
from softlab.model.contact.cloth_parameters import (
    M_DURATION,
    M_SPIN,
    M_START,
    M_TURNS,
    M_U,
    M_V,
    M_VX,
    M_VY,
    M_VZ,
    M_W,
    M_X,
    M_Y,
    M_Z,
    P_MOTION,
    P_X,
    P_Y,
    P_Z,
    PIN_FIELDS,
)
from softlab.model.core.build import Body
from softlab.model.formulas import cloth, motion

STILL = 1


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


@cache
def make_pins(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `pin(mark, p, step, halfway, world)` -> (x, y, z, vx, vy, vz): the state of a pinned mass, which was at p,
    at the end of step number `step`, or half-way through it; `mark`: its mark."""
    has_motion = "motion" in parts
    paths, instant = device_formulas(motion, real, math), device_formulas(cloth, real, math).instant
    turn, placed, middle = paths.turn, paths.placed, paths.middle
    inline = inlined(math)
    zero, still, one = real(0), real(STILL), np.int64(1)

    @inline
    def follow(bodies, pin, time):
        """Return (x, y, z, vx, vy, vz) at `time` [s] of the mass whose row begins at `pin`, which must name a
        motion."""
        row = np.int32(bodies[pin + P_MOTION])
        moment = turn(time, bodies[row + M_START], bodies[row + M_DURATION], bodies[row + M_TURNS])
        return placed(
            (bodies[pin + P_X], bodies[pin + P_Y], bodies[pin + P_Z]),
            (bodies[row + M_X], bodies[row + M_Y], bodies[row + M_Z]),
            (bodies[row + M_U], bodies[row + M_V], bodies[row + M_W]),
            (bodies[row + M_VX], bodies[row + M_VY], bodies[row + M_VZ]), bodies[row + M_SPIN], moment,
        )  # fmt: skip

    @inline
    def pin(mark, p, step, halfway, world):
        parameters, bodies = world.parameters, world.colliders
        x, y, z, vx, vy, vz = p[0], p[1], p[2], zero, zero, zero
        if has_motion:
            if mark > still:
                clock = parameters.dt, parameters.first_step, parameters.first_time
                time = middle(step, *clock) if halfway else instant(step + one, *clock)
                x, y, z, vx, vy, vz = follow(bodies, np.int32(mark), time)
        return x, y, z, vx, vy, vz

    return SimpleNamespace(follow=follow, pin=pin)


@cache
def make_drive(real: Real, math: str) -> Kernel:
    """Compile drive(position, velocity, record, bodies, driven, first, pins, counter, place, substeps, substep).

    It sets position and velocity of pinned particles at a substep's end by their motions: of `driven` (pins,), all
    pinned particles, whose rows begin at `first` of `bodies`; those without a motion are unchanged.
    """
    follow = make_pins(real, math, frozenset({"motion"})).follow
    instant = device_formulas(cloth, real, math).instant
    zero, one, nobody, wide = real(0), np.int64(1), real(0), np.int32(PIN_FIELDS)

    def drive(position, velocity, record, bodies, driven, first, pins, counter, place, substeps, substep):
        parameters = record[0]
        n = np.int32(cuda.grid(1))
        if n < pins:
            pin = np.int32(first + wide * n)
            if bodies[pin + P_MOTION] >= nobody:
                number = (counter[0] + place) * substeps + substep
                time = instant(number + one, parameters.dt, parameters.first_step, parameters.first_time)
                x, y, z, vx, vy, vz = follow(bodies, pin, time)
                k = driven[n]
                store_quad(position, k, x, y, z, load_quad(position, k)[3])
                store_quad(velocity, k, vx, vy, vz, zero)

    return make_kernel(drive, f"pins_{variant_name(real, math)}", **kernel_options(math))
