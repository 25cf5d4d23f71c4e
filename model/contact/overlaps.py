"""Masses that begin inside a collider: pinned ones stay, free ones are pushed out, and a message says so."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from softlab.model.contact.cloth_parameters import B_RADIUS, B_THICKNESS, B_U, B_W, B_X, B_Z, collider_rows
from softlab.model.core.build import build
from softlab.model.formulas import colliders, distance_field, triangle_tree
from softlab.model.scene.scene import Scene
from softlab.model.tables.colliders.surface_collider import SurfaceCollider

HOLLOW = " (it is solid all through; a tank is made of planes, a floor and walls)"
MAX_ASKED = 2000  # free masses: a tenth of a second


def _distance(kind: str, row: np.ndarray, numbers: np.ndarray | None, d: np.ndarray) -> float:
    """Return the distance [m] from a point at `d` [m] from the collider's reference point to its surface; `numbers`: of
    a tree or a field."""
    x, y, z = d.tolist()
    if kind == "mesh_collider":
        return sqrt(triangle_tree.nearest(numbers, 0, x, y, z, inf)[0])
    if kind == "distance_field":
        return float(distance_field.sample(numbers, 0, x, y, z)[0])
    sizes: list[float] = [] if kind == "sphere" else row[B_U : B_W + 1].tolist()
    if kind in ("sphere", "capsule"):
        sizes.append(float(row[B_RADIUS]))
    return float(getattr(colliders, kind)(x, y, z, *sizes)[0])


def _distances(kind: str, row: np.ndarray, numbers: np.ndarray | None, points: np.ndarray) -> list[float]:
    """Return the distances [m] of points (n, 3) [m] from the collider's surface."""
    return [_distance(kind, row, numbers, p - row[B_X : B_Z + 1]) for p in points]


def overlap_lines(scene: Scene) -> list[str]:
    """Return a sentence for each collider that contains pinned masses at the start, or is nearer to them than its
    thickness, and for each that free masses penetrate by more than half a spacing. Of large sheets only a sample of the
    masses is tested."""
    if scene.bodies or not scene.colliders:  # bodies' pins are copies that wait
        return []
    body = build(scene)
    pinned, free = body.position[body.pinned], body.position[body.inverse_mass > 0]
    if scene.dimensions == 2:  # of a fluid
        free = np.pad(free, ((0, 0), (0, 1)))
    some = free[:: -(-len(free) // MAX_ASKED) or 1]
    lines = []
    for (kind, collider), row in zip(scene.colliders, collider_rows(scene, np.float64), strict=True):
        numbers = collider.numbers(float) if isinstance(collider, SurfaceCollider) else None
        shape = kind, row, numbers
        inside = sum(distance < row[B_THICKNESS] for distance in _distances(*shape, pinned))
        if inside:
            lines.append(
                f"{inside} of {len(pinned)} pinned masses begin inside a {kind} or nearer than its thickness: they "
                "stay, and the masses attached to them are pushed out"
            )
        if kind == "mesh_collider":  # a surface, without an inside
            continue
        deep = sum(distance < -scene.grid.spacing / 2 for distance in _distances(*shape, some))
        if deep:
            about = f"about {deep * len(free) // len(some)}" if len(some) < len(free) else str(deep)
            lines.append(
                f"{about} of {len(free)} free masses begin deep inside a {kind}: the first step moves them to its surface "
                + (
                    "at once; start outside of it"
                    if scene.fluids
                    else "and stretches their springs; start outside of it"
                )
                + (HOLLOW if scene.fluids and kind != "plane" else "")
            )
    return lines
