"""Framing of a picture: the masses and, in space, the colliders near them and the ground that they fall on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.render.camera import box_corners, finite_bounds
from softlab.app.render.collider_shapes import collider_boxes
from softlab.app.render.fluid.framing import main_part, with_tank
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

MIN_SLOPE = 0.2  # of a plane's unit normal upward: a steeper one is a wall, which nothing falls onto


def seen_radius(scene: Scene) -> float:
    """Return the radius [m] at which a mass is drawn: half the spacing, for bodies the largest spacing of their
    particles."""
    return max((part.baked.spacing for part in scene.bodies.values()), default=scene.grid.spacing) / 2


def seen_points(scene: Scene, position: np.ndarray, time: float) -> np.ndarray:
    """Return the points (n, 3) float64 [m] that a picture must contain, none if no position is finite; in a plane, two
    corners (2, 2).

    They are the finite rows of `position` (particles, 3), the corners of near colliders at `time` [s], and the places
    where bodies would land. Drops of fluids that fly far are left out, and the tank is included
    (app/render/fluid/framing.py).

    Landing places and colliders count only within half the masses' size, because ground far below falling bodies would
    make them invisibly small.
    """
    position = main_part(scene, position)
    bounds = finite_bounds(position)
    if bounds is None:
        return np.zeros((0, scene.dimensions))
    if scene.dimensions == 2:
        return np.reshape(with_tank(scene, bounds, time), (2, 2))
    points = np.asarray(position, dtype=np.float64)
    if not np.isfinite(points).all():
        points = points[np.isfinite(points).all(axis=1)]
    seen = [points, *(box_corners(low, high) for low, high in collider_boxes(scene, bounds, time))]
    return np.concatenate([*seen, *presentation_of(scene).framed(scene, points, bounds, time)])


def tank(scene: Scene, points: np.ndarray, bounds: Sequence[float], time: float) -> list[np.ndarray]:
    """Return the corners of the tank of a fluid (`Presentation.framed`)."""
    around = with_tank(scene, bounds, time)
    return [box_corners(np.array(around[:3]), np.array(around[3:]))]


def landing_places(scene: Scene, points: np.ndarray, bounds: Sequence[float], time: float) -> list[np.ndarray]:
    """Return the points where bodies would land (`Presentation.framed`)."""
    least = bounds[1] - scene.grid.extent / 2
    planes = [collider for _, collider in scene.colliders if isinstance(collider, Plane)]
    return [_landing(points, plane, time, least) for plane in planes]


def _landing(points: np.ndarray, plane: Plane, time: float, least: float) -> np.ndarray:
    """Return the points where the verticals through `points` meet a plane at `time` [s], but no lower than `least` [m]."""
    normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
    if normal[1] < MIN_SLOPE:
        return np.zeros((0, 3))
    away = (points - np.asarray(plane.point) - time * np.asarray(plane.velocity)) @ normal
    landing = points.copy()
    landing[:, 1] = np.maximum(points[:, 1] - np.maximum(away, 0.0) / normal[1], least)
    return landing
