"""Outlines of colliders in a plane scene: the lines in which they cut the plane. No OpenGL."""

from __future__ import annotations

import numpy as np

from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Plane, Sphere

SIDES = 96  # of a circle
FAR = 40.0  # times the scene's size: how long the line of a half-plane is


def outlines(scene: Scene, time: float, planes: bool = True) -> np.ndarray:
    """Return n lines by their ends (2 n, 2) float32 [m]: the sections of the colliders at `time` [s], with or without
    plane colliders. Meshes and fields have no outline."""
    lines = [np.zeros((0, 2))]
    for _, collider in scene.colliders:
        shift = time * np.array(getattr(collider, "velocity", (0.0, 0.0, 0.0)))[:2]
        if isinstance(collider, Plane):
            normal = np.array(collider.normal)[:2]
            if not (planes and normal.any()):
                continue
            along = FAR * scene.grid.extent * np.array([-normal[1], normal[0]]) / np.linalg.norm(normal)
            point = np.array(collider.point)[:2] + shift
            lines.append(np.stack([point - along, point + along]))
        elif isinstance(collider, Sphere):
            cut = float(np.sqrt(max(1 - (collider.center[2] / collider.radius) ** 2, 0.0)))  # by the plane z = 0
            lines.append(_closed(_ring(collider.radius, np.array(collider.center)[:2], cut) + shift))
        elif isinstance(collider, Capsule):
            start, end = (np.array(place)[:2] for place in (collider.start, collider.end))
            angle = np.arctan2(end[1] - start[1], end[0] - start[0])
            turn = angle + np.pi / 2 + np.linspace(0, np.pi, SIDES // 2)
            half = collider.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            lines.append(_closed(np.concatenate([start + half, end - half]) + shift))
        elif isinstance(collider, Box):
            x, y = collider.half_size[:2]
            lines.append(
                _closed(np.array(collider.center)[:2] + np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + shift)
            )
    return np.concatenate(lines).astype(np.float32)


def _ring(radius: float, middle: np.ndarray, scale: float) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    return middle + scale * radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _closed(corners: np.ndarray) -> np.ndarray:
    """Return the sides of a polygon by their ends."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 2)
