"""Operations on each particle of a slice after a neighbour sum, LANES at a time, for CPU threads (model/fluid/plan.py,
4 and 5); and scratch rows for a slice."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.fluid.cells import row_of
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid.density import change, change_alone, constraint, moved, wall_added
from softlab.model.formulas.fluid.density import factor as factor_of

SUMS, NUMBERS = 6, 4  # rows of LANES for each band: sums, or a position and a velocity; and quads of neighbours
SCRATCH = SUMS + NUMBERS
SINGLE_BLOCKS, DOUBLE_BLOCKS = LANES // block_of(np.float32), LANES // block_of(np.float64)  # of a slice, by precision


@routine
def sums_of(part, scratch):
    """Return the SUMS rows of a band, in sequence."""
    at = np.int64(part) * (SCRATCH * LANES)
    return (
        row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES),
        row_at(scratch, at + 3 * LANES), row_at(scratch, at + 4 * LANES), row_at(scratch, at + 5 * LANES),
    )  # fmt: skip


@routine
def numbers_of(part, scratch):
    """Return the NUMBERS further rows of a band."""
    at = np.int64(part) * (SCRATCH * LANES) + SUMS * LANES
    return (
        row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES),
        row_at(scratch, at + 3 * LANES),
    )  # fmt: skip


@routine
def vector_at(plane, capacity, base):
    """Return the three planes of a slice's own particles."""
    return row_at(plane, base), row_at(plane, capacity + base), row_at(plane, 2 * capacity + base)


@row_routine
def factor_rows(relaxation, softness, fluid, fluids, sums, wall, factor, multiplier):
    (gx, gy, gz, squares), (wx, wy, wz) = sums, wall
    for lane in range(LANES):
        weight = fluids[row_of(fluid, lane) + F_WEIGHT]
        x, y, z = 0.0, 0.0, 0.0
        if FEATURE.walls:
            x, y, z = wx[lane], wy[lane], wz[lane]
        factor[lane] = factor_of(relaxation, weight, gx[lane], gy[lane], gz[lane], squares[lane], x, y, z, softness)
        multiplier[lane] = 0.0


@row_routine
def relax_rows(lattice_sum, scale, total, wall_part, factor, multiplier, delta, error):
    """Write the constraints, as errors, and the changes of multipliers."""
    for lane in range(LANES):
        c = constraint(total[lane], lattice_sum, scale, wall_part[lane] if FEATURE.walls else 0.0)
        error[lane] = c
        delta[lane] = change_alone(factor[lane], c) if FEATURE.averaged else change(multiplier[lane], factor[lane], c)
        multiplier[lane] = multiplier[lane] + delta[lane]


@row_routine
def move_rows(fluid, fluids, delta, wall, place, sums):
    """Compute positions from the corrections a, and set v to 0; `sums`: a and v."""
    (wx, wy, wz), (px, py, pz), (ax, ay, az, vx, vy, vz) = wall, place, sums
    for lane in range(LANES):
        x, y, z, weight = ax[lane], ay[lane], az[lane], fluids[row_of(fluid, lane) + F_WEIGHT]
        if FEATURE.walls:
            x, y = wall_added(x, delta[lane], wx[lane]), wall_added(y, delta[lane], wy[lane])
            z = wall_added(z, delta[lane], wz[lane])
        ax[lane], ay[lane] = moved(px[lane], weight, x), moved(py[lane], weight, y)
        az[lane] = moved(pz[lane], weight, z)
        vx[lane], vy[lane], vz[lane] = 0.0, 0.0, 0.0
