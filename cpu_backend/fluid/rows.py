"""Operations on each particle of a slice after a neighbour sum, LANES at a time, for CPU threads (model/fluid/plan.py,
4 and 5); and scratch rows for a slice."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import make_row_of
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid import density

SUMS, NUMBERS = 6, 4  # rows of LANES for each band: sums, or a position and a velocity; and quads of neighbours
SCRATCH = SUMS + NUMBERS


def make_scratch(compiler: Compiler) -> SimpleNamespace:
    """Make views of scratch and planes.

    `sums_of(part, scratch)`: the SUMS rows of a band, in sequence. `numbers_of(part, scratch)`: its NUMBERS further
    rows. `vector_at(plane, capacity, base)`: the three planes of a slice's own particles.
    """

    @compiler.compiled
    def sums_of(part, scratch):
        at = np.int64(part) * (SCRATCH * LANES)
        return (
            row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES),
            row_at(scratch, at + 3 * LANES), row_at(scratch, at + 4 * LANES), row_at(scratch, at + 5 * LANES),
        )  # fmt: skip

    @compiler.compiled
    def numbers_of(part, scratch):
        at = np.int64(part) * (SCRATCH * LANES) + SUMS * LANES
        return (
            row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES),
            row_at(scratch, at + 3 * LANES),
        )  # fmt: skip

    @compiler.compiled
    def vector_at(plane, capacity, base):
        return row_at(plane, base), row_at(plane, capacity + base), row_at(plane, 2 * capacity + base)

    return SimpleNamespace(sums_of=sums_of, numbers_of=numbers_of, vector_at=vector_at)


def make_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `factors`, `relax` and `move`.

    `factors(relaxation, softness, fluid, fluids, gx, gy, gz, squares, wx, wy, wz, factor, multiplier)`. `relax(lattice_sum,
    scale, total, wall_part, factor, multiplier, delta, error)`: constraints and changes of multipliers. `move(fluid,
    fluids, delta, wx, wy, wz, px, py, pz, ax, ay, az, vx, vy, vz)`: turn the corrections a into positions, and set v to
    0.
    """
    f, averaged, has_walls = compiler.formulas(density, real), "averaged" in parts, "walls" in parts
    constraint, change, change_alone, factor_of = f.constraint, f.change, f.change_alone, f.factor
    wall_added, moved = f.wall_added, f.moved
    row_of, zero = compiler.compiled(make_row_of(parts)), real(0)

    @compiler.row
    def factors(relaxation, softness, fluid, fluids, gx, gy, gz, squares, wx, wy, wz, factor, multiplier):
        for lane in range(LANES):
            weight = fluids[row_of(fluid, lane) + F_WEIGHT]
            x, y, z = zero, zero, zero
            if has_walls:
                x, y, z = wx[lane], wy[lane], wz[lane]
            factor[lane] = factor_of(relaxation, weight, gx[lane], gy[lane], gz[lane], squares[lane], x, y, z, softness)
            multiplier[lane] = zero

    @compiler.row
    def relax(lattice_sum, scale, total, wall_part, factor, multiplier, delta, error):
        for lane in range(LANES):
            c = constraint(total[lane], lattice_sum, scale, wall_part[lane] if has_walls else zero)
            error[lane] = c
            delta[lane] = change_alone(factor[lane], c) if averaged else change(multiplier[lane], factor[lane], c)
            multiplier[lane] = multiplier[lane] + delta[lane]

    @compiler.row
    def move(fluid, fluids, delta, wx, wy, wz, px, py, pz, ax, ay, az, vx, vy, vz):
        for lane in range(LANES):
            x, y, z, weight = ax[lane], ay[lane], az[lane], fluids[row_of(fluid, lane) + F_WEIGHT]
            if has_walls:
                x, y = wall_added(x, delta[lane], wx[lane]), wall_added(y, delta[lane], wy[lane])
                z = wall_added(z, delta[lane], wz[lane])
            ax[lane], ay[lane] = moved(px[lane], weight, x), moved(py[lane], weight, y)
            az[lane] = moved(pz[lane], weight, z)
            vx[lane], vy[lane], vz[lane] = zero, zero, zero

    return SimpleNamespace(factors=factors, relax=relax, move=move)
