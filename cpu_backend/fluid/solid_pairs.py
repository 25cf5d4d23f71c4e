"""The neighbour sums of a fluid's density constraint with samples of solids, LANES particles at a time, for CPU threads
(model/fluid/plan.py, Solids). Arguments as in cpu_backend/fluid/pairs.py; `volume`, `grip`, `lightness`: of all
particles, in the order of cells."""

from __future__ import annotations

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import row_of
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.fluid.among_solids import K_GRIP, K_LIGHTNESS
from softlab.model.fluid.parameters import F_VISCOSITY
from softlab.model.formulas.fluid.density import (
    apart,
    closeness,
    correction_added,
    crowded,
    gradient_added,
    near,
    slope,
    squared,
    squares_added,
)
from softlab.model.formulas.fluid.solids import both as both_by_volumes
from softlab.model.formulas.fluid.solids import carried, counted, counted_slope, rub, rub_added


@row_routine
def densities(many, entries, place, centre, inverse, volume, total):
    (x, y, z), (centre_x, centre_y, centre_z) = place, centre
    for k in range(many):
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            t = closeness(squared(centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j]), inverse)
            total[lane] = counted(total[lane], volume[j], t)


@row_routine
def gradients(many, first, entries, place, centre, pairs, volume, lightness, sums):
    (x, y, z), (centre_x, centre_y, centre_z) = place, centre
    _, support, inverse, scale, _, _ = pairs
    gx, gy, gz, squares = sums
    for k in range(many):
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            dx, dy, dz = centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j]
            dy = apart(dy, squared(dx, dy, dz), support, first + lane < j)
            square = squared(dx, dy, dz)
            bare = slope(square, inverse, scale)
            s = counted_slope(volume[j], bare)
            gx[lane] = gradient_added(gx[lane], s, dx)
            gy[lane] = gradient_added(gy[lane], s, dy)
            gz[lane] = gradient_added(gz[lane], s, dz)
            squares[lane] = squares_added(squares[lane], carried(lightness[j], volume[j]), bare, square)


@row_routine
def corrections(many, first, entries, place, values, centre, centre_values, pairs, sums):
    """Add corrections; `values`: change of the multiplier, volume and grip of all particles."""
    (x, y, z), (centre_x, centre_y, centre_z) = place, centre
    (delta, volume, grip), (centre_delta, centre_volume, centre_grip) = values, centre_values
    _, support, inverse, scale, tensile, inverse_tensile = pairs
    ax, ay, az = sums
    for k in range(many):
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            dx, dy, dz = centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j]
            dy = apart(dy, squared(dx, dy, dz), support, first + lane < j)
            square = squared(dx, dy, dz)
            s = slope(square, inverse, scale)
            both = both_by_volumes(centre_delta[lane], delta[j], centre_volume[lane], volume[j])
            if FEATURE.tensile:
                alone = grip[j] + centre_grip[lane] == 0.0
                both = both - (crowded(near(square, inverse), inverse_tensile, tensile) if alone else 0.0)
            ax[lane] = correction_added(ax[lane], both, s, dx)
            ay[lane] = correction_added(ay[lane], both, s, dy)
            az[lane] = correction_added(az[lane], both, s, dz)


@routine
def frictions(i, entries, place, world, sums):
    """Return the sums of particle i with the friction between it and the samples (or particles) near it."""
    if not FEATURE.viscosity:
        return sums
    (x, y, z), capacity, before, fluid = sums, world.sizes.capacity, world.in_order.before, world.in_order.fluid
    fluids, inverse, kinds = world.fluids, world.parameters.inverse_support, world.solids.kinds
    grip, lightness = row_at(kinds, K_GRIP * capacity), row_at(kinds, K_LIGHTNESS * capacity)
    viscosity_here = fluids[row_of(fluid, i) + F_VISCOSITY]
    wx, wy, wz = (
        place[i] - before[i],
        place[capacity + i] - before[capacity + i],
        place[2 * capacity + i] - before[2 * capacity + i],
    )
    for k in range(world.lists.neighbours[i]):
        j = entries[k * LANES]
        if (grip[i] > 0.0) != (grip[j] > 0.0):
            dx, dy, dz = (
                place[i] - place[j],
                place[capacity + i] - place[capacity + j],
                place[2 * capacity + i] - place[2 * capacity + j],
            )
            t, its = near(squared(dx, dy, dz), inverse), fluids[row_of(fluid, j) + F_VISCOSITY]
            friction = rub(t, viscosity_here, its, lightness[i], lightness[j], grip[i], grip[j])
            x = rub_added(x, friction, wx, place[j] - before[j])
            y = rub_added(y, friction, wy, place[capacity + j] - before[capacity + j])
            z = rub_added(z, friction, wz, place[2 * capacity + j] - before[2 * capacity + j])
    return x, y, z
