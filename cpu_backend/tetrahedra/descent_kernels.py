"""Visits of tetrahedral bodies' vertices on CPU threads, and the loops of a step over them.

No two vertices of a colour share a tetrahedron, so threads may process any part of it: the state's bits depend neither
on their number nor on their order. model/formulas/elastic/descent.py has the formulas of a visit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.position_based.mesh_kernels import make_substep
from softlab.cpu_backend.tetrahedra.descent_acceleration import make_accelerate
from softlab.cpu_backend.tetrahedra.descent_contact import make_meeting
from softlab.cpu_backend.tetrahedra.springs import make_springs
from softlab.model.base.tuples import tuple_of
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import descent
from softlab.model.tetrahedra.descent import CHEBYSHEV, CORNERS, RATE, SCALE, Descent, visited
from softlab.model.tetrahedra.springs import PARTS, SpringArrays, Springs

ALONE = 8  # vertices of a colour that one thread processes faster than threads can synchronise: a few microseconds
NOTHING: frozenset[str] = frozenset()


class DescentArrays(NamedTuple):
    """Arrays of a material: order, colours' starts and lists of vertices, true for those that fall freely; corners, values
    and strains of tetrahedra; springs."""

    order: np.ndarray
    starts: np.ndarray
    offsets: np.ndarray
    entries: np.ndarray
    falls: np.ndarray
    corners: np.ndarray
    values: np.ndarray
    strains: np.ndarray
    springs: SpringArrays


def descent_arrays(vertex_descent: Descent, real: Real, damped: bool, spring_set: Springs) -> DescentArrays:
    count = len(vertex_descent.corners) if damped else 0
    strains: np.ndarray = np.zeros((count, descent.STRAINS), real)
    values: np.ndarray = np.ascontiguousarray(vertex_descent.values, real)
    return DescentArrays(
        vertex_descent.order, vertex_descent.starts, vertex_descent.offsets, vertex_descent.entries,
        vertex_descent.falls, vertex_descent.corners, values, strains, spring_set.arrays(real),
    )  # fmt: skip


@cache
def make_visits(real: Real, math: str, material: int, damped: bool, parts: frozenset[str] = NOTHING) -> SimpleNamespace:
    """Make loops over a material, from the first of a range to before its last.

    `remember(first, last, before, arrays)`: strains of tetrahedra at the start of a substep. Over the ordered vertices:
    `start(first, last, before, velocity, inertial, position, arrays, parameters)` and `descend(first, last, position,
    inertial, arrays, parameters, arguments)`. `arguments`: substep, before, stiffness that holds particles, bodies, kinds.
    """
    compiler = Compiler(f"{descent.__name__.rpartition('.')[2]}_{np.dtype(real).name}_{math}", math)
    compiled = compiler.compiled
    formulas = compiler.formulas(descent, real, {"material": material, "damped": damped})
    element = compiler.inlined(formulas.element.py_func)
    initial_strain, added, moved, coasted = formulas.initial_strain, formulas.added, formulas.moved, formulas.coasted
    pulled, zero, sprung = make_springs(compiler, real).pulled, real(0), bool(parts & PARTS)
    meeting = make_meeting(compiler, real, parts)
    has_bodies, add_contact = meeting.has_bodies, meeting.add_contact

    @compiled
    def row(array, k):
        return array[k, 0], array[k, 1], array[k, 2]

    def point_at(n: int) -> Callable:
        return compiled(lambda position, corners, unused, t: row(position, corners[t, n]))

    def value_at(n: int) -> Callable:
        return compiled(lambda values, unused, unused_too, t: values[t, n])

    points_of = tuple_of(CORNERS, point_at, compiled)
    values_of = tuple_of(descent.COUNT, value_at, compiled)
    strains_of = tuple_of(descent.STRAINS, value_at, compiled)
    nothing = (zero,) * descent.STRAINS
    no_sums = (zero,) * descent.SUMS

    @compiled
    def remember(first, last, before, arrays):
        corners, values, strains = arrays.corners, arrays.values, arrays.strains
        for t in range(first, last):
            strain = initial_strain(points_of(before, corners, t, t), values_of(values, t, t, t))
            for n in range(strains.shape[1]):
                strains[t, n] = strain[n]

    @compiled
    def start(first, last, before, velocity, inertial, position, arrays, parameters):
        order, falls = arrays.order, arrays.falls
        for k in range(first, last):
            vertex = order[k]
            x, y, z = row(inertial, vertex)
            if falls[k] == 0:
                x, y, z = coasted(row(before, vertex), row(velocity, vertex), parameters.dt)
            position[vertex, 0] = x
            position[vertex, 1] = y
            position[vertex, 2] = z

    @compiled
    def descend(first, last, position, inertial, arrays, parameters, arguments):
        order, offsets, entries, corners = arrays.order, arrays.offsets, arrays.entries, arrays.corners
        values, strains = arrays.values, arrays.strains
        rate = parameters[RATE]
        for k in range(first, last):
            vertex = order[k]
            sums = no_sums
            for n in range(offsets[k], offsets[k + 1]):
                t = entries[n] >> 2
                old = strains_of(strains, t, t, t) if damped else nothing
                sums = added(
                    sums,
                    element(points_of(position, corners, t, t), values_of(values, t, t, t), old, entries[n] & 3, rate),
                )
            if sprung:
                x, y, z, hard, _ = pulled(vertex, position, arrays.springs)
                sums = added(sums, (x, y, z, hard, hard, hard, zero, zero, zero))
            if has_bodies:
                number, before, holds, bodies, kinds = arguments
                sums = add_contact(vertex, sums, position, (number, before, holds, parameters, bodies, kinds))
            x, y, z = moved(
                row(position, vertex), row(inertial, vertex), position[vertex, 3], parameters[SCALE], sums
            )  # fmt: skip
            position[vertex, 0] = x
            position[vertex, 1] = y
            position[vertex, 2] = z

    return SimpleNamespace(remember=remember, start=start, descend=descend)


def make_material(compiler: Compiler, visits: Sequence[SimpleNamespace], damped: bool) -> SimpleNamespace:
    """Make loops over all materials in turn, each with its `visits`.

    `prepare(team, member, bands, before, velocity, inertial, position, descents, parameters)` and `sweep(team, member,
    bands, position, inertial, descents, parameters, given)`; `descents`: DescentArrays of each.
    """
    sweeps = SimpleNamespace(prepare=None, sweep=None)
    for number in range(len(visits) - 1, -1, -1):
        sweeps = _of_material(compiler, number, visits[number], sweeps, damped)
    return sweeps


def _of_material(
    compiler: Compiler, number: int, visits: SimpleNamespace, others: SimpleNamespace, damped: bool
) -> SimpleNamespace:
    """Make both loops for material `number`, followed by the `others`."""
    remember, start, descend = visits.remember, visits.start, visits.descend
    prepare_others, sweep_others, has_others = others.prepare, others.sweep, others.sweep is not None

    @compiler.compiled
    def prepare(team, member, bands, before, velocity, inertial, position, descents, parameters):
        arrays = descents[number]
        if damped:
            count = np.int64(arrays.corners.shape[0])
            for part in assigned(team, member, bands):
                remember(count * part // bands, count * (part + 1) // bands, before, arrays)
        free = np.int64(arrays.starts[arrays.starts.size - 1])
        for part in assigned(team, member, bands):
            first, last = free * part // bands, free * (part + 1) // bands
            start(first, last, before, velocity, inertial, position, arrays, parameters)
        if has_others:
            prepare_others(team, member, bands, before, velocity, inertial, position, descents, parameters)

    @compiler.compiled
    def sweep(team, member, bands, position, inertial, descents, parameters, arguments):
        arrays = descents[number]
        starts = arrays.starts
        for colour in range(starts.size - 1):
            begin, many = np.int64(starts[colour]), starts[colour + 1] - starts[colour]
            parts = bands if many >= ALONE else 1
            for part in assigned(team, member, parts):
                first, last = begin + many * part // parts, begin + many * (part + 1) // parts
                descend(first, last, position, inertial, arrays, parameters, arguments)
        if has_others:
            sweep_others(team, member, bands, position, inertial, descents, parameters, arguments)

    return SimpleNamespace(prepare=prepare, sweep=sweep)


@cache
def make_descent_stages(real: Real, math: str, material: int, damped: bool, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the loops of `make_visits`, each as a parallel loop over a range: (bands, first, last, ...)."""
    compiler = Compiler(f"descent_stages_{np.dtype(real).name}_{math}", math)
    visits = make_visits(real, math, material, damped, parts)
    remember_some, start_some, descend_some = visits.remember, visits.start, visits.descend

    def remember(band, bands, first, last, before, arrays):
        many = last - first
        remember_some(first + many * band // bands, first + many * (band + 1) // bands, before, arrays)

    def start(band, bands, first, last, before, velocity, inertial, position, arrays, parameters):
        many = last - first
        start_some(
            first + many * band // bands, first + many * (band + 1) // bands, before, velocity, inertial, position, arrays,
            parameters,
        )  # fmt: skip

    def descend(band, bands, first, last, position, inertial, arrays, parameters, arguments):
        many = last - first
        descend_some(
            first + many * band // bands, first + many * (band + 1) // bands, position, inertial, arrays, parameters,
            arguments
        )  # fmt: skip

    return SimpleNamespace(**{one.__name__: compiler.banded(one) for one in (remember, start, descend)})


@cache
def make_descent_advance(
    real: Real, math: str, parts: frozenset[str], numbers: tuple[int, ...], damped: bool
) -> Callable:
    """Compile advance(bands, steps, state, descents, holds, world, chebyshev): many steps in one call.

    `steps`: a Steps; `state`: (position, velocity, before, inertial); `numbers`: the materials of the `descents`; `world`: a
    World of position_based/mesh_kernels.py; `chebyshev`: (displacements, weights (iterations,)) of the acceleration.
    """
    compiler = Compiler(cloth_variant("descent", real, math, parts), math)
    whole = make_substep(compiler, real, parts)
    opening, closing = whole.opening, whole.closing
    all_materials = make_material(
        compiler, [make_visits(real, math, one, damped, visited(parts)) for one in numbers], damped
    )
    prepare, sweep = all_materials.prepare, all_materials.sweep
    accelerate, accelerated = make_accelerate(compiler, real), CHEBYSHEV in parts

    def advance(team, member, bands, steps, state, descents, holds, world, chebyshev):
        position, velocity, before, inertial = state
        parameters, (iterates, weights) = world.parameters, chebyshev
        count = len(position)
        number_of_steps, step, substeps, iterations = steps
        for pass_number in range(number_of_steps * substeps):
            number = step * substeps + pass_number
            frame = step + pass_number // substeps
            opening(team, member, bands, frame, number, position, velocity, before, inertial, world)
            prepare(team, member, bands, before, velocity, inertial, position, descents, parameters)
            arguments = number, before, holds, world.bodies, world.kinds
            for iteration in range(iterations):
                sweep(team, member, bands, position, inertial, descents, parameters, arguments)
                if accelerated:
                    for band in assigned(team, member, bands):
                        first, last = count * band // bands, count * (band + 1) // bands
                        accelerate(first, last, position, iterates, weights[iteration])
            closing(team, member, bands, number, position, velocity, before, world)

    return compiler.team(advance)
