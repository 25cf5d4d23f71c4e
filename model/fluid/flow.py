"""Tables of emitters and sinks for kernels, and their checks."""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.scene.checks.flow import fluid_of
from softlab.model.scene.scene import Scene
from softlab.model.tables.flow import NEVER, spatial

# Row of an emitter:
EMITTER_FIELDS = 14
(
    E_FIRST,  # index of its first point among those of all nozzles,
    E_COUNT,  # number of its points
    E_FLUID,  # index of its fluid
    E_X,  # unit direction
    E_Y,
    E_Z,
    E_VX,  # m/s
    E_VY,
    E_VZ,
    E_DISTANCE,  # m, between layers
    E_RATE,  # layers/s
    E_SINCE,  # s: since when it has that rate,
    E_BEFORE,  # and the layers that had passed by then
    E_STOP,  # s
) = range(EMITTER_FIELDS)

# Row of a sink:
SINK_FIELDS = 8
(
    S_KIND,  # index into SINK_SHAPES
    S_X,  # centre, or a point of the plane, m
    S_Y,
    S_Z,
    S_U,  # half edges [m], or the normal
    S_V,
    S_W,
    S_RADIUS,
) = range(SINK_FIELDS)
SINK_SHAPES = ("box", "sphere", "half-space")


def emitter_rows(scene: Scene, emitter_state: np.ndarray, real: Real) -> np.ndarray:
    """Return the rows of emitters, (emitters, EMITTER_FIELDS), in the arithmetic `real`, in the order of the file."""
    rows, first, fluids = np.zeros((len(scene.emitters), EMITTER_FIELDS)), 0, scene.fluid_set
    for row, (name, part), state in zip(rows, scene.emitters.items(), emitter_state, strict=True):
        row[E_FIRST], row[E_COUNT] = first, len(part.nozzle(fluids.spacing, fluids.dimensions))
        first += int(row[E_COUNT])
        along = part.unit_direction
        row[E_FLUID], row[E_X : E_Z + 1], row[E_VX : E_VZ + 1] = fluid_of(scene, name), along, part.speed * along
        row[E_DISTANCE], row[E_RATE], row[E_SINCE : E_BEFORE + 1] = fluids.spacing, part.speed / fluids.spacing, state
        row[E_STOP] = NEVER if part.stop is None else part.stop
    return rows.astype(real)


def sink_rows(scene: Scene, real: Real) -> np.ndarray:
    """Return the rows of sinks, (sinks, SINK_FIELDS), in the arithmetic `real`, in the order of the file."""
    rows = np.zeros((len(scene.sinks), SINK_FIELDS))
    for row, part in zip(rows, scene.sinks.values(), strict=True):
        row[S_KIND] = SINK_SHAPES.index(part.shape)
        row[S_X : S_Z + 1] = spatial(part.point if part.shape == "half-space" else part.center)
        if part.shape == "half-space":
            row[S_U : S_W + 1] = spatial(part.normal)
        elif part.shape == "box":
            row[S_U : S_W + 1] = [*part.half_size, NEVER][:3]
        row[S_RADIUS] = part.radius
    return rows.astype(real)


def fluid_starts(scene: Scene) -> np.ndarray:
    """Return the number of each fluid's first particle, then the number of particles, (fluids + 1,) int64."""
    fluids = scene.fluid_set
    return np.searchsorted(fluids.fluid, np.arange(len(fluids.parts) + 1)).astype(np.int64)


def rates(scene: Scene, name: str) -> tuple[float, float, int]:
    """Return (m^3/s, particles/s, points of the nozzle) of an emitter at its speed; a plane has a layer one metre
    thick."""
    part = scene.emitters[name]
    fluids = scene.fluid_set
    points = len(part.nozzle(fluids.spacing, fluids.dimensions))
    each_second = points * part.speed / fluids.spacing
    return each_second * fluids.lattice.volume, each_second, points
