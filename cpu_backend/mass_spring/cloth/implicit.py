"""Implicit Euler on the cloth: passes over the sheet, each by bands of rows, until the residual is small enough.

No matrix is assembled: its product with a vector is computed spring by spring, as forces are. The next pass is chosen
from sums over all masses that have one order for any number of threads (mass_spring/cloth/sums.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, aligned_zeros, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import AXES, SPAN, cloth_variant
from softlab.cpu_backend.core.wind import air_now
from softlab.cpu_backend.mass_spring.arrays import ImplicitArrays
from softlab.cpu_backend.mass_spring.cloth.implicit_rows import (
    AR,
    WORK_PLANES,
    R,
    S,
    U,
    X,
    add_up,
    clear,
    finish_row,
    leave_row,
    move_row,
    product_row,
    pull_end,
    pull_matrix,
    residual_row,
    spring_parts,
    start_row,
    sum_elsewhere,
    system_functions,
    update_row,
    walk_elsewhere,
)
from softlab.cpu_backend.mass_spring.cloth.kernels import PLANES, settle
from softlab.cpu_backend.mass_spring.cloth.rows import cloth_features
from softlab.cpu_backend.mass_spring.cloth.sums import total
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, routine
from softlab.model.formulas import implicit
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.implicit import (
    FINISH,
    HALVINGS,
    ITERATIONS,
    MATRICES,
    MOVE,
    PRODUCT,
    RESIDUAL,
    RETREAT,
    START,
    STEPS,
    UPDATE,
    Counts,
    Values,
    after_product,
    after_residual,
)
from softlab.model.mass_spring.implicit_parameters import (
    LANES,
    SEGMENT,
    SUMS,
    TREE,
    segments_of,
    system_record,
    without_dampers,
)


def control_type(real: Real) -> np.dtype:
    """Return the structured type of the values that passes leave for the next: its kind, number of solves, Counts and
    Values of formulas/implicit.py."""
    integers = [(name, np.int64) for name in ("next", "steps", *implicit.Counts._fields)]
    numbers = [(name, real) for name in implicit.Values._fields]
    return np.dtype((np.record, np.dtype([*integers, *numbers], align=True)))


@routine
def factors_of(kind: int) -> int:
    """Return the number of dot products that a pass sums up."""
    if kind == RESIDUAL:
        return 3
    return 2 if kind == PRODUCT else 0


@routine
def factors(kind: int, n: int) -> tuple[int, int]:
    """Return (first plane of one vector, of the other) of the n-th dot product, in the formulas' order."""
    if kind == PRODUCT:
        return R, (R if n == 0 else AR)
    if n == 0:
        return R, R
    return (R, S) if n == 1 else (U, U)


@routine
def pass_band(c, band, step, source, target, sheet, system, arrays):
    """Do one pass on a band's rows; `c`: the record of control_type; `arrays`: ImplicitArrays."""
    layout, parameters, integers, kind = sheet.layout, sheet.parameters, sheet.integers, c.next
    work, scratches, sums = arrays.work, arrays.scratches, arrays.sums
    rows, columns, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_PLANE]
    bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // (AXES * FEATURE.triples)
    first, last = rows * band // bands, rows * (band + 1) // bands
    scratch, running = scratches[band], arrays.lanes[band]
    blocks, segments = (columns + BLOCK - 1) // BLOCK, (columns + SEGMENT - 1) // SEGMENT
    count, end, air = rows * segments, 0.0, (0.0, 0.0, 0.0)
    if FEATURE.motion:
        end = instant(step + 1, parameters.dt, parameters.first_step, parameters.first_time)
    if kind == START:
        if FEATURE.wind:
            air = air_now(parameters, integers, step, 0.0)
        walk_elsewhere(first, blocks, layout, source, parameters, air, scratch, width)
    springs = kind in (RESIDUAL, PRODUCT)
    if springs and first < SPAN:
        clear(scratch, width)
    for i in range(max(first - SPAN, 0) if springs else first, last):
        if kind == RESIDUAL:  # also the springs that lead down from the two rows above the first one
            pull_end(i, i >= first, blocks, layout, work, parameters, scratch, width)
        elif kind == PRODUCT:
            pull_matrix(i, i >= first, blocks, layout, row_at(work, X * plane), system, scratch, width)
        if i < first:
            continue
        if kind == START:
            sum_elsewhere(i, step, step, blocks, source, sheet, air, scratch, width)
            start_row(i, blocks, layout, source, work, parameters, scratch, width)
        elif kind == RESIDUAL:
            residual_row(i, blocks, work, sheet, system, scratch, width)
        elif kind == PRODUCT:
            product_row(i, blocks, work, sheet, system, scratch, width)
        elif kind == UPDATE:
            update_row(i, c.iterations == 1, blocks, layout, work, c.alpha, c.beta)
        elif kind in (MOVE, RETREAT):
            move_row(i, kind == RETREAT, blocks, layout, source, work, parameters)
        else:
            finish_row(i, step, blocks, layout, source, work, target, parameters, sheet.bodies, sheet.kinds)
        for n in range(factors_of(kind)):
            one, other = factors(kind, n)
            add_up(i, layout, work, one, other, running, row_at(sums, n * count + i * segments))
        if kind in (START, MOVE, RETREAT, FINISH):
            into = target if kind == FINISH else row_at(work, X * plane)
            settle(i, blocks, source, into, end, sheet)
        if kind == START:
            leave_row(i, blocks, layout, work, parameters)


@routine
def go_on(c, count, system, sums, tree, done):
    """Choose the next pass from the sums of the last one. `c`: the record of control_type."""
    kind, later = c.next, RESIDUAL
    counts = Counts(c.matrices, c.halvings, c.iterations)
    values = Values(c.first, c.before, c.limit, c.slope, c.squared, c.alpha, c.beta)
    if kind == RESIDUAL:
        residual_sums = (
            total(sums, count, tree), total(row_at(sums, count), count, tree),
            total(row_at(sums, 2 * count), count, tree),
        )  # fmt: skip
        later, counts, values = after_residual(counts, values, residual_sums, system.speed_squared, system.roundoff)
        done[HALVINGS] += later == RETREAT
    elif kind == PRODUCT:
        squared, curvature = total(sums, count, tree), total(row_at(sums, count), count, tree)
        later, counts, values = after_product(counts, values, squared, curvature)
        done[ITERATIONS] += later == UPDATE
        done[MATRICES] += later != UPDATE
    elif kind == UPDATE:
        later = PRODUCT
    elif kind == MOVE and FEATURE.linear:
        later = FINISH
    elif kind == FINISH:
        later, counts = START, Counts(np.int64(0), np.int64(0), np.int64(0))
        values = Values(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        done[STEPS] += 1
        c.steps += 1
    c.next = later
    c.matrices, c.halvings, c.iterations = counts
    c.first, c.before, c.limit, c.slope, c.squared, c.alpha, c.beta = values


@routine
def advance(team, member, bands, steps, step, states, current, sheet, system, arrays):
    layout, control = sheet.layout, arrays.control
    size = PLANES * layout[L_PLANE]
    count = layout[L_ROWS] * ((layout[L_COLUMNS] + SEGMENT - 1) // SEGMENT)
    while control[0].steps < steps:  # it only grows: a late member sees that all is done
        for band in assigned(team, member, bands):
            c = control[0]
            now = (current + c.steps) % 2
            source, target = row_at(states, now * size), row_at(states, (1 - now) * size)
            pass_band(c, band, step + c.steps, source, target, sheet, system, arrays)
        for _ in assigned(team, member, 1):
            go_on(control[0], count, system, arrays.sums, arrays.tree, arrays.done)


@cache
def make_cloth_implicit(real: Real, math: str, linear: bool, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, states, current, sheet, system, arrays).

    It does `steps` steps, alternating between the two states of `states` (core/layout.py). `system`:
    model/mass_spring/implicit_parameters.py; `arrays`: ImplicitArrays, whose `control` is 0 at first. With `linear` a
    step ends after its first matrix.
    """
    compiler = Compiler(cloth_variant(f"implicit_{'once' if linear else 'newton'}", real, math, parts), math)
    springs = cloth_features(real, "implicit-euler", spring_parts(parts))
    features = {
        **cloth_features(real, "implicit-euler", parts), "at_close": springs["at_close"], "cleared": springs["cleared"],
        "linear": linear,
    }  # fmt: skip
    kernel = filled(advance, system_functions(compiler, real, parts))
    return compiler.team(compiler.variant_of(real, features).copied(kernel))


class ImplicitSteps:
    """The steps of one simulation, a cpu_backend.mass_spring.cloth.solver.ClothMassSpring, and their arrays besides its
    state.

    `done`: (steps, matrices, iterations of conjugate gradients, halved Newton steps) so far.
    """

    def __init__(self, simulation: Any):
        self.simulation = simulation
        real, body, scene = simulation.real, simulation.body, simulation.scene
        bands, plane = simulation._bands, simulation._layout.plane
        self.done = np.zeros(len(implicit.DONE), np.int64)
        self._arrays = ImplicitArrays(
            aligned_zeros(WORK_PLANES * plane, real), simulation._scratch,
            aligned_zeros(bands * LANES, real).reshape(bands, LANES),
            np.zeros(SUMS * segments_of(body.rows, body.columns), real), aligned_zeros(TREE, real), self.done,
            np.zeros(1, control_type(real)),
        )  # fmt: skip
        linear = scene.method.integrator == "implicit-euler-linear"
        parts = without_dampers(simulation.plan.parts)
        self._kernel = make_cloth_implicit(real, simulation.options.math, linear, parts)
        self.renew()

    def renew(self) -> None:
        """Update the system from the scene's current fields."""
        self._system = system_record(self.simulation.scene, self.simulation.real)[0]

    def advance(self, step: int, steps: int) -> None:
        sim = self.simulation
        self._arrays.control[...] = 0
        self._kernel(sim._bands, steps, step, sim._states, sim._current, sim.sheet, self._system, self._arrays)
        sim._current = (sim._current + steps) % 2
