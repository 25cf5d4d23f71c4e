"""Framing of a fluid: the fluid without the few drops that fly far, and the tank that it will fill."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softlab.app.render.fluid.outlines import sections
from softlab.model.fluid.foam import is_tracked
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

FEW = 0.005  # of the particles, at each end of an axis, that may be out of sight
BESIDE = 0.5  # of the others' extent: what is farther from them than this is
SAMPLE = 20_000  # particles: of more, some tell where most are
TANK = 3.0  # times the fluids' first extent: how far a wall may be that belongs to the picture
CEILING = -0.2  # of a plane's unit normal upward: what hangs over a fluid does not


def with_fluids(scene: Scene) -> bool:
    """Return True if a scene, or a member of a world, has fluids."""
    return bool(scene.fluids) or (scene.is_world and any(member.fluids for member in scene.members.values()))


def main_part(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return the rows (n, dimensions) [m] of `position` (particles, dimensions) that are finite and not far from the
    rest. Scenes without fluids keep all rows, as do other members of a world."""
    if scene.is_world:
        slices = scene.world_set.slices()
        return np.concatenate([main_part(member, position[slices[name]]) for name, member in scene.members.items()])
    if not scene.fluids:
        return position
    known = position[is_tracked(position)]
    if not len(known):
        return known
    low, high = np.quantile(known[:: -(-len(known) // SAMPLE)], (FEW, 1 - FEW), axis=0)
    beside = BESIDE * (high - low) + 2 * scene.fluid_set.spacing
    return np.asarray(known[((known >= low - beside) & (known <= high + beside)).all(axis=1)])


def with_tank(scene: Scene, bounds: Sequence[float], time: float) -> tuple[float, ...]:
    """Return `bounds`, the lowest and the highest coordinates [m] of a fluid, extended by the floor and the walls near
    it at `time` [s], in a plane also by other colliders; unchanged for scenes without fluids."""
    for member in scene.members.values() if scene.is_world else ():
        bounds = with_tank(member, bounds, time)
    if not scene.fluids:
        return tuple(bounds)
    axes = scene.dimensions
    low, high = np.array(bounds[:axes], np.float64), np.array(bounds[axes:], np.float64)
    least, most = low.copy(), high.copy()
    max_distance = TANK * scene.fluid_set.extent
    for _, collider in scene.colliders:
        if not isinstance(collider, Plane):
            continue
        normal = (np.array(collider.normal) / np.linalg.norm(collider.normal))[:axes]
        if normal[1] < CEILING or not normal.any():
            continue
        point = (np.array(collider.point) + time * np.array(collider.velocity))[:axes]
        nearest = np.where(normal > 0, low, high)
        away = (nearest - point) @ normal
        if 0 < away < max_distance:
            least, most = np.minimum(least, nearest - away * normal), np.maximum(most, nearest - away * normal)
    if axes == 2:
        shapes = np.concatenate([np.zeros((0, 2)), *sections(scene, time, planes=False)])
        near = ((shapes > low - max_distance) & (shapes < high + max_distance)).all(axis=1)
        if near.any():
            least, most = np.minimum(least, shapes[near].min(axis=0)), np.maximum(most, shapes[near].max(axis=0))
    return (*least.tolist(), *most.tolist())
