"""Visits of tetrahedral bodies' vertices on CPU threads, and the loops of a step over them.

No two vertices of a colour share a tetrahedron, so threads may process any part of it, and the bits of the state do not
depend on their number or order. model/formulas/elastic/descent.py has the formulas of a visit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.position_based.mesh_kernels import closing, mesh_features, opening
from softlab.cpu_backend.tetrahedra.descent_acceleration import accelerate_some
from softlab.cpu_backend.tetrahedra.descent_contact import add_contact
from softlab.cpu_backend.tetrahedra.springs import pulled, row
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, Variant, filled, routine, unrolled
from softlab.model.formulas.elastic import descent
from softlab.model.formulas.elastic.descent import COUNT, STRAINS, SUMS, added, coasted, initial_strain, moved
from softlab.model.tetrahedra.descent import RATE, SCALE, Descent, visited
from softlab.model.tetrahedra.springs import SpringArrays, Springs, kernel_features

ALONE = 8  # vertices of a colour that one thread processes faster than threads can synchronise: a few microseconds
NO_STRAINS, NO_SUMS = (0.0,) * STRAINS, (0.0,) * SUMS

element = Open("element(points, values, before, corner, rate), of model/formulas/elastic/descent.py, inlined")


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
    strains: np.ndarray = np.zeros((count, STRAINS), real)
    values: np.ndarray = np.ascontiguousarray(vertex_descent.values, real)
    return DescentArrays(
        vertex_descent.order, vertex_descent.starts, vertex_descent.offsets, vertex_descent.entries,
        vertex_descent.falls, vertex_descent.corners, values, strains, spring_set.arrays(real),
    )  # fmt: skip


@routine
def points_of(points, corners, t):
    """Return the corners of tetrahedron t."""
    return tuple(row(points, corners[t, n]) for n in unrolled(4))


@routine
def values_of(values, t):
    return tuple(values[t, n] for n in unrolled(COUNT))


@routine
def strains_of(strains, t):
    return tuple(strains[t, n] for n in unrolled(STRAINS))


@routine
def remember_some(first, last, before, arrays):
    """Write the strains of tetrahedra at the start of a substep, from the first of a range to before its last."""
    corners, values, strains = arrays.corners, arrays.values, arrays.strains
    for t in range(first, last):
        strain = initial_strain(points_of(before, corners, t), values_of(values, t))
        for n in range(strains.shape[1]):
            strains[t, n] = strain[n]


@routine
def start_some(first, last, before, velocity, inertial, position, arrays, parameters):
    """Write the start of the iterations of ordered vertices."""
    order, falls = arrays.order, arrays.falls
    for k in range(first, last):
        vertex = order[k]
        x, y, z = row(inertial, vertex)
        if falls[k] == 0:
            x, y, z = coasted(row(before, vertex), row(velocity, vertex), parameters.dt)
        position[vertex, 0] = x
        position[vertex, 1] = y
        position[vertex, 2] = z


@routine
def descend_some(first, last, position, inertial, arrays, parameters, arguments):
    """Visit ordered vertices. `arguments`: substep, positions at its start, stiffness that holds particles, bodies, kinds."""
    order, offsets, entries, corners = arrays.order, arrays.offsets, arrays.entries, arrays.corners
    values, strains = arrays.values, arrays.strains
    rate = parameters[RATE]
    for k in range(first, last):
        vertex = order[k]
        sums = NO_SUMS
        for n in range(offsets[k], offsets[k + 1]):
            t = entries[n] >> 2
            old = strains_of(strains, t) if FEATURE.damped else NO_STRAINS
            points, numbers = points_of(position, corners, t), values_of(values, t)
            sums = added(sums, element(points, numbers, old, entries[n] & 3, rate))
        if FEATURE.springs:
            x, y, z, hard, _ = pulled(vertex, position, arrays.springs)
            sums = added(sums, (x, y, z, hard, hard, hard, 0.0, 0.0, 0.0))
        if FEATURE.colliders:
            number, before, holds, bodies, kinds = arguments
            sums = add_contact(vertex, sums, position, (number, before, holds, parameters, bodies, kinds))
        x, y, z = moved(row(position, vertex), row(inertial, vertex), position[vertex, 3], parameters[SCALE], sums)
        position[vertex, 0] = x
        position[vertex, 1] = y
        position[vertex, 2] = z


remember_material = Open("remember_some of the material, in its variant")
start_material = Open("start_some of the material, in its variant")
descend_material = Open("descend_some of the material, in its variant")
number = Open("place of the material's arrays among `descents`")
prepare_others = Open("prepare_material of the materials after it")
sweep_others = Open("sweep_material of the materials after it")


@routine
def no_others(*arguments):
    """Do nothing: the last material is done."""
    return


@routine
def prepare_material(team, member, bands, before, velocity, inertial, position, descents, parameters):
    """Begin a substep: a team writes strains and starts of a material, then of the others."""
    arrays = descents[number]
    if FEATURE.damped:
        count = np.int64(arrays.corners.shape[0])
        for part in assigned(team, member, bands):
            remember_material(count * part // bands, count * (part + 1) // bands, before, arrays)
    free = np.int64(arrays.starts[arrays.starts.size - 1])
    for part in assigned(team, member, bands):
        first, last = free * part // bands, free * (part + 1) // bands
        start_material(first, last, before, velocity, inertial, position, arrays, parameters)
    prepare_others(team, member, bands, before, velocity, inertial, position, descents, parameters)


@routine
def sweep_material(team, member, bands, position, inertial, descents, parameters, arguments):
    """Visit the vertices of a material colour by colour, then those of the others."""
    arrays = descents[number]
    starts = arrays.starts
    for colour in range(starts.size - 1):
        begin, many = np.int64(starts[colour]), starts[colour + 1] - starts[colour]
        parts = bands if many >= ALONE else 1
        for part in assigned(team, member, parts):
            first, last = begin + many * part // parts, begin + many * (part + 1) // parts
            descend_material(first, last, position, inertial, arrays, parameters, arguments)
    sweep_others(team, member, bands, position, inertial, descents, parameters, arguments)


@routine
def remember(band, bands, first, last, before, arrays):
    many = last - first
    remember_some(first + many * band // bands, first + many * (band + 1) // bands, before, arrays)


@routine
def start(band, bands, first, last, before, velocity, inertial, position, arrays, parameters):
    many = last - first
    start_some(
        first + many * band // bands, first + many * (band + 1) // bands, before, velocity, inertial, position, arrays,
        parameters,
    )  # fmt: skip


@routine
def descend(band, bands, first, last, position, inertial, arrays, parameters, arguments):
    many = last - first
    descend_some(
        first + many * band // bands, first + many * (band + 1) // bands, position, inertial, arrays, parameters,
        arguments,
    )  # fmt: skip


prepare = Open("prepare_material of the first material")
sweep = Open("sweep_material of the first material")


@routine
def advance(team, member, bands, steps, state, descents, holds, world, chebyshev):
    """Do many steps. `steps`: a Steps; `state`: (position, velocity, before, inertial); `descents`: DescentArrays of the
    materials; `world`: a World of position_based/mesh_kernels.py; `chebyshev`: (positions after the last two sweeps,
    weights (iterations,)) of the acceleration."""
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
            if FEATURE.chebyshev:
                for band in assigned(team, member, bands):
                    first, last = count * band // bands, count * (band + 1) // bands
                    accelerate_some(first, last, position, iterates, weights[iteration])
        closing(team, member, bands, number, position, velocity, before, world)


def _visits(
    compiler: Compiler, real: Real, material: int, damped: bool, parts: frozenset[str]
) -> tuple[Variant, dict[str, Any]]:
    """Return the variant of a material's visits, and the functions for the open names in them."""
    variant = compiler.variant_of(real, kernel_features(parts) | {"material": material, "damped": damped})
    inlined = compiler.inlined(variant.copied(descent.element))
    return variant, {"element": inlined, "touch": collide_mass}


@cache
def make_descent_stages(real: Real, math: str, material: int, damped: bool, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `remember`, `start` and `descend`, each as a parallel loop over a range: (bands, first, last, ...)."""
    compiler = Compiler(f"descent_stages_{np.dtype(real).name}_{math}", math)
    variant, names = _visits(compiler, real, material, damped, parts)
    loops = remember, start, filled(descend, names)
    return SimpleNamespace(**{one.__name__: compiler.banded(variant.copied(one)) for one in loops})


@cache
def make_descent_advance(
    real: Real, math: str, parts: frozenset[str], numbers: tuple[int, ...], damped: bool
) -> Callable:
    """Compile `advance` as advance(bands, steps, ...); `numbers`: the materials of its `descents`."""
    compiler = Compiler(cloth_variant("descent", real, math, parts), math)
    prepared, swept = no_others, no_others
    for place in reversed(range(len(numbers))):
        variant, names = _visits(compiler, real, numbers[place], damped, visited(parts))
        first = {"remember_material": variant(remember_some), "start_material": variant(start_some)}
        prepared = filled(prepare_material, {"number": place, "prepare_others": prepared, **first})
        visit = variant(filled(descend_some, names))
        swept = filled(sweep_material, {"number": place, "sweep_others": swept, "descend_material": visit})
    variant = compiler.variant_of(real, mesh_features(parts) | kernel_features(parts | {"load"}) | {"damped": damped})
    kernel = with_forces(filled(advance, {"prepare": prepared, "sweep": swept}), parts)
    return compiler.team(variant.copied(kernel))
