"""Colliders of a plane as something to draw: their sections, by outlines or areas. No OpenGL."""

from __future__ import annotations

import numpy as np

from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Plane, Sphere

SIDES = 96  # of a circle
FAR = 40.0  # times the scene's size: half a side of the square of a half-plane


def sections(scene: Scene, time: float, planes: bool = True) -> list[np.ndarray]:
    """Return the sections of the colliders at `time` [s], with or without planes: convex polygons, corners (k, 2) [m] in
    order; a plane is a large square with its first side on the surface. Meshes and fields have none."""
    polygons = []
    for _, collider in scene.colliders:
        shift = time * np.array(getattr(collider, "velocity", (0.0, 0.0, 0.0)))[:2]
        if isinstance(collider, Plane):
            normal = np.array(collider.normal)[:2]
            if not (planes and normal.any()):
                continue
            normal = FAR * scene.grid.extent * normal / np.linalg.norm(normal)
            along, point = np.array([-normal[1], normal[0]]), np.array(collider.point)[:2] + shift
            polygons.append(point + np.stack([-along, along, along - normal, -along - normal]))
        elif isinstance(collider, Sphere):
            cut = float(np.sqrt(max(1 - (collider.center[2] / collider.radius) ** 2, 0.0)))  # by the plane z = 0
            polygons.append(_ring(collider.radius, np.array(collider.center)[:2], cut) + shift)
        elif isinstance(collider, Capsule):
            start, end = (np.array(place)[:2] for place in (collider.start, collider.end))
            angle = np.arctan2(end[1] - start[1], end[0] - start[0])
            turn = angle + np.pi / 2 + np.linspace(0, np.pi, SIDES // 2)
            half = collider.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            polygons.append(np.concatenate([start + half, end - half]) + shift)
        elif isinstance(collider, Box):
            x, y = collider.half_size[:2]
            polygons.append(np.array(collider.center)[:2] + np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + shift)
    return polygons


def outlines(polygons: list[np.ndarray]) -> np.ndarray:
    """Return the sides of polygons as n lines by their ends (2 n, 2) float32 [m]."""
    lines = [np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 2) for corners in polygons]
    return np.concatenate([np.zeros((0, 2)), *lines]).astype(np.float32)


def triangles(polygons: list[np.ndarray]) -> np.ndarray:
    """Return the areas of convex polygons as n triangles by their corners (3 n, 2) float32 [m]."""
    fans = [
        np.stack([np.broadcast_to(corners[0], corners[2:].shape), corners[1:-1], corners[2:]], axis=1).reshape(-1, 2)
        for corners in polygons
    ]
    return np.concatenate([np.zeros((0, 2)), *fans]).astype(np.float32)


def _ring(radius: float, middle: np.ndarray, scale: float) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    return middle + scale * radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
