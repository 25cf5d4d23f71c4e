"""Neighbour sums of a fluid's density constraint, LANES particles at a time, for CPU threads (model/fluid/plan.py, 4
and 5). Arguments: `many` entries of the slice's list, the quads of all particles, scratch for those of neighbours
(`numbers`), the planes of the slice's own (`centre`), Pairs of arrays.py, and the sums."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.fluid.cells import row_of
from softlab.cpu_backend.fluid.lists import wrap
from softlab.cpu_backend.fluid.quads import LANES, read_quads
from softlab.model.base.variant import FEATURE, row_routine
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid.density import (
    apart,
    closeness,
    correction_added,
    crowded,
    density_added,
    gradient_added,
    near,
    slope,
    squared,
    squares_added,
)


@row_routine
def densities(many, entries, quads, numbers, centre, pairs, total):
    (x, y, z, w), (centre_x, centre_y, centre_z), sides, inverse = numbers, centre, pairs.sides, pairs.inverse
    for k in range(many):
        read_quads(quads, entries, np.int64(k * LANES), x, y, z, w)
        for lane in range(LANES):
            dx, dy, dz = wrap(centre_x[lane] - x[lane], centre_y[lane] - y[lane], centre_z[lane] - z[lane], sides)
            total[lane] = density_added(total[lane], closeness(squared(dx, dy, dz), inverse))


@row_routine
def gradients(many, first, entries, quads, numbers, centre, pairs, fluid, fluids, sums):
    (x, y, z, w), (centre_x, centre_y, centre_z) = numbers, centre
    sides, support, inverse, scale, _, _ = pairs
    gx, gy, gz, squares, total = sums
    for k in range(many):
        read_quads(quads, entries, np.int64(k * LANES), x, y, z, w)
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            dx, dy, dz = wrap(centre_x[lane] - x[lane], centre_y[lane] - y[lane], centre_z[lane] - z[lane], sides)
            square = squared(dx, dy, dz)
            total[lane] = density_added(total[lane], closeness(square, inverse))
            dy = apart(dy, square, support, first + lane < j)
            square = squared(dx, dy, dz)
            s = slope(square, inverse, scale)
            gx[lane] = gradient_added(gx[lane], s, dx)
            gy[lane] = gradient_added(gy[lane], s, dy)
            gz[lane] = gradient_added(gz[lane], s, dz)
            weight = fluids[row_of(fluid, j) + F_WEIGHT] if FEATURE.fluids else 1.0
            squares[lane] = squares_added(squares[lane], weight, s, square)


@row_routine
def corrections(many, first, entries, quads, numbers, centre, centre_delta, pairs, sums):
    (x, y, z, w), (centre_x, centre_y, centre_z) = numbers, centre
    sides, support, inverse, scale, tensile, inverse_tensile = pairs
    ax, ay, az = sums
    for k in range(many):
        read_quads(quads, entries, np.int64(k * LANES), x, y, z, w)
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            dx, dy, dz = wrap(centre_x[lane] - x[lane], centre_y[lane] - y[lane], centre_z[lane] - z[lane], sides)
            dy = apart(dy, squared(dx, dy, dz), support, first + lane < j)
            square = squared(dx, dy, dz)
            s = slope(square, inverse, scale)
            both = centre_delta[lane] + w[lane]
            if FEATURE.tensile:
                both = both - crowded(near(square, inverse), inverse_tensile, tensile)
            ax[lane] = correction_added(ax[lane], both, s, dx)
            ay[lane] = correction_added(ay[lane], both, s, dy)
            az[lane] = correction_added(az[lane], both, s, dz)
