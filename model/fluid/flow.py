"""Tables of emitters and sinks for kernels, and their checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.errors import SceneError
from softlab.model.geometry.arithmetic.ordered import dot, norm
from softlab.model.scene.cloth import COLLIDER_KINDS
from softlab.model.scene.flow import NEVER, Emitter, spatial

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


def fluid_of(scene: Any, name: str) -> int:
    """Return the index of an emitter's fluid. Raises SceneError."""
    names, part = list(scene.fluids), scene.parts[name]
    if part.fluid is None:
        return 0
    if part.fluid not in names:
        raise SceneError(f"{name}.fluid", part.fluid, f"must be one of {', '.join(names)}")
    return names.index(part.fluid)


def emitter_rows(scene: Any, taps: np.ndarray, real: type) -> np.ndarray:
    """Return the rows of emitters, (emitters, EMITTER_FIELDS), in the arithmetic `real`, in the order of the file."""
    rows, first, found = np.zeros((len(scene.emitters), EMITTER_FIELDS)), 0, scene.fluid_set
    for row, (name, part), tap in zip(rows, scene.emitters.items(), taps, strict=True):
        row[E_FIRST], row[E_COUNT] = first, len(part.nozzle(found.spacing, found.dimensions))
        first += int(row[E_COUNT])
        row[E_FLUID], row[E_X : E_Z + 1], row[E_VX : E_VZ + 1] = fluid_of(scene, name), part.way, part.speed * part.way
        row[E_DISTANCE], row[E_RATE], row[E_SINCE : E_BEFORE + 1] = found.spacing, part.speed / found.spacing, tap
        row[E_STOP] = NEVER if part.stop is None else part.stop
    return rows.astype(real)


def sink_rows(scene: Any, real: type) -> np.ndarray:
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


def fluid_starts(scene: Any) -> np.ndarray:
    """Return the number of each fluid's first particle, then the number of particles, (fluids + 1,) int64."""
    found = scene.fluid_set
    return np.searchsorted(found.fluid, np.arange(len(found.parts) + 1)).astype(np.int64)


def rates(scene: Any, name: str) -> tuple[float, float, int]:
    """Return (m^3/s, particles/s, points of the nozzle) of an emitter at its speed; a plane has a layer one metre
    thick."""
    part: Emitter = scene.parts[name]
    found = scene.fluid_set
    points = len(part.nozzle(found.spacing, found.dimensions))
    each_second = points * part.speed / found.spacing
    return each_second * found.lattice.volume, each_second, points


def check_flow(scene: Any) -> None:
    """Raise SceneError for an emitter without particles, too fast, or in a collider or a sink, for a capacity without
    an emitter, and for a sink of other dimensions."""
    axes, emptied = scene.dimensions, bool(scene.sinks)
    if (scene.emitters or emptied) and scene.method.scheme == "divergence-free":
        told = "is not supported together with emitters and sinks; use macklin or averaged"
        raise SceneError("method.scheme", scene.method.scheme, told)
    for name, sink in scene.sinks.items():
        for field in ("center", "point", "normal"):
            if axes == 2 and len(getattr(sink, field)) == 3 and getattr(sink, field)[2] != 0:
                raise SceneError(f"{name}.{field}", list(getattr(sink, field)), "must lie in the plane z = 0")
    given = set()
    for name, part in scene.emitters.items():
        number = fluid_of(scene, name)
        fluid_name, fluid = list(scene.fluids.items())[number]
        given.add(number)
        for field in ("center", "direction"):
            vector = getattr(part, field)
            if len(vector) == 3 and axes == 2 and vector[2] != 0:
                raise SceneError(f"{name}.{field}", list(vector), "must lie in the plane z = 0 in 2 dimensions")
        _check_nozzle(scene, name, part, fluid.rest_distance)
        limit = fluid.speed_limit(scene.method.dt / scene.method.substeps)
        if part.speed > limit:
            told = f"must be at most {limit:.4g} m/s, half a support a substep, or the fluid's maximum_speed"
            raise SceneError(f"{name}.speed", part.speed, told)
        if fluid.most == fluid.starting_count and not emptied:
            allowed = f"must be more than {fluid_name} starts with, {fluid.starting_count}, or nothing can come"
            raise SceneError(f"{fluid_name}.capacity", fluid.capacity, allowed)
    for number, (name, fluid) in enumerate(scene.fluids.items()):
        if number not in given and fluid.most > fluid.starting_count:
            raise SceneError(f"{name}.capacity", fluid.capacity, "applies to the fluid of an emitter; leave it out")


def _check_nozzle(scene: Any, name: str, part: Emitter, rest_distance: float) -> None:
    points = part.nozzle(rest_distance, scene.dimensions)
    if not len(points):
        field = "radius" if part.radius is not None else "size"
        value = part.radius if part.radius is not None else list(part.size or ())
        least = rest_distance / 2 if part.radius is not None else rest_distance
        raise SceneError(
            f"{name}.{field}", value, f"is narrower than the rest distance, {rest_distance:g} m: use at least {least:g}"
        )
    for other, sink in scene.sinks.items():
        if sink.holds(points).any():
            raise SceneError(f"{other}.{'point' if sink.shape == 'half-space' else 'center'}",
                             list(sink.point if sink.shape == "half-space" else sink.center),
                             f"the sink covers {name}: what comes from there would be gone at once")  # fmt: skip
    for other, wall in scene.all_of(*COLLIDER_KINDS).items():
        if in_wall(scene.kinds[other], wall, points).any():
            raise SceneError(f"{name}.center", list(part.center), f"lies in {other}: move the nozzle out of it")


def in_wall(kind: str, wall: Any, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) lie in a collider at time 0, (n,) bool; none in a mesh, which has no inside."""
    if kind == "plane":
        normal = np.array(wall.normal) / norm(wall.normal)
        return np.asarray(dot(points - np.array(wall.point), normal) < 0)
    if kind == "sphere":
        return np.asarray(norm(points - np.array(wall.center)) < wall.radius)
    if kind == "box":
        return np.asarray((np.abs(points - np.array(wall.center)) < np.array(wall.half_size)).all(axis=1))
    if kind == "capsule":
        line = np.subtract(wall.end, wall.start)
        square = float(dot(line, line))
        away = points - np.array(wall.start)
        part = np.clip(dot(away, line) / square, 0, 1) if square > 0 else np.zeros(len(points))
        return np.asarray(norm(away - part[:, None] * line) < wall.radius)
    found = np.zeros(len(points), bool)
    if kind == "distance_field":
        places, field = points - np.array(wall.origin), wall.field
        last = field.low + field.spacing * (np.array(field.distance.shape) - 1)
        sampled = ((places >= field.low) & (places <= last)).all(axis=1)
        found[sampled] = field.at(places[sampled]) < 0
    return found
