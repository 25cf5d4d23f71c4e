"""Pinned masses that begin inside a collider: they stay where they are, and whoever made the scene is told."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

import numpy as np

from model.contact.surface_collider import SurfaceCollider
from model.core.build import build
from model.formulas import colliders, distance_field, triangle_tree
from model.mass_spring.cloth_parameters import B_RADIUS, B_THICKNESS, B_U, B_W, B_X, B_Z, collider_rows
from model.scene.scene import Scene


def _distance(formulas: Any, kind: str, d: np.ndarray, row: np.ndarray, numbers: np.ndarray | None) -> float:
    """Of a point that lies at `d` [m] from the collider's own point, to its surface [m]. `numbers`: of a tree or a field."""
    if kind == "mesh_collider":
        return sqrt(triangle_tree.make(float).nearest(numbers, 0, *d.tolist(), inf)[0])
    if kind == "distance_field":
        return float(distance_field.make(float).sample(numbers, 0, *d.tolist())[0])
    own: list[float] = [] if kind == "sphere" else row[B_U : B_W + 1].tolist()
    if kind in ("sphere", "capsule"):
        own.append(float(row[B_RADIUS]))
    return float(getattr(formulas, kind)(*d.tolist(), *own)[0])


def overlap_lines(scene: Scene) -> list[str]:
    """A sentence for each collider that has pinned masses in it, or nearer than its thickness, when the scene begins."""
    if scene.bodies:  # theirs are copies that wait, not pins
        return []
    body = build(scene)
    pinned = body.position[body.pinned]
    if not len(pinned) or not scene.colliders:
        return []
    formulas, lines = colliders.make(float), []
    for (kind, collider), row in zip(scene.colliders, collider_rows(scene, np.float64), strict=True):
        numbers = collider.numbers(float) if isinstance(collider, SurfaceCollider) else None
        away = (_distance(formulas, kind, p - row[B_X : B_Z + 1], row, numbers) for p in pinned)
        inside = sum(distance < row[B_THICKNESS] for distance in away)
        if inside:
            lines.append(
                f"{inside} of {len(pinned)} pinned masses begin inside a {kind} or nearer than its thickness: they stay, and "
                "what hangs on them is pushed out beside them"
            )
    return lines
