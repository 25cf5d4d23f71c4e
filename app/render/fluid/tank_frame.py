"""The edges of a fluid's tank as thin bars just outside of its walls. No OpenGL."""

from __future__ import annotations

from itertools import product

import numpy as np

from softlab.app.render.collider_shapes import Mesh, box_mesh
from softlab.app.render.fluid.framing import with_fluids
from softlab.model.core.build import build
from softlab.model.fluid.foam import is_tracked
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

BAR = 0.004  # of the tank's longest side: half a bar's width
OVER = 0.25  # of the fluid's first height: how far the bars of walls without an end rise over it


def tank_box(scene: Scene) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Return (lowest corner, highest corner (3,) [m], True if it has a rim) of the box between a floor and four
    vertical walls that do not move. None for scenes in the plane, without fluids or without such walls."""
    if scene.dimensions != 3 or not with_fluids(scene):
        return None
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    for _, collider in scene.colliders:
        if isinstance(collider, Plane) and not any(collider.velocity):
            (axis, *others) = np.flatnonzero(collider.normal)
            if not others and collider.normal[axis] > 0:
                low[axis] = max(low[axis], collider.point[axis])
            elif not others:
                high[axis] = min(high[axis], collider.point[axis])
    has_rim = bool(np.isfinite(high[1]))
    tanks = [tank.origin[1] + tank.size[1] for tank in scene.tanks.values()]
    if not has_rim and tanks:
        high[1], has_rim = max(tanks), True
    if not has_rim:
        position = build(scene).position
        top = position[is_tracked(position), 1].max(initial=low[1])
        high[1] = top + OVER * (top - low[1])
    known = np.isfinite(low).all() and np.isfinite(high).all() and (high > low).all()
    return (low, high, has_rim) if known else None


def tank_frame(scene: Scene) -> list[Mesh]:
    """Return the bars along the edges of `tank_box`: at the bottom, at the corners, and at the rim if there is one."""
    box = tank_box(scene)
    if box is None:
        return []
    low, high, has_rim = box
    half = BAR * float((high - low).max())
    low, high = low - half, high + half * np.array([1.0, 0.0, 1.0])
    bars = []
    for axis in range(3):
        for ends in product((0, 1), repeat=2):
            center, size = (low + high) / 2, np.full(3, half)
            size[axis] = (high[axis] - low[axis]) / 2 + half
            for other, end in zip([k for k in range(3) if k != axis], ends, strict=True):
                center[other] = (low, high)[end][other]
            if has_rim or center[1] < high[1]:
                bars.append(box_mesh(center.tolist(), size.tolist()))
    return bars
