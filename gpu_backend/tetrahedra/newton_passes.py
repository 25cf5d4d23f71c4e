"""The passes of implicit Euler on tetrahedra, on CUDA: over units of tetrahedra, groups of particles, the coarse
level."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.forces import make_forces
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import AXES, load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_coarse import make_band, make_coarse, make_couple
from softlab.gpu_backend.tetrahedra.newton_contact import make_contact
from softlab.gpu_backend.tetrahedra.newton_elements import make_block_access, make_blocks, make_energies
from softlab.gpu_backend.tetrahedra.newton_pins import make_driven
from softlab.gpu_backend.tetrahedra.newton_quick import make_invert, make_quick_groups, make_quick_product
from softlab.gpu_backend.tetrahedra.newton_rows import make_moving, make_rows, make_solving
from softlab.gpu_backend.tetrahedra.newton_sums import TEAM, UNIT, make_sums
from softlab.model.base.types import Real
from softlab.model.formulas import distance
from softlab.model.formulas.elastic import stages
from softlab.model.formulas.elastic.newton import (
    BEGIN,
    CENTRES,
    COARSE,
    CORRECT,
    DIRECTION,
    ENERGIES,
    FINISH,
    KINDS,
    MOVE,
    PRODUCT,
    RESTRICT,
    ROWS,
    UPDATE,
    WEIGH,
)
from softlab.model.position_based.mesh_plan import BODY_DAMPING
from softlab.model.tetrahedra.newton import DAMPED, STAGED, SUMMED

FACTOR, INVERT, BACK = range(len(KINDS), len(KINDS) + 3)  # passes after `coarse rows` and `restrict`, before the next


@cache
def make_substep_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `begin(k, solver, world, time)`, the inertial or driven position of particle k, and `finish(k, solver, world,
    number)`, its velocity and collisions."""
    forces, motion = make_forces(real, math, parts), make_motion(real, math, parts, AXES)
    add_gravity, add_particle_force, predict = forces.add_gravity, forces.add_particle_force, motion.predict
    rate_of, collide = motion.rate_of, motion.collide
    contact, zero = make_contact(real, math, parts), real(0)
    has_bodies, pressed, inline = contact.has_bodies, contact.pressed, inlined(math)
    pins, slowed, is_slowed = (
        make_driven(real, math, parts), device_formulas(distance, real, math).slowed, BODY_DAMPING in parts
    )  # fmt: skip
    moves, driven = pins.moves, pins.driven
    ahead, staged, two = device_formulas(stages, real, math).ahead, STAGED in parts, np.int64(2)
    damped = DAMPED in parts

    @inline
    def begin_stage(k, p, w, v, h, number):
        """Start a stage, as on the CPU (cpu_backend/tetrahedra/newton_steps.py)."""
        if damped:
            store_quad(v.origin if number % two == 0 else v.middle, k, p[0], p[1], p[2], zero)
        if number % two == 0:
            store_quad(v.start, k, w[0], w[1], w[2], zero)
        elif p[3] != zero:
            s = load_quad(v.start, k)
            (x, vx), (y, vy), (z, vz) = (
                ahead(p[0], w[0], s[0], h),
                ahead(p[1], w[1], s[1], h),
                ahead(p[2], w[2], s[2], h),
            )
            p, w = (x, y, z, p[3]), (vx, vy, vz, w[3])
            store_quad(v.position, k, x, y, z, p[3])
        return p, w

    @inline
    def begin(k, solver, world, time):
        v = solver.vectors
        p, w = load_quad(v.position, k), load_quad(v.velocity, k)
        if staged:
            p, w = begin_stage(k, p, w, v, world.parameters.dt, time[1])
        ax, ay, az = add_gravity(zero, zero, zero, world.parameters)
        ax, ay, az = add_particle_force(ax, ay, az, k, p[3], world.parameters, world.integers, time[0])
        if is_slowed:
            h = world.parameters.dt
            w = slowed(w[0], w[3], h), slowed(w[1], w[3], h), slowed(w[2], w[3], h), w[3]
        x, y, z = predict(p, w, ax, ay, az, world.parameters)
        store_quad(v.before, k, p[0], p[1], p[2], p[3])
        if moves:
            if p[3] == zero:
                x, y, z, _, _, _ = driven(k, p, solver.pins, world, time[1])
                store_quad(v.position, k, x, y, z, p[3])
        store_quad(v.target, k, x, y, z, p[3])

    @inline
    def finish(k, solver, world, number):
        v = solver.vectors
        b, p, rate = load_quad(v.before, k), load_quad(v.position, k), zero
        x, y, z = p[0], p[1], p[2]
        vx, vy, vz = zero, zero, zero
        if moves:
            if b[3] == zero:
                x, y, z, vx, vy, vz = driven(k, p, solver.pins, world, number)
        if b[3] != zero:
            vx, vy, vz = rate_of(p, b, world.parameters)
            if has_bodies:
                vx, vy, vz = pressed(b, p, (vx, vy, vz), solver.matrix.stiffness[k], world, number)
                x, y, z, vx, vy, vz = collide(b, p, vx, vy, vz, world, number)
        store_quad(v.position, k, x, y, z, b[3])
        if is_slowed:
            rate = load_quad(v.velocity, k)[3]
        store_quad(v.velocity, k, vx, vy, vz, rate)

    return SimpleNamespace(begin=begin, finish=finish)


@cache
def make_assembly(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make assemble(group, particles, solver): for a block, it assembles the rows of SUMMED particles from the
    blocks of their tetrahedra."""
    gather, inline = make_rows(real, math, parts).gather, inlined(math)
    store_block, summed = make_block_access(math).store_block, np.int32(SUMMED)

    @inline
    def assemble(group, particles, solver):
        rows, matrix = solver.rows, solver.matrix
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        first = np.int32(group * summed)
        last = np.int32(min(np.int32(first + summed), particles))
        for n in range(rows.starts[first] + t, rows.starts[last], threads):
            store_block(matrix.blocks, n, gather(n, rows, matrix.element_blocks))
        cuda.syncthreads()

    return assemble


@cache
def make_unit_passes(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `of_elements(kind, unit, count, ...)`, for a block, the passes over UNIT tetrahedra, and `of_particles(kind,
    group, ...)`, those over SUMMED particles; both write sums of groups to `sums`."""
    inline, energies, blocks = inlined(math), make_energies(real, math, parts), make_blocks(real, math, parts)
    rows, assemble = make_rows(real, math, parts), make_assembly(real, math, parts)
    settle_row = rows.settle_row
    solve, moving = make_solving(real, math, rows.apply), make_moving(real, math, parts)
    weigh, move = moving.weigh, moving.move
    ends, add_groups = make_substep_ends(real, math, parts), make_sums(real, math).add_groups
    begin, finish, corrected = ends.begin, ends.finish, make_coarse(real, math).corrected
    zero, summed, unit_size, both = real(0), np.int32(SUMMED), np.int32(UNIT), np.int32(2)
    ordered, next_one = math == "exact", np.int32(1)

    @inline
    def of_elements(kind, unit, count, solver, world, number, safe, shared, sums):
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        rate = world.parameters.newton_rate
        for one in range(t, unit_size, threads):
            n = np.int32(unit * unit_size + one)
            energy, unsure = zero, zero
            if n < count:
                if kind == ENERGIES:
                    energy, unsure = energies(n, count, solver, rate, number)
                else:
                    blocks(n, count, solver, rate, number, safe != 0)
            shared[one], shared[unit_size + one] = energy, unsure
        if kind == ENERGIES:
            groups = np.int32((count + summed - 1) // summed)
            width = np.int32(min(unit_size, np.int32(count - unit * unit_size)))
            add_groups(shared, both, width, np.int32(unit * unit_size // summed), groups, sums)

    @inline
    def of_particles(kind, group, particles, solver, world, time, values, shared, sums):
        t, threads, number = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x), time[1]
        v = solver.vectors
        if kind == ROWS:
            assemble(group, particles, solver)
        for one in range(t, summed, threads):
            k, total = np.int32(group * summed + one), zero
            if k < particles:
                if kind == BEGIN:
                    begin(k, solver, world, time)
                elif kind == FINISH:
                    finish(k, solver, world, number)
                elif kind == ROWS:
                    total = settle_row(k, particles, solver, world, number)
                elif load_quad(v.before, k)[3] != zero:
                    if kind == WEIGH:
                        total = weigh(k, solver, world, number)
                    elif ordered and kind in (PRODUCT, UPDATE, CORRECT, DIRECTION):
                        more = zero, zero, zero
                        if kind == CORRECT:
                            more = corrected(k, solver)
                        total = solve(kind, k, particles, solver, more, values.alpha, values.beta)
                    else:
                        total = move(kind, k, v, values.share)
            shared[one] = total
        if kind in (WEIGH, ROWS, PRODUCT, CORRECT, MOVE):
            groups = np.int32((particles + summed - 1) // summed)
            add_groups(shared, next_one, summed, group, groups, sums)

    return SimpleNamespace(of_elements=of_elements, of_particles=of_particles)


@cache
def make_coarse_passes(real: Real, math: str) -> Callable:
    """Make coarse_pass(kind, solver, shared, sums): for all blocks, over groups, pairs of them, or
    bodies."""
    level, band, inline = make_coarse(real, math), make_band(real, math), inlined(math)
    centre, restrict, factor, solve = level.centre, level.restrict, band.factor, band.solve
    couple = make_couple(real, math)
    team, next_one, ordered, invert = np.int32(TEAM), np.int32(1), math == "exact", make_invert(real, math)

    @inline
    def coarse_pass(kind, solver, shared, sums):
        block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
        t, teams = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x // team)
        first_team = np.int32(block * teams + t // team)
        if kind == COARSE:
            for pair in range(block, len(solver.pairs.first), blocks):
                couple(pair, solver, shared)
        elif kind == FACTOR:
            for body in range(block, len(solver.pairs.bodies) - 1, blocks):
                bad = factor(body, solver)
                if t == 0:
                    sums[body] = bad
        elif kind == CENTRES:
            for group in range(first_team, len(solver.pairs.body_of), blocks * teams):
                centre(group, solver, shared)
        elif ordered:
            if kind == RESTRICT:
                for group in range(first_team, len(solver.pairs.body_of), blocks * teams):
                    restrict(group, solver, shared)
            else:
                for body in range(first_team, len(solver.pairs.bodies) - next_one, blocks * teams):
                    solve(body, solver, shared)
        else:
            for column in range(first_team, len(solver.groups.reach), blocks * teams):
                invert(column, solver, shared)

    return coarse_pass


@cache
def make_quick_passes(real: Real, math: str) -> Callable:
    """Make quick_pass(kind, particles, solver, flip, values, shared, sums): for all blocks, the
    passes of conjugate gradients in `fast` math.

    `solve` and `update`, which also restrict, `product` with the new direction, `correct`.
    """
    groups = make_quick_groups(real, math)
    advance, correct, product = groups.advance, groups.correct, make_quick_product(real, math)
    inline, summed = inlined(math), np.int32(SUMMED)

    @inline
    def quick_pass(kind, particles, solver, flip, values, shared, sums):
        block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
        if kind == PRODUCT:
            for group in range(block, (particles + summed - 1) // summed, blocks):
                product(group, particles, solver, flip, values.beta, shared, sums)
        elif kind == CORRECT:
            for group in range(block, len(solver.pairs.body_of), blocks):
                correct(group, particles, solver, shared, sums)
        else:
            for group in range(block, len(solver.pairs.body_of), blocks):
                advance(kind, group, particles, solver, flip, values.alpha, shared)

    return quick_pass
