"""Implicit Euler of tetrahedra on CPU threads: passes over tetrahedra or particles, by bands of groups.

The next pass is chosen from sums by groups, then over the groups in their order (model/formulas/elastic/newton.py): in
`exact` math the bits do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass
from softlab.cpu_backend.contact.pins import drive
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.position_based.mesh_kernels import begin, collide_masses, mesh_features, update_masses
from softlab.cpu_backend.tetrahedra.newton_arrays import Since
from softlab.cpu_backend.tetrahedra.newton_coarse import centre, factor, gather, restrict, solve
from softlab.cpu_backend.tetrahedra.newton_contact import pressed
from softlab.cpu_backend.tetrahedra.newton_elements import blocks, energies
from softlab.cpu_backend.tetrahedra.newton_matrix import assemble
from softlab.cpu_backend.tetrahedra.newton_rows import accept, correct, direct, move, product, put, weigh
from softlab.cpu_backend.tetrahedra.newton_rows import start as start_solve
from softlab.cpu_backend.tetrahedra.newton_rows import update as update_solution
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, routine
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.elastic.newton import DONE, PASS, Counts, Values, after
from softlab.model.formulas.elastic.stages import ahead
from softlab.model.tetrahedra.newton import SUMMED
from softlab.model.tetrahedra.springs import kernel_features

SUMS = 2


def control_type(real: Real) -> np.dtype:
    """Return the structured type of the values that passes leave for the next: its kind, solves done, Counts and Values
    of formulas/elastic/newton.py."""
    integers = [(name, np.int64) for name in ("next", "solved", *Counts._fields)]
    numbers = [(name, real) for name in Values._fields]
    return np.dtype((np.record, np.dtype([*integers, *numbers], align=True)))


@routine
def begin_stage(low, high, number, state, inputs, vectors):
    """Start a stage of a substep. The first one saves its velocities, and for dampers its positions, at its start
    and end; the second one starts from an extrapolation of the first one's end."""
    position, velocity, before = state
    start, h = vectors.first_velocity, inputs.parameters.dt
    for k in range(low, high):
        for axis in range(3):
            if FEATURE.damped:
                origin = vectors.first_end if number % 2 else vectors.first_start
                origin[k, axis] = position[k, axis]
            if number % 2 == 0:
                start[k, axis] = velocity[k, axis]
            elif before[k, 3] != 0:
                position[k, axis], velocity[k, axis] = ahead(position[k, axis], velocity[k, axis], start[k, axis], h)


@routine
def drive_between(low, high, number, state, inputs):
    """Move the pins among the particles `low` to before `high`."""
    position, velocity, _ = state
    parameters, bodies, driven = inputs.parameters, inputs.bodies, inputs.driven
    for n in range(driven.size):
        if low <= driven[n] and driven[n] < high:
            drive(n, n + 1, number, position, velocity, parameters, bodies, driven)


@routine
def begin_groups(first, last, frame, number, state, inputs, vectors):
    """Write the inertial or driven positions of groups."""
    position, velocity, before = state
    low, high = first * SUMMED, min(last * SUMMED, len(position))
    if FEATURE.two_stages:
        begin_stage(low, high, number, state, inputs, vectors)
    for k in range(low, high):
        for axis in range(position.shape[1]):
            before[k, axis] = position[k, axis]
    begin(low, high, frame, number, before, velocity, position, inputs.parameters, inputs.integers, inputs.wind_lists)
    if FEATURE.motion:
        drive_between(low, high, number, state, inputs)
    target = vectors.target
    for k in range(low, high):
        for axis in range(3):
            target[k, axis] = position[k, axis]
    put(first, last, position, before, before)


@routine
def finish_groups(first, last, number, state, inputs, matrix):
    """Write velocities of groups after colliders and motions."""
    position, velocity, before = state
    parameters, bodies, kinds = inputs.parameters, inputs.bodies, inputs.kinds
    low, high = first * SUMMED, min(last * SUMMED, len(position))
    update_masses(low, high, before, position, velocity, parameters)
    if FEATURE.motion:
        drive_between(low, high, number, state, inputs)
    if FEATURE.colliders:
        pressed(low, high, number, position, velocity, before, matrix.stiffness, (parameters, bodies, kinds))
        collide_masses(low, high, number, before, position, velocity, parameters, bodies, kinds)


@routine
def matrix_pass(control, first, last, number, state, inputs, solver):
    """Run a pass of the solve, or of its matrix, on the items of a band."""
    rows, vectors, matrix, sums = solver.rows, solver.vectors, solver.matrix, solver.sums
    groups, coarse, kind = solver.groups, solver.coarse, control.next
    position, _, before = state
    if kind == PASS.ROWS:
        assemble(first, last, number, position, vectors.target, before, rows, matrix, inputs, sums)
    elif kind == PASS.SOLVE:
        start_solve(first, last, before, vectors)
    elif kind == PASS.PRODUCT:
        product(first, last, before, rows, vectors, matrix, sums)
    elif kind == PASS.UPDATE:
        update_solution(first, last, control.alpha, before, vectors)
    elif kind == PASS.CORRECT:
        correct(first, last, position, before, vectors, matrix, groups, coarse, sums)
    elif kind == PASS.CENTRES:
        centre(first, last, position, groups, coarse)
    elif kind == PASS.COARSE:
        gather(first, last, position, rows, matrix.blocks, groups, coarse)
    elif kind == PASS.RESTRICT:
        restrict(first, last, position, vectors.residual, groups, coarse)
    else:
        direct(first, last, control.beta, vectors)


@routine
def items_of(kind, tetrahedra, particles, groups):
    """Return the number of items that bands divide: groups, or SUMMED tetrahedra or particles each."""
    if kind in (PASS.CENTRES, PASS.COARSE, PASS.RESTRICT):
        return np.int64(groups)
    of_elements = kind in (PASS.ENERGIES, PASS.BLOCKS)
    return ((tetrahedra if of_elements else particles) + SUMMED - 1) // SUMMED


@routine
def since_of(number, before, inputs, vectors):
    """Return the states that dampers resist changes from."""
    rate = inputs.parameters.newton_rate
    if FEATURE.damped and FEATURE.two_stages:
        return Since(rate, before, vectors.first_start, vectors.first_end, number % 2 == 1)
    return Since(rate, before, before, before, False)


@routine
def one_pass(control, band, bands, frame, number, state, inputs, solver):
    """Run a pass on a band. `control`: the record of control_type; `state`: (position, velocity, before)."""
    position, _, before = state
    elements, vectors, matrix, sums = solver.elements, solver.vectors, solver.matrix, solver.sums
    kind = control.next
    many = items_of(kind, len(elements.corners), len(position), len(solver.groups.starts) - 1)
    first, last = many * band // bands, many * (band + 1) // bands
    if kind == PASS.BEGIN:
        begin_groups(first, last, frame, number, state, inputs, vectors)
    elif kind == PASS.ENERGIES:
        energies(first, last, position, since_of(number, before, inputs, vectors), elements, matrix.forces, sums)
    elif kind == PASS.BLOCKS:
        since = since_of(number, before, inputs, vectors)
        blocks(first, last, position, since, elements, control.safe != 0, matrix.element_blocks)
    elif kind == PASS.WEIGH:
        weigh(first, last, number, position, before, inputs, solver)
    elif kind == PASS.MOVE:
        move(first, last, control.fraction, position, before, vectors, sums)
    elif kind == PASS.ACCEPT:
        accept(first, last, position, vectors)
    elif kind == PASS.RETURN:
        put(first, last, position, before, vectors.current)
    elif kind == PASS.AHEAD:
        put(first, last, position, before, vectors.target)
    elif kind == PASS.FINISH:
        finish_groups(first, last, number, state, inputs, matrix)
    else:
        matrix_pass(control, first, last, number, state, inputs, solver)


@routine
def total(sums, place, groups):
    """Return a sum over groups, in their order."""
    result = 0.0
    for group in range(groups):
        result = result + sums[place, group]
    return result


@routine
def go_on(c, iterations, floor, particles, solver, done):
    """Choose the next pass from the sums of the last one, and do passes of one thread. `c`: the record of control_type."""
    kind, sums = c.next, solver.sums
    groups = ((len(solver.elements.corners) if kind == PASS.ENERGIES else particles) + SUMMED - 1) // SUMMED
    first = total(sums, 0, groups)
    second = total(sums, 1, groups) if kind == PASS.ENERGIES else 0.0
    counts = Counts(c.phase, c.safe, c.products, c.steps, c.halvings)
    values = Values(c.energy, c.trial, c.noise, c.squared, c.enough, c.alpha, c.beta, c.fraction, c.slope, c.unsure)
    done[DONE.EVALUATIONS] += kind == PASS.ENERGIES
    done[DONE.MATRICES] += kind == PASS.ROWS
    done[DONE.PRODUCTS] += kind == PASS.PRODUCT
    if kind == PASS.COARSE:
        kind, first = PASS.FACTOR, 1.0 if factor(solver.coarse, solver.groups) else 0.0
    elif kind == PASS.RESTRICT:
        kind = PASS.SUBSTITUTE
        solve(solver.coarse, solver.groups)
    c.next, counts, values = after(kind, counts, values, first, second, iterations, floor)
    c.phase, c.safe, c.products, c.steps, c.halvings = counts
    c.energy, c.trial, c.noise, c.squared, c.enough, c.alpha, c.beta, c.fraction, c.slope, c.unsure = values
    if kind == PASS.FINISH:
        done[DONE.SOLVES] += 1
        done[DONE.STEPS] += counts.steps
        c.solved += 1


@routine
def advance(team, member, bands, steps, floor, state, inputs, solver, control, done):
    """Do many steps. `steps`: a Steps, whose substeps are solves, and iterations those of a solve; `control` (1,):
    control_type; `done` (DONE,) is incremented."""
    (position, _, _), (count, step, solves, iterations) = state, steps
    while control[0].solved < count * solves:  # it only grows: a late member sees that all is done
        for band in assigned(team, member, bands):
            number = control[0].solved
            frame, number = step + number // solves, step * solves + number
            one_pass(control[0], band, bands, frame, number, state, inputs, solver)
        for _ in assigned(team, member, 1):
            go_on(control[0], iterations, floor, len(position), solver, done)


@cache
def make_newton_advance(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile `advance` as advance(bands, steps, floor, state, inputs, solver, control, done)."""
    compiler = Compiler(cloth_variant("newton", real, math, parts), math)
    touch = compiler.variant_of(real, mesh_features(parts - {FRICTION_IN_PLACE}))(collide_mass)
    kernel = with_forces(filled(advance, {"touch": touch}), parts)
    return compiler.team(
        compiler.variant_of(real, mesh_features(parts) | kernel_features(parts | {"load"})).copied(kernel)
    )
