"""CUDA kernels of the position-based solvers over the whole sheet: one launch for each part of a substep.

A thread is a mass of a two-dimensional block, or, in a colour of Gauss-Seidel, a constraint: no two of a colour share a
mass, so constraints move their ends in place without locks. Multipliers are stored in planes of one number per mass:
one plane for each family of constraints, by (i, j), or for Jacobi one for each constraint of a mass.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import predict, settle
from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.sheet import BLOCK, lattice_place
from softlab.gpu_backend.core.wind import block_air
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.position_based.constraints import compliant, constants_of, family_features, pair
from softlab.gpu_backend.position_based.gather import TWO, arrive, displacement, displacement_of, valence_of, weight_of
from softlab.gpu_backend.position_based.point import accelerate, tether_mass
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, filled, routine
from softlab.model.position_based.plan import Family, families


def compact_shape(family: Family, rows: int, columns: int) -> tuple[int, int]:
    """Return (rows, columns) of the lattice of threads that covers a colour: half the sheet, in whole strides."""
    if family.rows:
        return family.rows * -(-rows // (2 * family.rows)), columns
    return rows, family.columns * -(-columns // (2 * family.columns))


def blocks_over(rows: int, columns: int) -> tuple[int, int]:
    """Return (across, down): blocks of threads, so that each of rows x columns has a thread."""
    return -(-columns // BLOCK[0]), -(-rows // BLOCK[1])


def multiplier_planes(parts: frozenset[str]) -> int:
    """Return the number of multipliers per mass in device memory."""
    soft = [family for family in families(parts) if compliant(parts, family)]
    if "gauss-seidel" in parts:
        return len(soft)
    return 4 * len({family.kind for family in soft})


@routine
def begin(position, velocity, predicted, record, integers, counter, place, substeps, substep, rows, columns):
    """Predict the positions that constraints start from, from the state at the start of the substep."""
    parameters = record[0]
    i, j = lattice_place()
    rows, columns = np.int32(rows), np.int32(columns)
    step, number = clock(counter, place, substeps, substep)
    air = block_air(parameters, integers, number, 0.0)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = accelerate(position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, integers, step, air)
        x, y, z = predict(p, v, ax, ay, az, parameters)
        spare = p[3]
        if FEATURE.jacobi or FEATURE.averaged_jacobi:
            spare = weight_of(valence_of(Cell(i, j, rows, columns)), spare)
        store_quad(predicted, k, x, y, z, spare)


@cache
def make_begin(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile `begin`."""
    variant, kernel = device_variant(real, math, particle_features(parts, axes)), with_forces(begin, parts)
    return kernels_of(variant, math, [kernel], f"xpbd_{variant_name(real, math, axes, parts)}").begin


@routine
def project(position, before, multipliers, plane, fresh, record, rows, columns):
    """Project all constraints of a colour.

    `plane`: the number of the family's plane of multipliers, which count as 0 if `fresh`, in a substep's first
    iteration.
    """
    parameters = record[0]
    i, j = lattice_place()
    rows, columns = np.int32(rows), np.int32(columns)
    down, along, colour = np.int32(FEATURE.rows_down), np.int32(FEATURE.columns_along), np.int32(FEATURE.colour)
    if FEATURE.rows_down > 0:
        i = np.int32(TWO * down * (i // down) + i % down + down * colour)
    else:
        j = np.int32(TWO * along * (j // along) + j % along + along * colour)
    if i + down < rows and j + along < columns:
        k = np.int32(i * columns + j)
        first, second = k, np.int32(k + down * columns + along)
        if FEATURE.rising:
            first, second = np.int32(k + along), np.int32(k + down * columns)
        multiplier = 0.0
        at = np.int64(plane) * rows * columns + k
        if FEATURE.soft and not fresh:
            multiplier = multipliers[at]
        multiplier = pair(position, before, first, second, multiplier, constants_of(parameters))
        if FEATURE.soft:
            multipliers[at] = multiplier


@cache
def make_colour(
    real: Real, math: str, parts: frozenset[str], family: Family, colour: int | np.int32, axes: int
) -> Kernel:
    """Compile `project` for a colour of a family."""
    variant = device_variant(real, math, family_features(parts, family, int(colour), axes))
    name = f"{family.name}_{colour}_{variant_name(real, math, axes, parts)}"
    return kernels_of(variant, math, [project], f"xpbd_{name}".replace("-", "_")).project


@routine
def project_all(position, before, target, multipliers, fresh, record, rows, columns):
    """Do one Jacobi iteration."""
    parameters = record[0]
    i, j = lattice_place()
    rows, columns = np.int32(rows), np.int32(columns)
    if i < rows and j < columns:
        k, count = np.int32(i * columns + j), np.int64(rows) * columns
        if fresh:
            for slot in range(FEATURE.multipliers):
                multipliers[slot * count + k] = 0.0
        p, old = load_quad(position, k), load_quad(before, k)
        constants = constants_of(parameters)
        pulling = position, before, np.int32(0), p, old, multipliers, np.int64(k), count, constants
        total = displacement(k, columns, Cell(i, j, rows, columns), pulling)
        x, y, z = arrive(p, old[3], total, valence_of(Cell(i, j, rows, columns)))
        store_quad(target, k, x, y, z, p[3])


@cache
def make_jacobi(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile `project_all`."""
    kernel = filled(project_all, {"displacement": displacement_of(real, math, parts, axes)})
    variant = device_variant(real, math, features_of(parts) | {"axes": axes, "multipliers": multiplier_planes(parts)})
    return kernels_of(variant, math, [kernel], f"xpbd_{variant_name(real, math, axes, parts)}").project_all


@routine
def attach(position, before, anchors, reaches, count):
    """Apply the `count` long-range attachments of every mass; its weight is read in `before`."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        x, y, z = tether_mass(p, load_quad(before, k)[3], before, anchors, reaches, np.int64(k) * count, count)
        store_quad(position, k, x, y, z, p[3])


@cache
def make_attach(real: Real, math: str) -> Kernel:
    """Compile `attach`."""
    return kernels_of(device_variant(real, math), math, [attach], f"xpbd_{variant_name(real, math)}").attach


@routine
def end(before, position, velocity, record, bodies, integers, counter, place, substeps, substep):
    """Compute the velocities of a substep, then its colliders."""
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p = load_quad(before, k), load_quad(position, k)
        px, py, pz, vx, vy, vz = settle(b, p, world, number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_end(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile `end`."""
    variant = device_variant(real, math, particle_features(parts, axes))
    return kernels_of(variant, math, [end], f"xpbd_{variant_name(real, math, axes, parts)}").end


@routine
def write_position(position, out):
    """Write both axes of a grid's quads, for drawing."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        out[k, 0] = p[0]
        out[k, 1] = p[1]


@cache
def make_plane_tools(real: Real) -> SimpleNamespace:
    """Compile `write_position`."""
    variant = device_variant(real, "exact")
    return kernels_of(variant, "exact", [write_position], f"xpbd_{variant_name(real)}")
