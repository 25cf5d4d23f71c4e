"""Checks of emitters and sinks against fluids and colliders."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.geometry.arithmetic.ordered import dot, norm
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.cloth import Box, Capsule, Collider, Plane, Sphere
from softlab.model.tables.colliders.distance_field import DistanceField
from softlab.model.tables.flow import Emitter


def fluid_of(scene: SceneParts, name: str) -> int:
    """Return the index of an emitter's fluid. Raises SceneError."""
    names, part = list(scene.fluids), scene.emitters[name]
    if part.fluid is None:
        return 0
    if part.fluid not in names:
        raise SceneError(f"{name}.fluid", part.fluid, f"must be one of {', '.join(names)}")
    return names.index(part.fluid)


def check_flow(scene: SceneParts) -> None:
    """Raise SceneError for an emitter without particles, too fast, or in a collider or a sink, for a capacity without
    an emitter, and for a sink of other dimensions."""
    axes, emptied = scene.dimensions, bool(scene.sinks)
    if (scene.emitters or emptied) and scene.method.scheme == "divergence-free":
        reason = "is not supported together with emitters and sinks; use macklin or averaged"
        raise SceneError("method.scheme", scene.method.scheme, reason)
    for name, sink in scene.sinks.items():
        for field in ("center", "point", "normal"):
            if axes == 2 and len(getattr(sink, field)) == 3 and getattr(sink, field)[2] != 0:
                raise SceneError(f"{name}.{field}", list(getattr(sink, field)), "must lie in the plane z = 0")
    fed = set()
    for name, part in scene.emitters.items():
        number = fluid_of(scene, name)
        fluid_name, fluid = list(scene.fluids.items())[number]
        fed.add(number)
        for field in ("center", "direction"):
            vector = getattr(part, field)
            if len(vector) == 3 and axes == 2 and vector[2] != 0:
                raise SceneError(f"{name}.{field}", list(vector), "must lie in the plane z = 0 in 2 dimensions")
        _check_nozzle(scene, name, part, fluid.rest_distance)
        limit = fluid.speed_limit(scene.method.dt / scene.method.substeps)
        if part.speed > limit:
            reason = f"must be at most {limit:.4g} m/s, half a support a substep, or the fluid's maximum_speed"
            raise SceneError(f"{name}.speed", part.speed, reason)
        if fluid.most == fluid.starting_count and not emptied:
            allowed = f"must be more than {fluid_name} starts with, {fluid.starting_count}, or nothing can come"
            raise SceneError(f"{fluid_name}.capacity", fluid.capacity, allowed)
    for number, (name, fluid) in enumerate(scene.fluids.items()):
        if number not in fed and fluid.most > fluid.starting_count:
            raise SceneError(f"{name}.capacity", fluid.capacity, "applies to the fluid of an emitter; leave it out")


def _check_nozzle(scene: SceneParts, name: str, part: Emitter, rest_distance: float) -> None:
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
    for other, wall in scene.parts_of(Collider).items():
        if in_wall(wall, points).any():
            raise SceneError(f"{name}.center", list(part.center), f"lies in {other}: move the nozzle out of it")


def in_wall(wall: Collider, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) lie in a collider at time 0, (n,) bool; none in a mesh, which has no inside."""
    if isinstance(wall, Plane):
        normal = np.array(wall.normal) / norm(wall.normal)
        return np.asarray(dot(points - np.array(wall.point), normal) < 0)
    if isinstance(wall, Sphere):
        return np.asarray(norm(points - np.array(wall.center)) < wall.radius)
    if isinstance(wall, Box):
        return np.asarray((np.abs(points - np.array(wall.center)) < np.array(wall.half_size)).all(axis=1))
    if isinstance(wall, Capsule):
        line = np.subtract(wall.end, wall.start)
        square = float(dot(line, line))
        away = points - np.array(wall.start)
        part = np.clip(dot(away, line) / square, 0, 1) if square > 0 else np.zeros(len(points))
        return np.asarray(norm(away - part[:, None] * line) < wall.radius)
    inside = np.zeros(len(points), bool)
    if isinstance(wall, DistanceField):
        places, field = points - np.array(wall.origin), wall.field
        last = field.low + field.spacing * (np.array(field.distance.shape) - 1)
        sampled = ((places >= field.low) & (places <= last)).all(axis=1)
        inside[sampled] = field.at(places[sampled]) < 0
    return inside
