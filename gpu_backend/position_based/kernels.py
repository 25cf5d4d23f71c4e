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

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.sheet import BLOCK, make_place
from softlab.gpu_backend.core.wind import make_block_air
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.position_based.constraints import compliant, make_constants, make_pair
from softlab.gpu_backend.position_based.gather import make_gather
from softlab.gpu_backend.position_based.point import make_accelerations, make_tethers
from softlab.model.base.types import Real
from softlab.model.position_based.plan import JACOBI, Family, families


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


@cache
def make_begin(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile begin(position, velocity, predicted, record, integers, counter, place, substeps, substep, rows, columns):
    it predicts the positions that constraints start from, from the state at the start of the substep."""
    accelerate = make_accelerations(real, math, parts).accelerate
    predict, gather = make_motion(real, math, parts, axes).predict, make_gather(real, math, parts, axes)
    valence_of, weight_of = gather.valence_of, gather.weight_of
    clock, lattice, block_air = make_clock(math, parts), make_place(math), make_block_air(real, math, parts)
    has_valences, zero = bool(parts & JACOBI), real(0)

    def begin(
        position, velocity, predicted, record, integers, counter, place, substeps, substep, rows, columns
    ):  # fmt: skip
        parameters = record[0]
        i, j = lattice()
        rows, columns = np.int32(rows), np.int32(columns)
        step, number = clock(counter, place, substeps, substep)
        air = block_air(parameters, integers, number, zero)
        if i < rows and j < columns:
            k = np.int32(i * columns + j)
            p, v = load_quad(position, k), load_quad(velocity, k)
            ax, ay, az = accelerate(
                position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, integers, step, air
            )
            x, y, z = predict(p, v, ax, ay, az, parameters)
            spare = p[3]
            if has_valences:
                spare = weight_of(valence_of(Cell(i, j, rows, columns)), spare)
            store_quad(predicted, k, x, y, z, spare)

    return make_kernel(begin, f"xpbd_{variant_name(real, math, axes, parts)}", **kernel_options(math))


@cache
def make_colour(
    real: Real, math: str, parts: frozenset[str], family: Family, colour: int | np.int32, axes: int
) -> Kernel:
    """Compile project(position, before, multipliers, plane, fresh, record, rows, columns): all constraints of a colour.

    `plane`: the number of the family's plane of multipliers, which count as 0 if `fresh`, in a substep's first
    iteration.
    """
    pair, constants = make_pair(real, math, parts, family, colour, axes), make_constants(math)
    lattice, has_multiplier = make_place(math), compliant(parts, family)
    down, along, rising = np.int32(family.rows), np.int32(abs(family.columns)), family.columns < 0
    by_rows, two, colour = family.rows > 0, np.int32(2), np.int32(colour)
    zero = real(0)

    def project(position, before, multipliers, plane, fresh, record, rows, columns):
        parameters = record[0]
        i, j = lattice()
        rows, columns = np.int32(rows), np.int32(columns)
        if by_rows:
            i = np.int32(two * down * (i // down) + i % down + down * colour)
        else:
            j = np.int32(two * along * (j // along) + j % along + along * colour)
        if i + down < rows and j + along < columns:
            k = np.int32(i * columns + j)
            first, second = k, np.int32(k + down * columns + along)
            if rising:
                first, second = np.int32(k + along), np.int32(k + down * columns)
            multiplier = zero
            at = np.int64(plane) * rows * columns + k
            if has_multiplier and not fresh:
                multiplier = multipliers[at]
            multiplier = pair(position, before, first, second, multiplier, constants(parameters))
            if has_multiplier:
                multipliers[at] = multiplier

    name = f"{family.name}_{colour}_{variant_name(real, math, axes, parts)}"
    return make_kernel(project, f"xpbd_{name}".replace("-", "_"), **kernel_options(math))


@cache
def make_jacobi(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile project_all(position, before, target, multipliers, fresh, record, rows, columns): one Jacobi
    iteration."""
    jacobi, constants = make_gather(real, math, parts, axes), make_constants(math)
    gather, arrive, valence_of = jacobi.gather, jacobi.arrive, jacobi.valence_of
    lattice, slots = make_place(math), multiplier_planes(parts)
    zero, nothing = real(0), np.int32(0)

    def project_all(position, before, target, multipliers, fresh, record, rows, columns):
        parameters = record[0]
        i, j = lattice()
        rows, columns = np.int32(rows), np.int32(columns)
        if i < rows and j < columns:
            k, count = np.int32(i * columns + j), np.int64(rows) * columns
            if fresh:
                for slot in range(slots):
                    multipliers[slot * count + k] = zero
            p, old = load_quad(position, k), load_quad(before, k)
            total = gather(
                position, before, k, nothing, columns, Cell(i, j, rows, columns), p, old, multipliers, np.int64(k), count,
                constants(parameters),
            )  # fmt: skip
            x, y, z = arrive(p, old[3], total, valence_of(Cell(i, j, rows, columns)))
            store_quad(target, k, x, y, z, p[3])

    return make_kernel(project_all, f"xpbd_{variant_name(real, math, axes, parts)}", **kernel_options(math))


@cache
def make_attach(real: Real, math: str) -> Kernel:
    """Compile attach(position, before, anchors, reaches, count): the `count` long-range attachments of every mass; its
    weight is read in `before`."""
    tether_mass = make_tethers(real, math)

    def attach(position, before, anchors, reaches, count):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p = load_quad(position, k)
            x, y, z = tether_mass(p, load_quad(before, k)[3], before, anchors, reaches, np.int64(k) * count, count)
            store_quad(position, k, x, y, z, p[3])

    return make_kernel(attach, f"xpbd_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_end(real: Real, math: str, parts: frozenset[str], axes: int) -> Kernel:
    """Compile end(before, position, velocity, record, bodies, integers, counter, place, substeps, substep): velocities
    of a substep, then its colliders."""
    settle, clock = make_motion(real, math, parts, axes).settle, make_clock(math, parts)
    zero = real(0)

    def end(before, position, velocity, record, bodies, integers, counter, place, substeps, substep):
        world = World(record[0], bodies, integers)
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            _, number = clock(counter, place, substeps, substep)
            b, p = load_quad(before, k), load_quad(position, k)
            px, py, pz, vx, vy, vz = settle(b, p, world, number)
            store_quad(position, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    return make_kernel(end, f"xpbd_{variant_name(real, math, axes, parts)}", **kernel_options(math))


@cache
def make_plane_tools(real: Real) -> SimpleNamespace:
    """Compile `write_position(position, out)`: both axes of a grid's quads, for drawing."""

    def write_position(position, out):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p = load_quad(position, k)
            out[k, 0] = p[0]
            out[k, 1] = p[1]

    return SimpleNamespace(write_position=make_kernel(write_position, f"xpbd_{variant_name(real)}"))
