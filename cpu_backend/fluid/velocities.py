"""The last phases of a fluid's substep on CPU threads: velocities (model/fluid/plan.py, 6 to 9)."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_row
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.fluid.cells import AXES, make_row_of
from softlab.cpu_backend.fluid.impact import make_impact
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.rows import make_scratch
from softlab.cpu_backend.fluid.smoothing import make_smoothing
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_CHANGE, F_DRAG, F_SPEED, F_SURFACE_DRAG, F_WEIGHT, MAX_NEIGHBOURS
from softlab.model.fluid.plan import SMOOTHING
from softlab.model.formulas.fluid import motion
from softlab.model.tables.cloth import COLLIDER_KINDS


def make_velocities(compiler: Compiler, real: Real, parts: frozenset[str], sides_of: Callable) -> SimpleNamespace:
    """Make `update`, `shape`, `finish`, phases (part, parts, ..., place, world, ...); `place` are the positions."""
    compiled, m = compiler.compiled, compiler.formulas(motion, real)
    speed_of, slowed, braked, around = m.speed_of, m.slowed, m.braked, make_smoothing(compiler, real, parts)
    shape_of, smooth_of = around.shapes, around.smooth
    most, has_drag = MAX_NEIGHBOURS[2 if "flat" in parts else 3], "drag" in parts
    smooths, several = bool(parts & SMOOTHING), "fluids" in parts
    row_of = compiled(make_row_of(parts))

    @compiled
    def shape(part, shared, place, world, parameters):
        """Write normals and vorticity into the unsorted planes of positions."""
        count, capacity, unsorted = world.sizes.particles, world.sizes.room, world.unsorted
        in_order, neighbours = world.in_order, world.lists.neighbours
        sides, predicted_velocity = sides_of(parameters), in_order.velocity
        for i in range(count * part // shared, count * (part + 1) // shared):
            entry_row = row_at(world.lists.entries, np.int64(i // LANES) * (LANES * most) + i % LANES)
            shape_of(
                i, neighbours[i], entry_row, capacity, place, predicted_velocity, unsorted.before, unsorted.position,
                sides, parameters, in_order.fluid,
            )  # fmt: skip

    @compiled
    def finish(part, shared, place, world, parameters, fluids):
        """Write the new state: velocities after neighbours, drag and the speed limit."""
        count, capacity, unsorted = world.sizes.particles, world.sizes.room, world.unsorted
        in_order, neighbours = world.in_order, world.lists.neighbours
        position, velocity, number, fluid = world.state
        sides, predicted_velocity, error = sides_of(parameters), in_order.velocity, world.work.error
        for i in range(count * part // shared, count * (part + 1) // shared):
            row = row_of(in_order.fluid, i)
            if smooths:
                entry_row = row_at(world.lists.entries, np.int64(i // LANES) * (LANES * most) + i % LANES)
                u, v, w = smooth_of(
                    i, neighbours[i], entry_row, capacity, place, predicted_velocity, unsorted.before,
                    unsorted.position, sides, parameters, in_order.fluid, fluids,
                )  # fmt: skip
            else:
                u, v, w = predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i]
            if has_drag:
                h, drag, surface = parameters.dt, fluids[row + F_DRAG], fluids[row + F_SURFACE_DRAG]
                u, v = braked(u, h, drag, surface, error[i]), braked(v, h, drag, surface, error[i])
                w = braked(w, h, drag, surface, error[i])
            speed, fastest = speed_of(u, v, w), fluids[row + F_SPEED]
            velocity[i], velocity[capacity + i] = slowed(u, speed, fastest), slowed(v, speed, fastest)
            velocity[2 * capacity + i] = slowed(w, speed, fastest)
            for axis in range(AXES):
                position[axis * capacity + i] = place[axis * capacity + i]
            number[i] = in_order.number[i]
            if several:
                fluid[i] = in_order.fluid[i]

    return SimpleNamespace(update=_make_update(compiler, real, parts), shape=shape, finish=finish)


def _make_update(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    compiled, m = compiler.compiled, compiler.formulas(motion, real)
    velocity_of, limited_change, speed_of = m.velocity_of, m.limited_change, m.speed_of
    collide, scratch_of = make_collide_row(compiler, real, parts), make_scratch(compiler)
    sums_of, vector_at, row_of = scratch_of.sums_of, scratch_of.vector_at, compiled(make_row_of(parts))
    has_bodies, is_limited, blocks = bool(parts & set(COLLIDER_KINDS)), "held-back" in parts, LANES // block_of(real)
    at_walls = _make_at_walls(compiler, real, parts)

    @compiler.row
    def velocities(
        rate, fluid, fluids, px, py, pz, bx, by, bz, predicted_u, predicted_v, predicted_w, x, y, z, u, v, w
    ):
        for lane in range(LANES):
            x[lane], y[lane], z[lane] = px[lane], py[lane], pz[lane]
            a, b = velocity_of(px[lane], bx[lane], rate), velocity_of(py[lane], by[lane], rate)
            c = velocity_of(pz[lane], bz[lane], rate)
            if is_limited:
                ma, mb, mc = predicted_u[lane], predicted_v[lane], predicted_w[lane]
                far, most_change = speed_of(a - ma, b - mb, c - mc), fluids[row_of(fluid, lane) + F_CHANGE]
                a, b = limited_change(a, ma, far, most_change), limited_change(b, mb, far, most_change)
                c = limited_change(c, mc, far, most_change)
            u[lane], v[lane], w[lane] = a, b, c

    @compiled
    def update(part, shared, number, place, world, parameters, fluids, bodies, kinds):
        """Derive velocities from positions and colliders, and write them into `predicted_velocity`, which no other
        phase reads."""
        count, capacity, in_order = world.sizes.particles, world.sizes.room, world.in_order
        before, predicted_velocity, fluid, slices = (
            in_order.before,
            in_order.velocity,
            in_order.fluid,
            (count + LANES - 1) // LANES,
        )
        sums = sums_of(part, world.scratch.sums)
        x, y, z, u, v, w = sums
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            velocities(
                parameters.inverse_dt, row_at(fluid, base), fluids, *vector_at(place, capacity, base),
                *vector_at(before, capacity, base), *vector_at(predicted_velocity, capacity, base), *sums,
            )  # fmt: skip
            if has_bodies:
                at_walls(base, number, world, parameters, fluids, bodies, kinds, *sums)
                collide(bodies, kinds, number, parameters, blocks, before, base, capacity, x, np.int64(0), LANES)
            for lane in range(LANES):
                i = base + lane
                place[i], place[capacity + i], place[2 * capacity + i] = x[lane], y[lane], z[lane]
                predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i] = (
                    u[lane],
                    v[lane],
                    w[lane],
                )

    return update


def _make_at_walls(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make at_walls(base, number, world, parameters, fluids, bodies, kinds, x, y, z, u, v, w).

    It updates the velocities (u, v, w) of a slice at (x, y, z) for impacts on colliders, without the rebound from
    walls.
    """
    compiled, impacts = compiler.compiled, make_impact(compiler, real, parts)
    impact_of, settled, row_of = impacts.impact, impacts.settled, compiled(make_row_of(parts))

    @compiled
    def at_walls(base, number, world, parameters, fluids, bodies, kinds, x, y, z, u, v, w):
        capacity, in_order = world.sizes.room, world.in_order
        before, predicted_velocity = in_order.before, in_order.velocity
        for lane in range(min(LANES, world.sizes.particles - base)):
            i, row = base + lane, row_of(in_order.fluid, base + lane)
            qx, qy, qz, mx, my, mz, vx, vy, vz = impact_of(
                bodies, kinds, number, parameters, before[i], before[capacity + i], before[2 * capacity + i],
                predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i], x[lane],
                y[lane], z[lane], u[lane], v[lane], w[lane], fluids[row + F_CHANGE],
            )  # fmt: skip
            u[lane], v[lane], w[lane] = settled(
                bodies, kinds, number, parameters, qx, qy, qz, vx, vy, vz, mx, my, mz, world.work.multiplier[i],
                fluids[row + F_WEIGHT],
            )  # fmt: skip

    return at_walls
