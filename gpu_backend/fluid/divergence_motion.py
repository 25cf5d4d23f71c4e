"""CUDA kernels of a fluid's velocities and positions by the scheme `divergence-free`, around its solves, one thread per
particle (model/fluid/divergence_plan.py, 1, 6, 8 and 11)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.forces import make_particle_force
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import COLLIDERS, make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.motion import SLOWED
from softlab.gpu_backend.fluid.sums import make_row
from softlab.gpu_backend.fluid.walls import make_settled
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_BUOYANCY, F_CHANGE, F_DRAG, F_SPEED, F_SURFACE_DRAG, F_WEIGHT
from softlab.model.formulas.fluid import divergence, motion


@cache
def _make_corrected_velocity(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `corrected_velocity(v, e, most, parameters)`, a velocity after a solve, and `limited(vx, vy, vz, most)`."""
    m, gained = device_formulas(motion, real, math), device_formulas(divergence, real, math).gained
    speed_of, limited_change, slowed, is_limited = m.speed_of, m.limited_change, m.slowed, "held-back" in parts

    @inlined(math)
    def corrected_velocity(v, e, most, parameters):
        rate = parameters.inverse_dt
        x, y, z = gained(v[0], e[0], rate), gained(v[1], e[1], rate), gained(v[2], e[2], rate)
        if is_limited:
            far = speed_of(x - v[0], y - v[1], z - v[2])
            return (
                limited_change(x, v[0], far, most),
                limited_change(y, v[1], far, most),
                limited_change(z, v[2], far, most),
            )
        return x, y, z

    @inlined(math)
    def limited(vx, vy, vz, most):
        speed = speed_of(vx, vy, vz)
        return slowed(vx, speed, most), slowed(vy, speed, most), slowed(vz, speed, most)

    return SimpleNamespace(corrected_velocity=corrected_velocity, limited=limited)


@cache
def make_free_motion(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `gather`, `take_up`, `accelerate` and `move`.

    `gather(position, record, into)`: positions wrapped into the periodic box; `take_up(before, velocity, shifts,
    record, fluids)`; `accelerate(before, velocity, particle, constraints, record, fluids, integers, counter, place,
    substeps, substep, into, counts)`; `move(before, velocity, shifts, multipliers, seconds, record, fluids, *world,
    new_position, new_velocity)`. `before`: positions and fluids of particles; `world`: bodies, integers, counter,
    place, substeps, substep.
    """
    m, ends, row = (
        device_formulas(motion, real, math),
        _make_corrected_velocity(real, math, parts),
        make_row(parts),
    )
    wrapped_offset, drifted, corrected_velocity, limited = (
        m.wrapped_offset,
        m.drifted,
        ends.corrected_velocity,
        ends.limited,
    )
    accelerated, settled = _make_accelerated(real, math, parts), make_settled(real, math, parts)
    collide, clock, zero = make_collide(real, math, parts), make_clock(math, parts), real(0)
    speed_of, one_more = m.speed_of, np.int64(1)
    along_x, along_y, along_z, touches = "x" in repeats, "y" in repeats, "z" in repeats, bool(parts & COLLIDERS)

    def gather(position, record, into):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            parameters, p = record[0], load_quad(position, k)
            x, y, z = p[0], p[1], p[2]
            if along_x:
                x = x + wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
            if along_y:
                y = y + wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
            if along_z:
                z = z + wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
            store_quad(into, k, x, y, z, p[3])

    def take_up(before, velocity, shifts, record, fluids):
        k = np.int32(cuda.grid(1))
        if k < before.size // SIZE:
            at = row(load_quad(before, k)[3])
            vx, vy, vz = corrected_velocity(
                load_quad(velocity, k), load_quad(shifts, k), fluids[at + F_CHANGE], record[0]
            )
            store_quad(velocity, k, vx, vy, vz, zero)

    def accelerate(
        before, velocity, particle, constraints, record, fluids, integers, counter, place, substeps, substep, into,
        counts,
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        if k < before.size // SIZE:
            step, _ = clock(counter, place, substeps, substep)
            at, v = row(load_quad(before, k)[3]), load_quad(velocity, k)
            vx, vy, vz = accelerated(k, v, at, particle, constraints, record[0], fluids, integers, step)
            if speed_of(vx, vy, vz) > fluids[at + F_SPEED]:
                cuda.atomic.add(counts, SLOWED, one_more)
            vx, vy, vz = limited(vx, vy, vz, fluids[at + F_SPEED])
            store_quad(into, k, vx, vy, vz, zero)

    def move(
        before, velocity, shifts, multipliers, seconds, record, fluids, bodies, integers, counter, place, substeps, substep,
        new_position, new_velocity,
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        if k < before.size // SIZE:
            parameters, b = record[0], load_quad(before, k)
            at, h = row(b[3]), parameters.dt
            u = load_quad(velocity, k)
            vx, vy, vz = corrected_velocity(u, load_quad(shifts, k), fluids[at + F_CHANGE], parameters)
            vx, vy, vz = limited(vx, vy, vz, fluids[at + F_SPEED])
            x, y, z = drifted(b[0], vx, h), drifted(b[1], vy, h), drifted(b[2], vz, h)
            _, number = clock(counter, place, substeps, substep)
            world = World(parameters, bodies, integers)
            if touches:
                vx, vy, vz = settled(b, (vx, vy, vz), u, seconds[k], fluids[at + F_WEIGHT], world, number)
            x, y, z, vx, vy, vz = collide(b, x, y, z, vx, vy, vz, world, number)
            if touches:
                vx, vy, vz = limited(vx, vy, vz, fluids[at + F_SPEED])
            multipliers[k] = multipliers[k] + seconds[k]
            store_quad(new_position, k, x, y, z, b[3])
            store_quad(new_velocity, k, vx, vy, vz, zero)

    name = f"fluid_{variant_name(real, math, parts, repeats)}"
    return make_kernels((gather, take_up, accelerate, move), name, **kernel_options(math))


@cache
def _make_accelerated(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make accelerated(k, v, at, particle, constraints, parameters, fluids, integers, step).

    It returns the velocity after drag and the particle's own forces; `at`: the row of its fluid.
    """
    m, axes = device_formulas(motion, real, math), 2 if "flat" in parts else 3
    accelerate, buoyant, braked = m.accelerated, m.buoyant, m.braked
    particle_force, has_gravity, is_dragged = (
        make_particle_force(real, math, axes, parts),
        "gravity" in parts,
        "drag" in parts,
    )
    solid, zero, one = axes == 3, real(0), real(1)

    @inlined(math)
    def accelerated(k, v, at, particle, constraints, parameters, fluids, integers, step):
        vx, vy, vz, h, ay = v[0], v[1], v[2], parameters.dt, zero
        if is_dragged:
            c, drag, surface = constraints[k], fluids[at + F_DRAG], fluids[at + F_SURFACE_DRAG]
            vx, vy = braked(vx, h, drag, surface, c), braked(vy, h, drag, surface, c)
            vz = braked(vz, h, drag, surface, c)
        if has_gravity:
            ay = buoyant(parameters.gravity, fluids[at + F_BUOYANCY])
        if solid:
            ax, ay, az = particle_force((zero, ay, zero), particle[k], one, parameters, integers, step)
        else:
            ax, ay = particle_force((zero, ay), particle[k], one, parameters, integers, step)
            az = zero
        return accelerate(vx, h, ax), accelerate(vy, h, ay), accelerate(vz, h, az)

    return accelerated
