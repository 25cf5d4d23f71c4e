"""CUDA kernels that visit vertices of tetrahedral bodies: one thread per vertex of a colour, no two of which share a
tetrahedron.

Corners, values and strains are flat and stored column by column; model/formulas/elastic/descent.py has the formulas.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import Kernel, kernel_options, kernels_of, make_kernel, variant_name
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock, knows_time
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.descent_contact import add_contact
from softlab.gpu_backend.tetrahedra.springs import pulled, xyz
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine, unrolled
from softlab.model.formulas.elastic.chebyshev import beyond
from softlab.model.formulas.elastic.descent import STRAINS, SUMS, added, coasted, element, initial_strain, moved
from softlab.model.tetrahedra.descent import RATE, SCALE
from softlab.model.tetrahedra.springs import SpringArrays, kernel_features

NO_STRAINS, NO_SUMS = (0.0,) * STRAINS, (0.0,) * SUMS


class DescentArrays(NamedTuple):
    """Arrays of a material: its vertices, ordered, with their lists of tetrahedra, 1 for those that fall freely; corners,
    values and strains of its `number` tetrahedra. Of all materials: springs; stiffness that holds each particle [N/m]."""

    order: DeviceArray
    offsets: DeviceArray
    entries: DeviceArray
    falls: DeviceArray
    corners: DeviceArray
    values: DeviceArray
    strains: DeviceArray
    springs: SpringArrays
    holds: DeviceArray
    number: np.int32


@routine
def accelerate(position, iterates, w):
    """Extrapolate every particle after a sweep; `iterates`: quads of the positions after the last sweep, then after the
    one before it."""
    k, count = np.int32(cuda.grid(1)), np.int32(position.size // SIZE)
    if k < count:
        p = load_quad(position, k)
        if p[3] > 0.0:
            older = load_quad(iterates, count + k)
            x, y, z = beyond(p[0], older[0], w), beyond(p[1], older[1], w), beyond(p[2], older[2], w)
            last = load_quad(iterates, k)
            store_quad(iterates, count + k, last[0], last[1], last[2], last[3])
            store_quad(iterates, k, x, y, z, 0.0)
            store_quad(position, k, x, y, z, p[3])


@inlined_routine
def points_of(position, corners, t):
    """Return the corners of tetrahedron t."""
    c = load_quad(corners, np.int32(t))
    return tuple(xyz(load_quad(position, c[n])) for n in unrolled(4))


@inlined_routine
def values_of(values, count, t):
    """Return the values of tetrahedron t of `count`, packed by quads.pack."""
    a, b = load_quad(values, np.int32(t)), load_quad(values, np.int32(count + t))
    c = load_quad(values, np.int32(2 * count + t))
    return (*a, *b, *c, values[np.uint32(np.int32(12 * count) + t)])


@inlined_routine
def strains_of(strains, count, t):
    """Return the strains of tetrahedron t of `count`."""
    return tuple(strains[np.uint32(np.int32(n * count) + t)] for n in unrolled(STRAINS))


@routine
def remember(before, arrays):
    """Write the strains of a material's tetrahedra at the start of a substep."""
    t, count = np.int32(cuda.grid(1)), np.int32(arrays.number)
    if t < count:
        strain = initial_strain(points_of(before, arrays.corners, t), values_of(arrays.values, count, t))
        for n in unrolled(STRAINS):
            arrays.strains[np.uint32(n * count + t)] = strain[n]


@routine
def start(before, velocity, inertial, position, arrays, stop, record):
    """Write the start of the iterations of the vertices before `stop` of the order, also pinned ones."""
    k = np.int32(cuda.grid(1))
    if k < stop:
        vertex = arrays.order[k]
        b, p = load_quad(before, vertex), load_quad(inertial, vertex)
        x, y, z = xyz(p)
        if arrays.falls[k] == 0:
            x, y, z = coasted(xyz(b), xyz(load_quad(velocity, vertex)), record[0].dt)
        store_quad(position, vertex, x, y, z, b[3])


@routine
def descend(before, inertial, position, arrays, first, stop, record, bodies, integers, time):
    """Visit the vertices `first` to before `stop` of the order, of one colour; `time`: arguments of `clock`."""
    parameters, strains = record[0], arrays.strains
    k, count = np.int32(first + cuda.grid(1)), np.int32(arrays.number)
    if k < stop:
        vertex, rate = arrays.order[k], parameters[RATE]
        sums = NO_SUMS
        for n in range(arrays.offsets[k], arrays.offsets[k + 1]):
            t, corner = arrays.entries[n] >> 2, arrays.entries[n] & np.int32(3)
            old = NO_STRAINS
            if FEATURE.damped:
                old = strains_of(strains, count, t)
            points = points_of(position, arrays.corners, t)
            sums = added(sums, element(points, values_of(arrays.values, count, t), old, corner, rate))
        if FEATURE.springs:
            x, y, z, hard, _ = pulled(vertex, position, arrays.springs)
            sums = added(sums, (x, y, z, hard, hard, hard, 0.0, 0.0, 0.0))
        p = load_quad(position, vertex)
        if FEATURE.colliders:
            counter, place, substeps, substep = time
            _, number = clock(counter, place, substeps, substep)
            world = World(parameters, bodies, integers)
            sums = add_contact(sums, load_quad(before, vertex), p, arrays.holds[vertex], world, number)
        x, y, z = moved(xyz(p), xyz(load_quad(inertial, vertex)), p[3], parameters[SCALE], sums)
        store_quad(position, vertex, x, y, z, p[3])


@cache
def make_accelerate(real: Real, math: str) -> Kernel:
    kernel = device_variant(real, math).copied(accelerate)
    return make_kernel(kernel, f"chebyshev_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_visits(real: Real, math: str, material: int, damped: bool, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `remember`, `start` and `descend`."""
    features = kernel_features(parts) | {"material": material, "damped": damped, "timed": knows_time(parts)}
    variant, kernels = device_variant(real, math, features), (remember, start, filled(descend, {"touch": collide}))
    return kernels_of(variant, math, kernels, f"descent_{variant_name(real, math)}")
