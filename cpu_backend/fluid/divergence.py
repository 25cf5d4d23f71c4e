"""The phases of a substep of the scheme `divergence-free` on CPU threads, one band at a time
(model/fluid/divergence_plan.py).

`world` is that of cpu_backend/fluid/solver.py. This scheme uses some of its arrays differently: `meant` are the
velocities that are read of neighbours; `before`, after the sort, are the shifts; the third group of the unsorted planes
are the last iterate, the multipliers of the second solve, and the target of the solves. From `accelerate` on, the
velocities are in the state, where they also end.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_mass, make_instants
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import make_row_of
from softlab.cpu_backend.fluid.divergence_pairs import make_approaches
from softlab.cpu_backend.fluid.impact import make_impact
from softlab.cpu_backend.fluid.pairs import make_pairs
from softlab.cpu_backend.fluid.quads import LANES, QUAD, QUADS
from softlab.cpu_backend.fluid.rows import make_scratch
from softlab.cpu_backend.fluid.walls import make_wall_rows
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_CHANGE, F_SPEED, F_WEIGHT, MAX_NEIGHBOURS
from softlab.model.formulas.fluid import density, divergence, motion
from softlab.model.tables.cloth import COLLIDER_KINDS


def make_approach(compiler: Compiler, real: Real, parts: frozenset[str], sides_of: Callable) -> SimpleNamespace:
    """Make `approach(s, many, world, parameters, vector, total)` and `rest_of(i, capacity, wall, vector, total)`."""
    compiled, approaches = compiler.compiled, make_approaches(compiler, real, parts)
    of_wall = compiler.formulas(divergence, real).approach_of_wall
    most, has_walls, zero = MAX_NEIGHBOURS[2 if "flat" in parts else 3], "walls" in parts, real(0)

    @compiled
    def approach(s, many, world, parameters, vector, total):
        """Sum over the neighbours of slice s what a vector field contributes to the rate of C, into `total`."""
        capacity, lists = world.sizes.room, world.lists
        base, place = np.int64(s) * LANES, world.in_order.position
        for lane in range(LANES):
            total[lane] = zero
        approaches(
            many, base, row_at(lists.entries, base * most), place, row_at(place, capacity), row_at(place, 2 * capacity),
            vector, row_at(vector, capacity), row_at(vector, 2 * capacity), row_at(place, base),
            row_at(place, capacity + base), row_at(place, 2 * capacity + base), row_at(vector, base),
            row_at(vector, capacity + base), row_at(vector, 2 * capacity + base), sides_of(parameters),
            parameters.support, parameters.inverse_support, parameters.gradient_scale, total,
        )  # fmt: skip

    @compiled
    def rest_of(i, capacity, wall, vector, total):
        """Return the sum of particle i including the contribution of walls."""
        if has_walls:
            return of_wall(
                total,
                wall[i],
                wall[capacity + i],
                wall[2 * capacity + i],
                vector[i],
                vector[capacity + i],
                vector[2 * capacity + i],
            )
        return total

    return SimpleNamespace(approach=approach, rest_of=rest_of)


def make_solve(compiler: Compiler, real: Real, parts: frozenset[str], sides_of: Callable) -> SimpleNamespace:
    """Make `survey`, `foresee` and `relax`, phases over slices of LANES particles: (part, parts, ..., world, ...).

    `second` is true in the second solve.
    """
    compiled, f, g = compiler.compiled, compiler.formulas(density, real), compiler.formulas(divergence, real)
    constraint, along = f.constraint, make_approach(compiler, real, parts, sides_of)
    approach, rest_of = along.approach, along.rest_of
    compressed, foreseen, pressed, lead, led = g.compressed, g.foreseen, g.pressed, g.lead, g.led
    most = MAX_NEIGHBOURS[2 if "flat" in parts else 3]
    densities, scratch_of = make_pairs(compiler, real, parts).densities, make_scratch(compiler)
    sums_of, numbers_of, vector_at = scratch_of.sums_of, scratch_of.numbers_of, scratch_of.vector_at
    wall_rows, instants = make_wall_rows(compiler, real, parts), make_instants(compiler, real, parts)
    has_walls, moving = "walls" in parts, "moving" in parts
    zero = real(0)

    @compiled
    def survey(part, shared, number, world, parameters, bodies, kinds):
        """Evaluate the constraints and the target of the first solve."""
        count, capacity, unsorted = world.sizes.particles, world.sizes.room, world.unsorted
        in_order, error, wall, lists = world.in_order, world.work.error, world.work.wall, world.lists
        scratch = world.scratch.sums
        place, velocity, target = (
            in_order.position,
            in_order.velocity,
            row_at(unsorted.velocity, 2 * np.int64(capacity)),
        )
        longest, slices = lists.longest, (count + LANES - 1) // LANES
        begin, end, _ = instants(number, parameters)
        total, coming, wall_part, earlier, wx, wy = sums_of(part, scratch)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                total[lane] = zero
            densities(
                longest[s], row_at(lists.entries, base * most), row_at(place, QUADS * capacity), *numbers_of(part, scratch),
                *vector_at(place, capacity, base), sides_of(parameters), parameters.inverse_support, total,
            )  # fmt: skip
            approach(s, longest[s], world, parameters, velocity, coming)
            for lane in range(LANES):
                wall_part[lane], earlier[lane] = zero, zero
            if has_walls:
                position_rows, (_, _, wz, _) = vector_at(place, capacity, base), numbers_of(part, scratch)
                wall_rows(bodies, kinds, end, parameters, *position_rows, wall_part, *vector_at(wall, capacity, base))
                if moving:
                    wall_rows(bodies, kinds, begin, parameters, *position_rows, earlier, wx, wy, wz)
            for lane in range(min(LANES, count - base)):
                i, came = base + lane, zero
                if moving:
                    came = wall_part[lane] - earlier[lane]
                error[i] = constraint(total[lane], parameters.lattice_sum, parameters.density_scale, wall_part[lane])
                a = rest_of(i, capacity, wall, velocity, coming[lane])
                target[i] = compressed(error[i], a, parameters.dt, came)

    @compiled
    def foresee(part, shared, world, parameters):
        """Evaluate the target of the second solve."""
        count, capacity, unsorted, wall = world.sizes.particles, world.sizes.room, world.unsorted, world.work.wall
        velocity, target = world.state.velocity, row_at(unsorted.velocity, 2 * np.int64(capacity))
        (coming, _, _, _, _, _), slices = sums_of(part, world.scratch.sums), (count + LANES - 1) // LANES
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            approach(s, world.lists.longest[s], world, parameters, velocity, coming)
            for lane in range(min(LANES, count - np.int64(s) * LANES)):
                i = np.int64(s) * LANES + lane
                target[i] = foreseen(
                    world.work.error[i], rest_of(i, capacity, wall, velocity, coming[lane]), parameters.dt
                )

    @compiled
    def relax(part, shared, turn, iterations, second, world, parameters):
        """Evaluate the changes of the multipliers, and the new multipliers."""
        count, capacity, unsorted = world.sizes.particles, world.sizes.room, world.unsorted
        in_order, delta = world.in_order, world.work.delta
        shift, iterate = in_order.before, row_at(unsorted.velocity, np.int64(0))
        ahead, target = row_at(unsorted.velocity, np.int64(capacity)), row_at(unsorted.velocity, 2 * np.int64(capacity))
        if not second:
            ahead = row_at(world.work.multiplier, np.int64(0))
        (coming, _, _, _, _, _), slices = sums_of(part, world.scratch.sums), (count + LANES - 1) // LANES
        quads = row_at(in_order.position, QUADS * np.int64(capacity))
        onward = lead(turn, iterations)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            if turn > 0:
                approach(s, world.lists.longest[s], world, parameters, shift, coming)
            for lane in range(min(LANES, count - np.int64(s) * LANES)):
                i = np.int64(s) * LANES + lane
                c, before, last = target[i], zero, zero
                if turn > 0:
                    before, last = ahead[i], iterate[i]
                    c = c + rest_of(i, capacity, world.work.wall, shift, coming[lane])
                relaxed = pressed(before, world.work.factor[i], c)
                ahead[i] = led(relaxed, last, onward)
                delta[i], iterate[i] = ahead[i] - before, relaxed
                quads[QUAD * i + 3] = delta[i]

    return SimpleNamespace(survey=survey, foresee=foresee, relax=relax)


def make_push(compiler: Compiler, real: Real, parts: frozenset[str], sides_of: Callable) -> SimpleNamespace:
    """Make `push(part, parts, turn, world, parameters, fluids)`: the phase of an iteration after `relax`."""
    compiled, f, scratch_of = compiler.compiled, compiler.formulas(density, real), make_scratch(compiler)
    wall_added, moved, corrections = f.wall_added, f.moved, make_pairs(compiler, real, parts).corrections
    sums_of, numbers_of, vector_at = scratch_of.sums_of, scratch_of.numbers_of, scratch_of.vector_at
    most, has_walls = MAX_NEIGHBOURS[2 if "flat" in parts else 3], "walls" in parts
    row_of, zero = compiled(make_row_of(parts)), real(0)

    @compiled
    def push(part, shared, turn, world, parameters, fluids):
        """Add the effect of the changed multipliers to the shifts."""
        count, capacity, in_order, delta = world.sizes.particles, world.sizes.room, world.in_order, world.work.delta
        wall, lists, scratch = world.work.wall, world.lists, world.scratch.sums
        shift, place, fluid = in_order.before, in_order.position, in_order.fluid
        (ax, ay, az, _, _, _), slices = sums_of(part, scratch), (count + LANES - 1) // LANES
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                ax[lane], ay[lane], az[lane] = zero, zero, zero
            corrections(
                lists.longest[s], base, row_at(lists.entries, base * most), row_at(place, QUADS * capacity),
                *numbers_of(part, scratch), *vector_at(place, capacity, base), row_at(delta, base), sides_of(parameters),
                parameters.support, parameters.inverse_support, parameters.gradient_scale, parameters.tensile,
                parameters.inverse_tensile, ax, ay, az,
            )  # fmt: skip
            for lane in range(min(LANES, count - base)):
                i = base + lane
                x, y, z, weight = ax[lane], ay[lane], az[lane], fluids[row_of(fluid, i) + F_WEIGHT]
                if has_walls:
                    x, y = wall_added(x, delta[i], wall[i]), wall_added(y, delta[i], wall[capacity + i])
                    z = wall_added(z, delta[i], wall[2 * capacity + i])
                ex, ey, ez = zero, zero, zero
                if turn > 0:
                    ex, ey, ez = shift[i], shift[capacity + i], shift[2 * capacity + i]
                shift[i], shift[capacity + i] = moved(ex, weight, x), moved(ey, weight, y)
                shift[2 * capacity + i] = moved(ez, weight, z)

    return SimpleNamespace(push=push)


def make_take_up(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `take_up` and `move`, the phases after a solve, one particle at a time."""
    compiled, m = compiler.compiled, compiler.formulas(motion, real)
    gained = compiler.formulas(divergence, real).gained
    speed_of, limited_change, slowed, drifted = m.speed_of, m.limited_change, m.slowed, m.drifted
    touch, row_of = make_collide_mass(compiler, real, parts), compiled(make_row_of(parts))
    settled = make_impact(compiler, real, parts).settled
    is_limited, has_bodies, several = "held-back" in parts, bool(parts & set(COLLIDER_KINDS)), "fluids" in parts

    @compiled
    def corrected_velocity(i, capacity, velocity, shift, parameters, most):
        """Return the velocity of particle i after a solve."""
        rate, u, v, w = parameters.inverse_dt, velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
        a, b, c = (
            gained(u, shift[i], rate),
            gained(v, shift[capacity + i], rate),
            gained(w, shift[2 * capacity + i], rate),
        )
        if is_limited:
            far = speed_of(a - u, b - v, c - w)
            return limited_change(a, u, far, most), limited_change(b, v, far, most), limited_change(c, w, far, most)
        return a, b, c

    @compiled
    def take_up(part, shared, world, parameters, fluids):
        """Update the velocities after the first solve."""
        count, capacity, in_order = world.sizes.particles, world.sizes.room, world.in_order
        shift, velocity, fluid = in_order.before, in_order.velocity, in_order.fluid
        for i in range(count * part // shared, count * (part + 1) // shared):
            u, v, w = corrected_velocity(i, capacity, velocity, shift, parameters, fluids[row_of(fluid, i) + F_CHANGE])
            velocity[i], velocity[capacity + i], velocity[2 * capacity + i] = u, v, w

    @compiled
    def move(part, shared, number, world, parameters, fluids, bodies, kinds):
        """Write the new state and the sum of the multipliers of both solves."""
        count, capacity, in_order = world.sizes.particles, world.sizes.room, world.in_order
        position, velocity, numbers, fluid = world.state
        shift, place, multiplier = in_order.before, in_order.position, world.work.multiplier
        second = row_at(world.unsorted.velocity, np.int64(capacity))
        for i in range(count * part // shared, count * (part + 1) // shared):
            row = row_of(in_order.fluid, i)
            mx, my, mz = velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
            u, v, w = corrected_velocity(i, capacity, velocity, shift, parameters, fluids[row + F_CHANGE])
            speed, fastest, h = speed_of(u, v, w), fluids[row + F_SPEED], parameters.dt
            u, v, w = slowed(u, speed, fastest), slowed(v, speed, fastest), slowed(w, speed, fastest)
            bx, by, bz = place[i], place[capacity + i], place[2 * capacity + i]
            x, y, z = drifted(bx, u, h), drifted(by, v, h), drifted(bz, w, h)
            if has_bodies:
                u, v, w = settled(
                    bodies, kinds, number, parameters, bx, by, bz, u, v, w, mx, my, mz, second[i], fluids[row + F_WEIGHT]
                )  # fmt: skip
                (x, y, z), (u, v, w) = touch(bodies, kinds, number, parameters, (bx, by, bz), (x, y, z), (u, v, w))
                speed = speed_of(u, v, w)
                u, v, w = slowed(u, speed, fastest), slowed(v, speed, fastest), slowed(w, speed, fastest)
            position[i], position[capacity + i], position[2 * capacity + i] = x, y, z
            velocity[i], velocity[capacity + i], velocity[2 * capacity + i] = u, v, w
            multiplier[i] = multiplier[i] + second[i]
            numbers[i] = in_order.number[i]
            if several:
                fluid[i] = in_order.fluid[i]

    return SimpleNamespace(take_up=take_up, move=move)
