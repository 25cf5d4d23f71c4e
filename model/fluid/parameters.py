"""Constants for a fluid's kernels: one record, and a row for each fluid of the scene."""

from __future__ import annotations

from math import floor, prod

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.types import Real
from softlab.model.core.own_forces import force_fields, force_values
from softlab.model.core.parameters import rounded_record
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import REPEATED, WIDER, Fluid

AXES = "xyz"
BOX = ("low", "high", "side", "half", "cells", "inverse_side")  # of an axis that repeats; the last one: cells per metre
MAX_NEIGHBOURS = {2: 24, 3: 64}  # of a particle, by dimensions
CELLS_EACH = 8  # cells of a table for each particle, at most; cells are enlarged where more would be needed
FEWEST_CELLS = 4096  # smallest value of that limit
MOST_SMOOTHED = 1.0  # of XSPH: beyond it velocities overshoot

FLUID_PARAMETERS = (
    "dt",  # of a substep, s
    "inverse_dt",
    "first_step",  # origin of time, a substep number,
    "first_time",  # and that substep's time, s
    "gravity",  # m/s^2, along +y (so negative)
    "support",  # m
    "inverse_support",
    "lattice_sum",  # see model/particles/fluid_lattice.py
    "density_scale",
    "gradient_scale",
    "wall_scale",
    "wall_gradient",
    "inverse_wall",  # 1/m, of the range of walls
    "relaxation",
    "softness",  # 1/m^2
    "tensile",  # m^2
    "inverse_tensile",  # 1 / (1 - q^2) where the tensile correction has that strength
    "inverse_cell",  # 1/m, of an axis that does not repeat
    "sampled",  # index of the fluid of solids' samples: the number of fluids
    *(f"{what}_{axis}" for axis in AXES for what in BOX),  # of an axis that repeats, else 0
)
FIELDS = {"dt": "method.dt", "gravity": "gravity.acceleration", **force_fields()}

# Row of a fluid:
FLUID_FIELDS = 10
(
    F_WEIGHT,  # inverse mass of its particles, relative to the first fluid
    F_BUOYANCY,  # of gravity
    F_VISCOSITY,  # XSPH's coefficient times the density's scale
    F_COHESION,  # m/s per substep
    F_TENSION,  # m^2/s per substep
    F_CONFINEMENT,  # m per substep
    F_DRAG,  # 1/s
    F_SURFACE_DRAG,  # 1/s
    F_SPEED,  # m/s
    F_CHANGE,  # m/s: largest change of a velocity by neighbours and walls in a substep; of two solves half of it each
) = range(FLUID_FIELDS)


def speed_limit(scene: Scene, part: Fluid) -> float:
    """Return the speed limit of a fluid's particles [m/s]: half a support per substep, or its stated maximum if that is
    smaller."""
    return part.speed_limit(scene.method.dt / scene.method.substeps)


def smoothing(scene: Scene, part: Fluid) -> float:
    """Return XSPH's coefficient for a fluid's viscosity: nu h / (half the kernel's second moment), at most
    MOST_SMOOTHED."""
    h, spread = scene.method.dt / scene.method.substeps, scene.fluid_set.lattice.spread
    return min(part.viscosity / part.density * h / spread, MOST_SMOOTHED)


def highest_viscosity(scene: Scene, part: Fluid) -> float:
    """Return the largest viscosity [Pa s] that XSPH can represent at this substep."""
    spread = scene.fluid_set.lattice.spread
    return MOST_SMOOTHED * spread * part.density * scene.method.substeps / scene.method.dt


def fluid_record(
    scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START
) -> np.ndarray:
    """Return the constants of forces on single particles, then FLUID_PARAMETERS, (1,), in the arithmetic `real`.

    Computed in float64, rounded once. In this order a plane's record is not a prefix of one in space, for which numba
    would take it, with a warning. Raises SceneError.
    """
    method, fluids = scene.method, scene.fluid_set
    h, lattice, support = method.dt / method.substeps, fluids.lattice, fluids.support
    values = {
        "dt": h,
        "inverse_dt": 1 / h,
        **clock.values(h, method.substeps),
        "gravity": -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0,
        "support": support,
        "inverse_support": 1 / support,
        "lattice_sum": lattice.kernel_sum,
        "density_scale": lattice.density_scale,
        "gradient_scale": lattice.gradient_scale,
        "wall_scale": lattice.wall_scale,
        "wall_gradient": lattice.wall_gradient,
        "inverse_wall": 1 / lattice.wall_range,
        "relaxation": method.relaxation_factor / (lattice.neighbours if method.scheme == "averaged" else 1),
        "softness": method.softness / support**2,
        "tensile": method.tensile_correction * support**2,
        "inverse_tensile": 1 / (1 - method.tensile_distance**2),
        "inverse_cell": 1 / (WIDER * support),
        "sampled": float(len(fluids.parts)),
        **_box(scene),
    }
    assert tuple(values) == FLUID_PARAMETERS, f"{set(values) ^ set(FLUID_PARAMETERS)} or their order differ"
    axes = scene.dimensions
    return rounded_record(scene, force_values(scene, poke[:axes], axes) | values, FIELDS, real)


def _box(scene: Scene) -> dict[str, float]:
    """Return the ends [m], length, half length and number of cells of each axis that repeats; 0 for other axes."""
    values = {f"{what}_{axis}": 0.0 for axis in AXES for what in BOX}
    domain = scene.domain
    for axis in domain.repeats if domain else ():
        assert domain is not None
        low, side = domain.origin[AXES.index(axis)], domain.size[AXES.index(axis)]
        cells = max(REPEATED, floor(side / (WIDER * scene.fluid_set.support)))
        ends = low, low + side, side, side / 2, float(cells), cells / side
        numbers = dict(zip(BOX, ends, strict=True))
        values |= {f"{what}_{axis}": number for what, number in numbers.items()}
    return values


def fluid_rows(scene: Scene, real: Real, solids: bool = False) -> np.ndarray:
    """Return the rows of fluids, (fluids, FLUID_FIELDS), in the arithmetic `real`, in the order of the scene.

    With `solids` there is one more, of their samples, which have no effect of their own.
    """
    fluids: FluidSet = scene.fluid_set
    h, rows = scene.method.dt / scene.method.substeps, np.zeros((len(fluids.parts) + solids, FLUID_FIELDS))
    free, solves = np.finfo(real).max / 4, 2 if scene.method.scheme == "divergence-free" else 1
    rows[:, F_SPEED], rows[:, F_CHANGE] = free, free
    for row, part, weight in zip(rows, fluids.parts, fluids.lightness, strict=False):
        row[F_WEIGHT], row[F_BUOYANCY] = weight, part.buoyancy
        row[F_VISCOSITY] = smoothing(scene, part) * fluids.lattice.smoothing_scale
        row[F_COHESION] = h * part.cohesion / (fluids.parts[0].density * fluids.support**2)
        row[F_TENSION] = h * part.surface_tension / (fluids.parts[0].density * fluids.support)
        row[F_CONFINEMENT] = h * part.vorticity_confinement
        row[F_DRAG], row[F_SURFACE_DRAG] = part.drag, part.free_surface_drag
        row[F_SPEED] = speed_limit(scene, part)
        row[F_CHANGE] = h * part.maximum_acceleration / solves if part.maximum_acceleration else free
    return rows.astype(real)


def most_cells(scene: Scene) -> int:
    """Return the largest number of cells of a table: for the number of particles, and at least for the axes that
    repeat."""
    repeated = prod(int(cells) or 1 for name, cells in _box(scene).items() if name.startswith("cells"))
    return max(CELLS_EACH * scene.fluid_set.particle_count, FEWEST_CELLS, repeated)
