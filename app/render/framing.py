"""What a picture is to hold: the masses, and in space the colliders near them and the ground that they fall on."""

from __future__ import annotations

import numpy as np

from softlab.app.render.camera import finite_bounds
from softlab.app.render.camera3d import box_corners
from softlab.app.render.collider_shapes import collider_boxes
from softlab.app.render.fluid.framing import main_part, with_tank
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

MIN_SLOPE = 0.2  # of a plane's unit normal upward: a steeper one is a wall, which nothing falls onto


def seen_radius(scene: Scene) -> float:
    """[m], how far what is drawn reaches about a mass: half the spacing, of bodies the largest one of their particles."""
    return max((part.baked.spacing for part in scene.bodies.values()), default=scene.grid.spacing) / 2


def seen_points(scene: Scene, position: np.ndarray, time: float) -> np.ndarray:
    """(n, 3) float64 [m]: those of `position` (particles, 3) that are finite, the corners of what is near of the colliders at
    `time` [s], and below bodies the places where they would land; none where nothing is finite. In a plane two corners
    (2, 2). Of fluids without the drops that fly far, and with the tank (app/render/fluid/framing.py).

    Landing places, as colliders, count up to half the masses' own size away: of what falls from the sky the ground would
    leave nothing to see.
    """
    position = main_part(scene, position)
    bounds = finite_bounds(position)
    if bounds is None:
        return np.zeros((0, scene.dimensions))
    tank = with_tank(scene, bounds, time)
    if scene.dimensions == 2:
        return np.reshape(tank, (2, 2))
    points = np.asarray(position, dtype=np.float64)
    if not np.isfinite(points).all():
        points = points[np.isfinite(points).all(axis=1)]
    found = [points, *(box_corners(low, high) for low, high in collider_boxes(scene, bounds, time))]
    if scene.fluids:
        found.append(box_corners(np.array(tank[:3]), np.array(tank[3:])))
    least = bounds[1] - scene.grid.extent / 2
    for _, collider in scene.colliders if scene.bodies else ():
        if isinstance(collider, Plane):
            found.append(_landing(points, collider, time, least))
    return np.concatenate(found)


def _landing(points: np.ndarray, plane: Plane, time: float, least: float) -> np.ndarray:
    """Where the vertical through each point meets a plane at `time` [s], but no lower than `least` [m]."""
    normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
    if normal[1] < MIN_SLOPE:
        return np.zeros((0, 3))
    away = (points - np.asarray(plane.point) - time * np.asarray(plane.velocity)) @ normal
    found = points.copy()
    found[:, 1] = np.maximum(points[:, 1] - np.maximum(away, 0.0) / normal[1], least)
    return found
