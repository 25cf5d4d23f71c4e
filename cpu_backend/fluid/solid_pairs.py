"""The neighbour sums of a fluid's density constraint with samples of solids, LANES particles at a time, for CPU threads
(model/fluid/plan.py, Solids). Arguments as in cpu_backend/fluid/pairs.py; `volume`, `grip`, `lightness`: of all
particles, in the order of cells."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.fluid.cells import make_row_of
from softlab.cpu_backend.fluid.quads import LANES
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_VISCOSITY
from softlab.model.formulas.fluid import density, solids


def make_solid_pairs(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `densities`, `gradients`, `corrections`, which add to their sums (0 at first), and `frictions`."""
    f, m = compiler.formulas(density, real), compiler.formulas(solids, real)
    squared, near, closeness, apart, slope = f.squared, f.near, f.closeness, f.apart, f.slope
    gradient_added, squares_added, crowded, correction_added = (
        f.gradient_added,
        f.squares_added,
        f.crowded,
        f.correction_added,
    )
    counted, counted_slope, carried = m.counted, m.counted_slope, m.carried
    both_of, rub, rub_added = m.both, m.rub, m.rub_added
    has_tensile, rubs, zero = "tensile" in parts, "viscosity" in parts, real(0)
    row_of = compiler.compiled(make_row_of(parts))

    @compiler.row
    def densities(many, entries, x, y, z, centre_x, centre_y, centre_z, inverse, volume, total):
        for k in range(many):
            for lane in range(LANES):
                j = entries[k * LANES + lane]
                t = closeness(squared(centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j]), inverse)
                total[lane] = counted(total[lane], volume[j], t)

    @compiler.row
    def gradients(
        many, first, entries, x, y, z, centre_x, centre_y, centre_z, support, inverse, scale, volume, lightness, gx, gy,
        gz, squares
    ):  # fmt: skip
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

    @compiler.row
    def corrections(
        many, first, entries, x, y, z, delta, volume, grip, centre_x, centre_y, centre_z, centre_delta, centre_volume,
        centre_grip, support, inverse, scale, tensile, inverse_tensile, ax, ay, az,
    ):  # fmt: skip
        for k in range(many):
            for lane in range(LANES):
                j = entries[k * LANES + lane]
                dx, dy, dz = centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j]
                dy = apart(dy, squared(dx, dy, dz), support, first + lane < j)
                square = squared(dx, dy, dz)
                s = slope(square, inverse, scale)
                both = both_of(centre_delta[lane], delta[j], centre_volume[lane], volume[j])
                if has_tensile:
                    alone = grip[j] + centre_grip[lane] == zero
                    both = both - (crowded(near(square, inverse), inverse_tensile, tensile) if alone else zero)
                ax[lane] = correction_added(ax[lane], both, s, dx)
                ay[lane] = correction_added(ay[lane], both, s, dy)
                az[lane] = correction_added(az[lane], both, s, dz)

    @compiler.compiled
    def frictions(i, many, entries, capacity, place, before, inverse, grip, lightness, fluid, fluids, x, y, z):
        """Return the sums x, y, z of particle i with the friction between it and the samples (or particles) near it."""
        if not rubs:
            return x, y, z
        viscosity_here = fluids[row_of(fluid, i) + F_VISCOSITY]
        wx, wy, wz = (
            place[i] - before[i],
            place[capacity + i] - before[capacity + i],
            place[2 * capacity + i] - before[2 * capacity + i],
        )
        for k in range(many):
            j = entries[k * LANES]
            if (grip[i] > zero) != (grip[j] > zero):
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

    return SimpleNamespace(densities=densities, gradients=gradients, corrections=corrections, frictions=frictions)
