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

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import Kernel, kernels_of, make_kernels, variant_name
from softlab.gpu_backend.core.forces import particle_force, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.extent import extent
from softlab.gpu_backend.fluid.kernels import move, walk_options
from softlab.gpu_backend.fluid.sort_kernels import UNBOUNDED, store_box
from softlab.gpu_backend.fluid.sums import List, row
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.gpu_backend.fluid.walls import settled
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.fluid.parameters import (
    F_BUOYANCY,
    F_CHANGE,
    F_DRAG,
    F_SPEED,
    F_SURFACE_DRAG,
    F_WEIGHT,
)
from softlab.model.formulas.fluid.impact import after_impact
from softlab.model.formulas.fluid.motion import (
    accelerated,
    braked,
    buoyant,
    drifted,
    limited_change,
    slowed,
    speed_of,
    velocity_of,
    wrapped_offset,
)

SLOWED = 1  # index in `counts`


@inlined_routine
def limit_change(vx, vy, vz, ux, uy, uz, most):
    """Return the velocity v with a limited change from u."""
    if FEATURE.limited_change:
        far = speed_of(vx - ux, vy - uy, vz - uz)
        return (
            limited_change(vx, ux, far, most),
            limited_change(vy, uy, far, most),
            limited_change(vz, uz, far, most),
        )
    return vx, vy, vz


@inlined_routine
def limit_speed(vx, vy, vz, most):
    speed = speed_of(vx, vy, vz)
    return slowed(vx, speed, most), slowed(vy, speed, most), slowed(vz, speed, most)


@inlined_routine
def after_colliders(b, u, x, y, z, multiplier, fluids, at, world, number):
    """Return (x, y, z, vx, vy, vz) of a particle that moved from b, with predicted velocity u, to (x, y, z), after the
    colliders; the row of its fluid begins at `at`."""
    inverse, h, most = world.parameters.inverse_dt, world.parameters.dt, fluids[at + F_CHANGE]
    vx, vy, vz = velocity_of(x, b[0], inverse), velocity_of(y, b[1], inverse), velocity_of(z, b[2], inverse)
    vx, vy, vz = limit_change(vx, vy, vz, u[0], u[1], u[2], most)
    if FEATURE.colliders:
        px, py, pz = drifted(b[0], u[0], h), drifted(b[1], u[1], h), drifted(b[2], u[2], h)
        qx, qy, qz, ux, uy, uz = collide(b, px, py, pz, u[0], u[1], u[2], world, number)
        if qx != px or qy != py or qz != pz:
            vx, vy = after_impact(ux, x, qx, inverse), after_impact(uy, y, qy, inverse)
            vx, vy, vz = limit_change(vx, vy, after_impact(uz, z, qz, inverse), ux, uy, uz, most)
        weight, velocity = fluids[at + F_WEIGHT], (ux, uy, uz)
        vx, vy, vz = settled((qx, qy, qz), (vx, vy, vz), velocity, multiplier, weight, world, number)
    return collide(b, x, y, z, vx, vy, vz, world, number)


@inlined_routine
def limited(vx, vy, vz, c, fluids, at, parameters):
    """Return the velocity after drag and the speed limit."""
    if FEATURE.drag:
        drag, surface_drag, dt = fluids[at + F_DRAG], fluids[at + F_SURFACE_DRAG], parameters.dt
        vx = braked(vx, dt, drag, surface_drag, c)
        vy, vz = braked(vy, dt, drag, surface_drag, c), braked(vz, dt, drag, surface_drag, c)
    return limit_speed(vx, vy, vz, fluids[at + F_SPEED])


@routine
def begin(
    position, velocity, particle, limit, record, fluids, bodies, integers, counter, place, substeps, substep, predicted,
    before, predicted_velocity, boxes, counts,
):  # fmt: skip
    parameters = record[0]
    step, number = clock(counter, place, substeps, substep)
    lx, ly, lz, hx, hy, hz = UNBOUNDED, UNBOUNDED, UNBOUNDED, -UNBOUNDED, -UNBOUNDED, -UNBOUNDED
    _, there = extent(particle)
    for k in range(np.int32(cuda.grid(1)), there, np.int32(cuda.gridsize(1))):
        p, v = load_quad(position, k), load_quad(velocity, k)
        at = row(p[3])
        ay = 0.0
        if FEATURE.gravity:
            ay = buoyant(parameters.gravity, fluids[at + F_BUOYANCY])
        if FEATURE.axes == 3:
            ax, ay, az = particle_force((0.0, ay, 0.0), particle[k], 1.0, parameters, integers, step)
        else:
            ax, ay = particle_force((0.0, ay), particle[k], 1.0, parameters, integers, step)
            az = 0.0
        h = parameters.dt
        ux, uy, uz = accelerated(v[0], h, ax), accelerated(v[1], h, ay), accelerated(v[2], h, az)
        speed, most = speed_of(ux, uy, uz), fluids[at + F_SPEED]
        if speed > most:
            cuda.atomic.add(counts, SLOWED, 1)
        ux, uy, uz = slowed(ux, speed, most), slowed(uy, speed, most), slowed(uz, speed, most)
        x, y, z, b = drifted(p[0], ux, h), drifted(p[1], uy, h), drifted(p[2], uz, h), p
        if FEATURE.periodic_x or FEATURE.periodic_y or FEATURE.periodic_z:
            sx, sy, sz = 0.0, 0.0, 0.0
            if FEATURE.periodic_x:
                sx = wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
            if FEATURE.periodic_y:
                sy = wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
            if FEATURE.periodic_z:
                sz = wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
            x, y, z = x + sx, y + sy, z + sz
            b = p[0] + sx, p[1] + sy, p[2] + sz, p[3]
            store_quad(before, k, b[0], b[1], b[2], b[3])
        x, y, z, _, _, _ = collide(b, x, y, z, ux, uy, uz, World(parameters, bodies, integers), number)
        store_quad(predicted, k, x, y, z, p[3])
        store_quad(predicted_velocity, k, ux, uy, uz, 0.0)
        if abs(x) <= limit and abs(y) <= limit and abs(z) <= limit:  # false for NaN
            lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
            hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
    store_box(lx, ly, lz, hx, hy, hz, boxes)


@routine
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
        x, y, z, vx, vy, vz = after_colliders(
            b, load_quad(predicted_velocity, k), x, y, z, multipliers[k], fluids, at, world, number
        )  # fmt: skip
        if not FEATURE.smoothing:
            c = constraints[k] if FEATURE.drag else 0.0
            vx, vy, vz = limited(vx, vy, vz, c, fluids, at, record[0])
        store_quad(new_position, k, x, y, z, b[3])
        store_quad(new_velocity, k, vx, vy, vz, 0.0)


@routine
def update(
    before, predicted_velocity, position, record, multipliers, fluids, bodies, integers, counter, place, substeps,
    substep, new_position, new_velocity,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    if k < new_position.size // SIZE:
        p, b = load_quad(position, k), load_quad(before, k)
        _, number = clock(counter, place, substeps, substep)
        world = World(record[0], bodies, integers)
        x, y, z, vx, vy, vz = after_colliders(
            b, load_quad(predicted_velocity, k), p[0], p[1], p[2], multipliers[k], fluids, row(b[3]), world, number
        )  # fmt: skip
        store_quad(new_position, k, x, y, z, b[3])
        store_quad(new_velocity, k, vx, vy, vz, 0.0)


@routine
def limit(position, velocity, constraints, record, fluids):
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v, c = load_quad(position, k), load_quad(velocity, k), 0.0
        if FEATURE.drag:
            c = constraints[k]
        vx, vy, vz = limited(v[0], v[1], v[2], c, fluids, row(p[3]), record[0])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_begin(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> Kernel:
    """Compile begin(position, velocity, particle, limit, record, fluids, bodies, integers, counter, place, substeps,
    substep, predicted, before, predicted_velocity, boxes, counts).

    It predicts positions, out of the colliders, and writes the box of each block's particles; in blocks of
    sort_kernels.THREADS. `before` is written if axes are periodic. `particle`: the particles' numbers; `limit` [m]: see
    `bound`. `counts[SLOWED]`: how many particles the speed limit slowed.
    """
    variant = fluid_variant(real, math, parts, repeats)
    kernel = with_forces(filled(begin, {"store_box": device_variant(real, "exact")(store_box)}), parts)
    return kernels_of(variant, math, (kernel,), f"fluid_{variant_name(real, math, parts, repeats)}").begin


@cache
def make_settle(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `settle`, `update` and `limit`.

    `settle(before, predicted_velocity, position, record, table, neighbour_counts, multipliers, constraints, gradients,
    fluids, *world, new_position, new_velocity)`: the last correction, then velocities, limited unless smoothing
    follows; `update(before, predicted_velocity, position, record, multipliers, fluids, *world, new_position,
    new_velocity)`: velocities only; `limit(position, velocity, constraints, record, fluids)`.
    """
    kernels = map(fluid_variant(real, math, parts, repeats).copied, (settle, update, limit))
    return make_kernels(kernels, f"fluid_{variant_name(real, math, parts, repeats)}", **walk_options(real, math))
