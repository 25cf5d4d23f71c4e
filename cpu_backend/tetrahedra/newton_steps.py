"""Implicit Euler of tetrahedra on CPU threads: passes over tetrahedra or particles, by bands of groups.

The next pass is chosen from sums by groups, then over the groups in their order (model/formulas/elastic/newton.py): in
`exact` math the bits do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.pins import make_drive
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.position_based.mesh_kernels import make_begin, make_end
from softlab.cpu_backend.tetrahedra.newton_arrays import Since
from softlab.cpu_backend.tetrahedra.newton_coarse import make_band, make_coarse
from softlab.cpu_backend.tetrahedra.newton_contact import make_contact
from softlab.cpu_backend.tetrahedra.newton_elements import make_elements
from softlab.cpu_backend.tetrahedra.newton_matrix import make_matrix_rows
from softlab.cpu_backend.tetrahedra.newton_rows import make_moving, make_solving
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import newton as passes
from softlab.model.formulas.elastic import stages
from softlab.model.tetrahedra.newton import DAMPED, STAGED, SUMMED

SUMS = 2


def control_type(real: Real) -> np.dtype:
    """Return the structured type of what passes leave for the next: its kind, solves done, Counts and Values of
    formulas/elastic/newton.py."""
    integers = [(name, np.int64) for name in ("next", "solved", *passes.Counts._fields)]
    numbers = [(name, real) for name in passes.Values._fields]
    return np.dtype((np.record, np.dtype([*integers, *numbers], align=True)))


def make_substep_ends(
    compiler: Compiler, real: Real, parts: frozenset[str], put: Callable, contact: SimpleNamespace
) -> SimpleNamespace:
    """Make `begin_groups`, the inertial or driven positions, and `finish_groups`, velocities and colliders; for groups
    and the pins among them."""
    begin, ends = make_begin(compiler, real, parts), make_end(compiler, real, parts)
    update_velocity, collide = ends.update, ends.collide
    has_bodies, pressed = contact.has_bodies, contact.pressed
    drive, has_motion = make_drive(compiler, real), "motion" in parts
    ahead, staged, damped = compiler.formulas(stages, real).ahead, STAGED in parts, DAMPED in parts

    @compiler.compiled
    def begin_stage(low, high, number, state, inputs, vectors):
        """Start a stage of a substep. The first one saves its velocities, and for dampers its positions, at its start
        and end; the second one starts from an extrapolation of the first one's end."""
        position, velocity, before = state
        start, h = vectors.first_velocity, inputs.parameters.dt
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
    def drive_between(low, high, number, state, inputs):
        """Move the pins among the particles `low` to before `high`."""
        position, velocity, _ = state
        parameters, bodies, driven = inputs.parameters, inputs.bodies, inputs.driven
        for n in range(driven.size):
            if low <= driven[n] and driven[n] < high:
                drive(n, n + 1, number, position, velocity, parameters, bodies, driven)

    @compiler.compiled
    def begin_groups(first, last, frame, number, state, inputs, vectors):
        position, velocity, before = state
        low, high = first * SUMMED, min(last * SUMMED, len(position))
        if staged:
            begin_stage(low, high, number, state, inputs, vectors)
        for k in range(low, high):
            for axis in range(position.shape[1]):
                before[k, axis] = position[k, axis]
        begin(
            low, high, frame, number, before, velocity, position, inputs.parameters, inputs.integers, inputs.wind_lists
        )
        if has_motion:
            drive_between(low, high, number, state, inputs)
        target = vectors.target
        for k in range(low, high):
            for axis in range(3):
                target[k, axis] = position[k, axis]
        put(first, last, position, before, before)

    @compiler.compiled
    def finish_groups(first, last, number, state, inputs, matrix):
        position, velocity, before = state
        parameters, bodies, kinds = inputs.parameters, inputs.bodies, inputs.kinds
        low, high = first * SUMMED, min(last * SUMMED, len(position))
        update_velocity(low, high, before, position, velocity, parameters)
        if has_motion:
            drive_between(low, high, number, state, inputs)
        if has_bodies:
            pressed(low, high, number, position, velocity, before, matrix.stiffness, (parameters, bodies, kinds))
            collide(low, high, number, before, position, velocity, parameters, bodies, kinds)

    return SimpleNamespace(begin_groups=begin_groups, finish_groups=finish_groups)


def make_pass(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make one_pass(control, band, bands, frame, number, state, inputs, solver): a pass on a band.

    `control`: the record of control_type; `state`: (position, velocity, before); `inputs`: Inputs; `solver`: Solver of
    newton_arrays.py.
    """
    contact = make_contact(compiler, real, parts)
    elements, of_rows = make_elements(compiler, real, parts), make_matrix_rows(compiler, real, parts, contact)
    level = make_coarse(compiler, real)
    solving = make_solving(compiler, real, of_rows.apply, level.corrected)
    moving = make_moving(compiler, real, parts, solving.dot, contact)
    energies, blocks, assemble = elements.energies, elements.blocks, of_rows.assemble
    start, product, update, direct = solving.start, solving.product, solving.update, solving.direct
    correct, centre, gather, restrict = solving.correct, level.centre, level.gather, level.restrict
    weigh, move, accept, put = moving.weigh, moving.move, moving.accept, moving.put
    ends = make_substep_ends(compiler, real, parts, put, contact)
    begin_groups, finish_groups = ends.begin_groups, ends.finish_groups
    two_stages = DAMPED in parts and STAGED in parts

    @compiler.compiled
    def matrix_pass(control, first, last, number, state, inputs, solver):
        rows, vectors, matrix, sums = solver.rows, solver.vectors, solver.matrix, solver.sums
        groups, coarse, kind = solver.groups, solver.coarse, control.next
        position, _, before = state
        if kind == passes.ROWS:
            assemble(first, last, number, position, vectors.target, before, rows, matrix, inputs, sums)
        elif kind == passes.SOLVE:
            start(first, last, before, vectors)
        elif kind == passes.PRODUCT:
            product(first, last, before, rows, vectors, matrix, sums)
        elif kind == passes.UPDATE:
            update(first, last, control.alpha, before, vectors)
        elif kind == passes.CORRECT:
            correct(first, last, position, before, vectors, matrix, groups, coarse, sums)
        elif kind == passes.CENTRES:
            centre(first, last, position, groups, coarse)
        elif kind == passes.COARSE:
            gather(first, last, position, rows, matrix.blocks, groups, coarse)
        elif kind == passes.RESTRICT:
            restrict(first, last, position, vectors.residual, groups, coarse)
        else:
            direct(first, last, control.beta, vectors)

    @compiler.compiled
    def items_of(kind, tetrahedra, particles, groups):
        """Return the number of items that bands divide: groups, or SUMMED tetrahedra or particles each."""
        if kind in (passes.CENTRES, passes.COARSE, passes.RESTRICT):
            return np.int64(groups)
        of_elements = kind in (passes.ENERGIES, passes.BLOCKS)
        return ((tetrahedra if of_elements else particles) + SUMMED - 1) // SUMMED

    @compiler.compiled
    def since_of(number, before, inputs, vectors):
        rate = inputs.parameters.newton_rate
        if two_stages:
            return Since(rate, before, vectors.first_start, vectors.first_end, number % 2 == 1)
        return Since(rate, before, before, before, False)

    @compiler.compiled
    def one_pass(control, band, bands, frame, number, state, inputs, solver):
        position, _, before = state
        elements, vectors, matrix, sums = solver.elements, solver.vectors, solver.matrix, solver.sums
        kind = control.next
        many = items_of(kind, len(elements.corners), len(position), len(solver.groups.starts) - 1)
        first, last = many * band // bands, many * (band + 1) // bands
        if kind == passes.BEGIN:
            begin_groups(first, last, frame, number, state, inputs, vectors)
        elif kind == passes.ENERGIES:
            energies(first, last, position, since_of(number, before, inputs, vectors), elements, matrix.forces, sums)
        elif kind == passes.BLOCKS:
            since = since_of(number, before, inputs, vectors)
            blocks(first, last, position, since, elements, control.safe != 0, matrix.element_blocks)
        elif kind == passes.WEIGH:
            weigh(first, last, number, position, before, inputs, solver)
        elif kind == passes.MOVE:
            move(first, last, control.share, position, before, vectors, sums)
        elif kind == passes.ACCEPT:
            accept(first, last, position, vectors)
        elif kind == passes.RETURN:
            put(first, last, position, before, vectors.current)
        elif kind == passes.AHEAD:
            put(first, last, position, before, vectors.target)
        elif kind == passes.FINISH:
            finish_groups(first, last, number, state, inputs, matrix)
        else:
            matrix_pass(control, first, last, number, state, inputs, solver)

    return one_pass


@cache
def make_newton_advance(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, floor, state, inputs, solver, control, done): many steps in one call.

    `steps`: a Steps, whose substeps are solves, and iterations those of a solve; `control` (1,): control_type; `done`
    (DONE,) is incremented.
    """
    compiler = Compiler(cloth_variant("newton", real, math, parts), math)
    one_pass = make_pass(compiler, real, parts)
    after, zero = compiler.formulas(passes, real).after, real(0)

    @compiler.compiled
    def total(sums, place, groups):
        result = zero
        for group in range(groups):
            result = result + sums[place, group]
        return result

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
    def go_on(c, iterations, floor, particles, solver, done):
        """Choose the next pass from the sums of the last one. `c`: the record of control_type."""
        kind, sums = c.next, solver.sums
        groups = ((len(solver.elements.corners) if kind == passes.ENERGIES else particles) + SUMMED - 1) // SUMMED
        first = alone(kind, solver, total(sums, 0, groups))
        second = total(sums, 1, groups) if kind == passes.ENERGIES else zero
        counts = passes.Counts(c.phase, c.safe, c.products, c.steps, c.halvings)
        values = passes.Values(
            c.energy, c.trial, c.noise, c.squared, c.enough, c.alpha, c.beta, c.share, c.slope, c.unsure
        )
        later, counts, values = after(kind, counts, values, first, second, iterations, floor)
        c.phase, c.safe, c.products, c.steps, c.halvings = counts
        c.energy, c.trial, c.noise, c.squared, c.enough, c.alpha, c.beta, c.share, c.slope, c.unsure = values
        done[passes.EVALUATIONS] += kind == passes.ENERGIES
        done[passes.MATRICES] += kind == passes.ROWS
        done[passes.PRODUCTS] += kind == passes.PRODUCT
        if kind == passes.FINISH:
            done[passes.SOLVES] += 1
            done[passes.STEPS] += counts.steps
            c.solved += 1
        c.next = later

    def advance(team, member, bands, steps, floor, state, inputs, solver, control, done):
        (position, _, _), (count, step, solves, iterations) = state, steps
        while control[0].solved < count * solves:  # it only grows: a late member sees that all is done
            for band in assigned(team, member, bands):
                number = control[0].solved
                frame, number = step + number // solves, step * solves + number
                one_pass(control[0], band, bands, frame, number, state, inputs, solver)
            for _ in assigned(team, member, 1):
                go_on(control[0], iterations, floor, len(position), solver, done)

    return compiler.team(advance)
