"""CUDA kernels of a fluid's motion, prediction and velocities, one thread per particle (model/fluid/plan.py). The
fourth number of a position is the particle's fluid, before and after a substep.

Bytes per particle in float32, with n neighbours: `begin` reads 36 and writes 32; `settle` reads 4 n + 68 and writes 32;
`shape` reads 4 n + 32 and writes 32; `smooth` reads 4 n + 64 and writes 16. All are bound by memory except for the
neighbours, 24 to 45 flop each.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.forces import make_particle_force
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import COLLIDERS, make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.extent import make_extent
from softlab.gpu_backend.fluid.kernels import make_move, walk_options
from softlab.gpu_backend.fluid.sort_kernels import make_box
from softlab.gpu_backend.fluid.sums import List, make_row
from softlab.gpu_backend.fluid.walls import make_settled
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import (
    F_BUOYANCY,
    F_CHANGE,
    F_DRAG,
    F_SPEED,
    F_SURFACE_DRAG,
    F_WEIGHT,
)
from softlab.model.fluid.plan import SMOOTHING
from softlab.model.formulas.fluid import impact, motion

SLOWED = 1  # index in `counts`


@cache
def make_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `answered` and `limited`.

    `answered(b, u, x, y, z, multiplier, fluids, at, world, number)` -> (x, y, z, vx, vy, vz): a particle that moved
    from b, with predicted velocity u, to (x, y, z), after the colliders; the row of its fluid begins at `at`.
    `limited(vx, vy, vz, c, fluids, at, parameters)`: the velocity after drag and the speed limit.
    """
    formulas, inline, collide = device_formulas(motion, real, math), inlined(math), make_collide(real, math, parts)
    impacts = device_formulas(impact, real, math)
    velocity_of, limited_change, speed_of = formulas.velocity_of, formulas.limited_change, formulas.speed_of
    braked, slowed = formulas.braked, formulas.slowed
    is_limited, is_dragged, touches = "held-back" in parts, "drag" in parts, bool(parts & COLLIDERS)
    after_impact, drifted, settled = impacts.after_impact, formulas.drifted, make_settled(real, math, parts)

    @inline
    def limit_change(vx, vy, vz, ux, uy, uz, most):
        if is_limited:
            far = speed_of(vx - ux, vy - uy, vz - uz)
            return (
                limited_change(vx, ux, far, most),
                limited_change(vy, uy, far, most),
                limited_change(vz, uz, far, most),
            )
        return vx, vy, vz

    @inline
    def answered(b, u, x, y, z, multiplier, fluids, at, world, number):
        inverse, h, most = world.parameters.inverse_dt, world.parameters.dt, fluids[at + F_CHANGE]
        vx, vy, vz = velocity_of(x, b[0], inverse), velocity_of(y, b[1], inverse), velocity_of(z, b[2], inverse)
        vx, vy, vz = limit_change(vx, vy, vz, u[0], u[1], u[2], most)
        if touches:
            px, py, pz = drifted(b[0], u[0], h), drifted(b[1], u[1], h), drifted(b[2], u[2], h)
            qx, qy, qz, ux, uy, uz = collide(b, px, py, pz, u[0], u[1], u[2], world, number)
            if qx != px or qy != py or qz != pz:
                vx, vy = after_impact(ux, x, qx, inverse), after_impact(uy, y, qy, inverse)
                vx, vy, vz = limit_change(vx, vy, after_impact(uz, z, qz, inverse), ux, uy, uz, most)
            weight, velocity = fluids[at + F_WEIGHT], (ux, uy, uz)
            vx, vy, vz = settled((qx, qy, qz), (vx, vy, vz), velocity, multiplier, weight, world, number)
        return collide(b, x, y, z, vx, vy, vz, world, number)

    @inline
    def limited(vx, vy, vz, c, fluids, at, parameters):
        if is_dragged:
            drag, surface_drag, dt = fluids[at + F_DRAG], fluids[at + F_SURFACE_DRAG], parameters.dt
            vx = braked(vx, dt, drag, surface_drag, c)
            vy, vz = braked(vy, dt, drag, surface_drag, c), braked(vz, dt, drag, surface_drag, c)
        speed, most = speed_of(vx, vy, vz), fluids[at + F_SPEED]
        return slowed(vx, speed, most), slowed(vy, speed, most), slowed(vz, speed, most)

    return SimpleNamespace(answered=answered, limited=limited)


@cache
def make_begin(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> Kernel:
    """Compile begin(position, velocity, particle, limit, record, fluids, bodies, integers, counter, place, substeps,
    substep, predicted, before, predicted_velocity, boxes, counts).

    It predicts positions, out of the colliders, and writes the box of each block's particles; in blocks of
    sort_kernels.THREADS. `before` is written if axes are periodic. `particle`: the particles' numbers; `limit` [m]: see
    `bound`. `counts[SLOWED]`: how many particles the speed limit slowed.
    """
    axes = 2 if "flat" in parts else 3
    formulas, store_box, clock = device_formulas(motion, real, math), make_box(real), make_clock(math, parts)
    accelerated, buoyant, drifted = formulas.accelerated, formulas.buoyant, formulas.drifted
    speed_of, slowed, wrapped_offset = formulas.speed_of, formulas.slowed, formulas.wrapped_offset
    particle_force, row = make_particle_force(real, math, axes, parts), make_row(parts)
    has_gravity, solid, goes_round = "gravity" in parts, axes == 3, bool(repeats)
    along_x, along_y, along_z = "x" in repeats, "y" in repeats, "z" in repeats
    zero, one, none, extent = real(0), real(1), real(np.inf), make_extent(parts)
    collide, one_more = make_collide(real, math, parts), np.int64(1)

    def begin(
        position, velocity, particle, limit, record, fluids, bodies, integers, counter, place, substeps, substep, predicted,
        before, predicted_velocity, boxes, counts,
    ):  # fmt: skip
        parameters = record[0]
        step, number = clock(counter, place, substeps, substep)
        lx, ly, lz, hx, hy, hz = none, none, none, -none, -none, -none
        _, there = extent(particle)
        for k in range(np.int32(cuda.grid(1)), there, np.int32(cuda.gridsize(1))):
            p, v = load_quad(position, k), load_quad(velocity, k)
            at = row(p[3])
            ay = zero
            if has_gravity:
                ay = buoyant(parameters.gravity, fluids[at + F_BUOYANCY])
            if solid:
                ax, ay, az = particle_force((zero, ay, zero), particle[k], one, parameters, integers, step)
            else:
                ax, ay = particle_force((zero, ay), particle[k], one, parameters, integers, step)
                az = zero
            h = parameters.dt
            ux, uy, uz = accelerated(v[0], h, ax), accelerated(v[1], h, ay), accelerated(v[2], h, az)
            speed, most = speed_of(ux, uy, uz), fluids[at + F_SPEED]
            if speed > most:
                cuda.atomic.add(counts, SLOWED, one_more)
            ux, uy, uz = slowed(ux, speed, most), slowed(uy, speed, most), slowed(uz, speed, most)
            x, y, z, b = drifted(p[0], ux, h), drifted(p[1], uy, h), drifted(p[2], uz, h), p
            if goes_round:
                sx, sy, sz = zero, zero, zero
                if along_x:
                    sx = wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
                if along_y:
                    sy = wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
                if along_z:
                    sz = wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
                x, y, z = x + sx, y + sy, z + sz
                b = p[0] + sx, p[1] + sy, p[2] + sz, p[3]
                store_quad(before, k, b[0], b[1], b[2], b[3])
            x, y, z, _, _, _ = collide(b, x, y, z, ux, uy, uz, World(parameters, bodies, integers), number)
            store_quad(predicted, k, x, y, z, p[3])
            store_quad(predicted_velocity, k, ux, uy, uz, zero)
            if abs(x) <= limit and abs(y) <= limit and abs(z) <= limit:  # false for NaN
                lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
                hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
        store_box(lx, ly, lz, hx, hy, hz, boxes)

    name = f"fluid_{variant_name(real, math, parts, repeats)}"
    return make_kernels((begin,), name, **kernel_options(math)).begin


@cache
def make_settle(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `settle`, `update` and `limit`.

    `settle(before, predicted_velocity, position, record, table, neighbour_counts, multipliers, constraints, gradients,
    fluids, *world, new_position, new_velocity)`: the last correction, then velocities, limited unless smoothing
    follows; `update(before, predicted_velocity, position, record, multipliers, fluids, *world, new_position,
    new_velocity)`: velocities only; `limit(position, velocity, constraints, record, fluids)`.
    """
    ends, move, row = make_ends(real, math, parts), make_move(real, math, parts, repeats), make_row(parts)
    answered, limited, clock = ends.answered, ends.limited, make_clock(math, parts)
    ended, is_dragged, zero, extent = not parts & SMOOTHING, "drag" in parts, real(0), make_extent(parts)

    def settle(
        before, predicted_velocity, position, record, table, neighbour_counts, multipliers, constraints, gradients,
        fluids, bodies, integers, counter, place, substeps, substep, new_position, new_velocity,
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        particles, there = extent(neighbour_counts)
        if k < there:
            p, b, near_by = load_quad(position, k), load_quad(before, k), List(table, neighbour_counts[k], particles)
            _, number = clock(counter, place, substeps, substep)
            world, at = World(record[0], bodies, integers), row(b[3])
            x, y, z = move(k, p, b, position, near_by, gradients, fluids, world, number)
            x, y, z, vx, vy, vz = answered(
                b, load_quad(predicted_velocity, k), x, y, z, multipliers[k], fluids, at, world, number
            )  # fmt: skip
            if ended:
                c = constraints[k] if is_dragged else zero
                vx, vy, vz = limited(vx, vy, vz, c, fluids, at, record[0])
            store_quad(new_position, k, x, y, z, b[3])
            store_quad(new_velocity, k, vx, vy, vz, zero)

    def update(
        before, predicted_velocity, position, record, multipliers, fluids, bodies, integers, counter, place, substeps,
        substep, new_position, new_velocity,
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        if k < new_position.size // SIZE:
            p, b = load_quad(position, k), load_quad(before, k)
            _, number = clock(counter, place, substeps, substep)
            world = World(record[0], bodies, integers)
            x, y, z, vx, vy, vz = answered(
                b, load_quad(predicted_velocity, k), p[0], p[1], p[2], multipliers[k], fluids, row(b[3]), world, number
            )  # fmt: skip
            store_quad(new_position, k, x, y, z, b[3])
            store_quad(new_velocity, k, vx, vy, vz, zero)

    def limit(position, velocity, constraints, record, fluids):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v, c = load_quad(position, k), load_quad(velocity, k), zero
            if is_dragged:
                c = constraints[k]
            vx, vy, vz = limited(v[0], v[1], v[2], c, fluids, row(p[3]), record[0])
            store_quad(velocity, k, vx, vy, vz, zero)

    name = f"fluid_{variant_name(real, math, parts, repeats)}"
    return make_kernels((settle, update, limit), name, **walk_options(real, math))
