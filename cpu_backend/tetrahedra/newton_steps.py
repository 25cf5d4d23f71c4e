"""Implicit Euler of tetrahedra on CPU threads: passes over tetrahedra or particles, by bands of groups.

The next pass is chosen from sums by groups, then over the groups in their order (model/formulas/elastic/newton.py): in
`exact` math the bits do not depend on the number of threads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.pins import make_drive
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import shares
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.position_based.mesh_kernels import make_begin, make_end
from softlab.cpu_backend.tetrahedra.newton_coarse import make_band, make_coarse
from softlab.cpu_backend.tetrahedra.newton_contact import make_contact
from softlab.cpu_backend.tetrahedra.newton_elements import make_elements
from softlab.cpu_backend.tetrahedra.newton_matrix import make_matrix_rows
from softlab.cpu_backend.tetrahedra.newton_rows import make_moving, make_solving
from softlab.model.formulas.elastic import newton as passes
from softlab.model.formulas.elastic import stages
from softlab.model.tetrahedra.newton import DAMPED, STAGED, SUMMED

SUMS = 2
NEXT, SOLVED, COUNTS = range(3)  # of `control`: next pass, solves done, first counter
DONE = ("solves", "looks", "matrices", "products", "steps")  # counters of a simulation
SOLVES, LOOKS, MATRICES, PRODUCTS, STEPS = range(len(DONE))
SAFE, ALPHA, BETA, SHARE = COUNTS + 1, 5, 6, 7  # of `control`, and of `values` (VALUES)


def make_substep_ends(
    compiler: Compiler, real: Any, parts: frozenset[str], put: Any, contact: SimpleNamespace
) -> SimpleNamespace:
    """Make `begin_groups`, the inertial or driven positions, and `finish_groups`, velocities and colliders; for groups
    and the pins among them."""
    begin, ends = make_begin(compiler, real, parts), make_end(compiler, real, parts)
    update_velocity, collide = ends.update, ends.collide
    has_bodies, pressed = contact.has_bodies, contact.pressed
    drive, has_motion = make_drive(compiler, real), "motion" in parts
    ahead, staged, damped = stages.make(real, compiler.compiled), STAGED in parts, DAMPED in parts

    @compiler.compiled
    def begin_stage(low, high, number, state, given, vectors):
        """Start a stage of a substep. The first one saves its velocities, and for dampers its positions, at its start
        and end; the second one starts from an extrapolation of the first one's end."""
        position, velocity, before = state
        start, h = vectors.first_velocity, given.parameters.dt
        for k in range(low, high):
            for axis in range(3):
                if damped:
                    origin = vectors.first_end if number % 2 else vectors.first_start
                    origin[k, axis] = position[k, axis]
                if number % 2 == 0:
                    start[k, axis] = velocity[k, axis]
                elif before[k, 3] != 0:
                    position[k, axis], velocity[k, axis] = ahead(
                        position[k, axis], velocity[k, axis], start[k, axis], h
                    )

    @compiler.compiled
    def drive_between(low, high, number, state, given):
        """Move the pins among the particles `low` to before `high`."""
        position, velocity, _ = state
        parameters, bodies, driven = given.parameters, given.bodies, given.driven
        for n in range(driven.size):
            if low <= driven[n] and driven[n] < high:
                drive(n, n + 1, number, position, velocity, parameters, bodies, driven)

    @compiler.compiled
    def begin_groups(first, last, frame, number, state, given, vectors):
        position, velocity, before = state
        parameters, integers, wind_lists, _, _, _ = given
        low, high = first * SUMMED, min(last * SUMMED, len(position))
        if staged:
            begin_stage(low, high, number, state, given, vectors)
        for k in range(low, high):
            for axis in range(position.shape[1]):
                before[k, axis] = position[k, axis]
        begin(low, high, frame, number, before, velocity, position, parameters, integers, wind_lists)
        if has_motion:
            drive_between(low, high, number, state, given)
        target = vectors.target
        for k in range(low, high):
            for axis in range(3):
                target[k, axis] = position[k, axis]
        put(first, last, position, before, before)

    @compiler.compiled
    def finish_groups(first, last, number, state, given, matrix):
        position, velocity, before = state
        parameters, _, _, bodies, kinds, _ = given
        low, high = first * SUMMED, min(last * SUMMED, len(position))
        update_velocity(low, high, before, position, velocity, parameters)
        if has_motion:
            drive_between(low, high, number, state, given)
        if has_bodies:
            pressed(low, high, number, position, velocity, before, matrix.stiffness, (parameters, bodies, kinds))
            collide(low, high, number, before, position, velocity, parameters, bodies, kinds)

    return SimpleNamespace(begin_groups=begin_groups, finish_groups=finish_groups)


def make_pass(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """Make one_pass(kind, band, bands, frame, number, safe, alpha, beta, share, state, given, solver): a pass on a
    band.

    `state`: (position, velocity, before); `given`: Inputs; `solver`: Solver of newton_arrays.py.
    """
    contact = make_contact(compiler, real, parts)
    elements, of_rows = make_elements(compiler, real, parts), make_matrix_rows(compiler, real, parts, contact)
    level = make_coarse(compiler, real)
    solving = make_solving(compiler, real, of_rows.apply, level.corrected)
    moving = make_moving(compiler, real, parts, solving.dot, contact)
    look, blocks, assemble = elements.look, elements.blocks, of_rows.assemble
    start, product, update, direct = solving.start, solving.product, solving.update, solving.direct
    correct, centre, gather, restrict = solving.correct, level.centre, level.gather, level.restrict
    weigh, move, accept, put = moving.weigh, moving.move, moving.accept, moving.put
    ends = make_substep_ends(compiler, real, parts, put, contact)
    begin_groups, finish_groups = ends.begin_groups, ends.finish_groups
    two_stages = DAMPED in parts and STAGED in parts

    @compiler.compiled
    def matrix_pass(kind, first, last, number, alpha, beta, state, given, solver):
        _, rows, _, vectors, matrix, sums, groups, coarse = solver
        position, _, before = state
        if kind == passes.ROWS:
            assemble(first, last, number, position, vectors.target, before, rows, matrix, given, sums)
        elif kind == passes.SOLVE:
            start(first, last, before, vectors)
        elif kind == passes.PRODUCT:
            product(first, last, before, rows, vectors, matrix, sums)
        elif kind == passes.UPDATE:
            update(first, last, alpha, before, vectors)
        elif kind == passes.CORRECT:
            correct(first, last, position, before, vectors, matrix, groups, coarse, sums)
        elif kind == passes.CENTRES:
            centre(first, last, position, groups, coarse)
        elif kind == passes.COARSE:
            gather(first, last, position, rows, matrix.blocks, groups, coarse)
        elif kind == passes.RESTRICT:
            restrict(first, last, position, vectors.residual, groups, coarse)
        else:
            direct(first, last, beta, vectors)

    @compiler.compiled
    def items_of(kind, tetrahedra, particles, groups):
        """Return the number of items that bands divide: groups, or SUMMED tetrahedra or particles each."""
        if kind in (passes.CENTRES, passes.COARSE, passes.RESTRICT):
            return np.int64(groups)
        of_elements = kind in (passes.LOOK, passes.BLOCKS)
        return ((tetrahedra if of_elements else particles) + SUMMED - 1) // SUMMED

    @compiler.compiled
    def since_of(number, before, given, vectors):
        """Return `since` of make_damper in newton_elements.py."""
        rate = given.parameters.newton_rate
        if two_stages:
            return rate, before, vectors.first_start, vectors.first_end, number % 2 == 1
        return rate, before, before, before, False

    @compiler.compiled
    def one_pass(kind, band, bands, frame, number, safe, alpha, beta, share, state, given, solver):
        position, _, before = state
        elements, vectors, matrix, sums = solver.elements, solver.vectors, solver.matrix, solver.sums
        many = items_of(kind, len(elements.corners), len(position), len(solver.groups.starts) - 1)
        first, last = many * band // bands, many * (band + 1) // bands
        if kind == passes.BEGIN:
            begin_groups(first, last, frame, number, state, given, vectors)
        elif kind == passes.LOOK:
            look(first, last, position, since_of(number, before, given, vectors), elements, matrix.forces, sums)
        elif kind == passes.BLOCKS:
            blocks(
                first,
                last,
                position,
                since_of(number, before, given, vectors),
                elements,
                safe != 0,
                matrix.element_blocks,
            )
        elif kind == passes.WEIGH:
            weigh(first, last, number, position, before, given, solver)
        elif kind == passes.MOVE:
            move(first, last, share, position, before, vectors, sums)
        elif kind == passes.ACCEPT:
            accept(first, last, position, vectors)
        elif kind == passes.RETURN:
            put(first, last, position, before, vectors.current)
        elif kind == passes.AHEAD:
            put(first, last, position, before, vectors.target)
        elif kind == passes.FINISH:
            finish_groups(first, last, number, state, given, matrix)
        else:
            matrix_pass(kind, first, last, number, alpha, beta, state, given, solver)

    return one_pass


@cache
def make_newton_advance(real: Any, math: str, parts: frozenset[str]) -> Any:
    """Compile advance(bands, steps, step, solves, iterations, floor, state, given, solver, control, values, done): many
    steps in one call.

    `control` (2 + COUNTS,): the next pass, solves done, counters; `values` (VALUES,); `done` (DONE,) is incremented.
    """
    compiler = Compiler(cloth_variant("newton", real, math, parts), math)
    one_pass = make_pass(compiler, real, parts)
    after, zero = passes.make_control(real, compiler.compiled).after, real(0)

    @compiler.compiled
    def total(sums, place, groups):
        found = zero
        for group in range(groups):
            found = found + sums[place, group]
        return found

    band = make_band(compiler, real)
    factor, solve, one = band.factor, band.solve, real(1)

    @compiler.compiled
    def alone(kind, solver, first):
        """Do the work of one thread between two passes. Returns the sum, or 1 if the coarse matrix is not positive."""
        if kind == passes.COARSE:
            return one if factor(solver.coarse, solver.groups) else zero
        if kind == passes.RESTRICT:
            solve(solver.coarse, solver.groups)
        return first

    @compiler.compiled
    def go_on(control, values, iterations, floor, particles, solver, done):
        """Choose the next pass from the sums of the last one."""
        kind, sums = control[NEXT], solver.sums
        groups = ((len(solver.elements.corners) if kind == passes.LOOK else particles) + SUMMED - 1) // SUMMED
        first = alone(kind, solver, total(sums, 0, groups))
        second = total(sums, 1, groups) if kind == passes.LOOK else zero
        counts = control[COUNTS], control[COUNTS + 1], control[COUNTS + 2], control[COUNTS + 3], control[COUNTS + 4]
        kept = (
            values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7], values[8],
            values[9],
        )  # fmt: skip
        later, counts, kept = after(kind, counts, kept, first, second, iterations, floor)
        (control[COUNTS], control[COUNTS + 1], control[COUNTS + 2], control[COUNTS + 3], control[COUNTS + 4]) = counts
        values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7], values[8], values[9] = (
            kept
        )
        done[LOOKS] += kind == passes.LOOK
        done[MATRICES] += kind == passes.ROWS
        done[PRODUCTS] += kind == passes.PRODUCT
        if kind == passes.FINISH:
            _, _, _, steps, _ = counts
            done[SOLVES] += 1
            done[STEPS] += steps
            control[SOLVED] += 1
        control[NEXT] = later

    def advance(
        team, member, bands, steps, step, solves, iterations, floor, state, given, solver, control, values, done
    ):  # fmt: skip
        position, _, _ = state
        particles = len(position)
        while control[SOLVED] < steps * solves:  # it only grows: a late member sees that all is done
            for band in shares(team, member, bands):
                number = control[SOLVED]
                one_pass(
                    control[NEXT], band, bands, step + number // solves, step * solves + number, control[SAFE], values[ALPHA],
                    values[BETA], values[SHARE], state, given, solver,
                )  # fmt: skip
            for _ in shares(team, member, 1):
                go_on(control, values, iterations, floor, particles, solver, done)

    return compiler.team(advance)
