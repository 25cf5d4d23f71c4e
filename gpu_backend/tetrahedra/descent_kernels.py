"""CUDA kernels that visit vertices of tetrahedral bodies: one thread per vertex of a colour, no two of which share a
tetrahedron.

Corners, values and strains are flat and stored column by column; model/formulas/elastic/descent.py has the formulas.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, make_row, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.descent_contact import make_meeting
from softlab.gpu_backend.tetrahedra.springs import make_pulled
from softlab.model.base.tuples import each_of, tuple_of
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import chebyshev, descent
from softlab.model.tetrahedra.descent import CORNERS, RATE, SCALE
from softlab.model.tetrahedra.springs import PARTS, SpringArrays

NOTHING: frozenset[str] = frozenset()


@cache
def make_accelerate(real: Real, math: str) -> Kernel:
    """Compile accelerate(position, iterates, w): it extrapolates every particle after a sweep; `iterates`: quads of the
    positions after the last sweep, then after the one before it."""
    beyond, zero = device_formulas(chebyshev, real, math).beyond, real(0)

    def accelerate(position, iterates, w):
        k, count = np.int32(cuda.grid(1)), np.int32(position.size // SIZE)
        if k < count:
            p = load_quad(position, k)
            if p[3] > zero:
                older = load_quad(iterates, count + k)
                x, y, z = beyond(p[0], older[0], w), beyond(p[1], older[1], w), beyond(p[2], older[2], w)
                last = load_quad(iterates, k)
                store_quad(iterates, count + k, last[0], last[1], last[2], last[3])
                store_quad(iterates, k, x, y, z, zero)
                store_quad(position, k, x, y, z, p[3])

    return make_kernel(accelerate, f"chebyshev_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_visits(real: Real, math: str, material: int, damped: bool, parts: frozenset[str] = NOTHING) -> SimpleNamespace:
    """Compile `remember`, `start` and `descend`.

    `remember(before, corners, values, strains, count)`: strains of every tetrahedron of a material at the start of a
    substep; `start(before, velocity, inertial, position, order, falls, stop, record)`: for the vertices before `stop`
    of the order, also pinned ones; `descend(position, inertial, order, offsets, entries, corners, values, strains,
    spring_offsets, sprung_entries, ends, numbers, before, holds, first, stop, count, record, bodies, integers, counter,
    place, substeps, substep)`: for a colour; `spring_offsets` to `numbers`: of springs; `holds` (particles,) [N/m];
    both are read if `parts` has them. `count`: tetrahedra of the material.
    """
    formulas = device_formulas(descent, real, math, {"material": material, "damped": damped})
    element, initial_strain, added = formulas.element, formulas.initial_strain, formulas.added
    moved, coasted = formulas.moved, formulas.coasted
    pulled, sprung, inline, zero = make_pulled(real, math), bool(parts & PARTS), inlined(math), real(0)
    meeting, clock = make_meeting(real, math, parts), make_clock(math, parts)
    has_bodies, add_contact = meeting.has_bodies, meeting.add_contact
    nobody, one, two, three = np.int32(0), np.int32(1), np.int32(2), np.int32(3)
    nothing, no_sums = (zero,) * descent.STRAINS, (zero,) * descent.SUMS

    @inline
    def xyz(quad):
        return quad[0], quad[1], quad[2]

    def point_at(n: int) -> Callable:
        return inline(lambda position, corners, count, t: xyz(load_quad(position, corners[n])))

    def strain_at(n: int) -> Callable:
        return inline(lambda strains, unused, count, t: strains[np.uint32(np.int32(n * count) + t)])

    def store_at(n: int) -> Callable:
        @inline
        def store(strains, unused, count, t, strain):
            strains[np.uint32(np.int32(n * count) + t)] = strain

        return store

    corners_of, values_of = make_row(CORNERS, inline), make_row(descent.COUNT, inline)
    points_at, strains_of = tuple_of(CORNERS, point_at, inline), tuple_of(descent.STRAINS, strain_at, inline)
    store_all = each_of(descent.STRAINS, store_at, inline)

    @inline
    def points_of(position, corners, count, t):
        return points_at(position, corners_of(corners, count, t), count, t)

    def remember(before, corners, values, strains, size):
        t = np.int32(cuda.grid(1))
        count = np.int32(size)
        if t < count:
            strain = initial_strain(points_of(before, corners, count, t), values_of(values, count, t))
            store_all(strains, t, count, t, strain)

    def start(before, velocity, inertial, position, order, falls, stop, record):
        k = np.int32(cuda.grid(1))
        if k < stop:
            vertex = order[k]
            b, p = load_quad(before, vertex), load_quad(inertial, vertex)
            x, y, z = xyz(p)
            if falls[k] == nobody:
                x, y, z = coasted(xyz(b), xyz(load_quad(velocity, vertex)), record[0].dt)
            store_quad(position, vertex, x, y, z, b[3])

    def descend(
        position, inertial, order, offsets, entries, corners, values, strains, spring_offsets, sprung_entries, ends,
        numbers, before, holds, first, stop, size, record, bodies, integers, counter, place, substeps, substep,
    ):  # fmt: skip
        parameters = record[0]
        k, count = np.int32(first + cuda.grid(1)), np.int32(size)
        if k < stop:
            vertex, rate = order[k], parameters[RATE]
            sums = no_sums
            for n in range(offsets[k], offsets[k + one]):
                t, corner = entries[n] >> two, entries[n] & three
                old = nothing
                if damped:
                    old = strains_of(strains, t, count, t)
                points = points_of(position, corners, count, t)
                sums = added(sums, element(points, values_of(values, count, t), old, corner, rate))
            if sprung:
                x, y, z, hard, _ = pulled(vertex, position, SpringArrays(spring_offsets, sprung_entries, ends, numbers))
                sums = added(sums, (x, y, z, hard, hard, hard, zero, zero, zero))
            p = load_quad(position, vertex)
            if has_bodies:
                _, number = clock(counter, place, substeps, substep)
                world = World(parameters, bodies, integers)
                sums = add_contact(sums, load_quad(before, vertex), p, holds[vertex], world, number)
            x, y, z = moved(xyz(p), xyz(load_quad(inertial, vertex)), p[3], parameters[SCALE], sums)
            store_quad(position, vertex, x, y, z, p[3])

    return make_kernels((remember, start, descend), f"descent_{variant_name(real, math)}", **kernel_options(math))
