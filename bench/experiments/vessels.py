"""A cup that pours into a basin: which particles are in either, step by step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from softlab.app.driver import open_simulation
from softlab.model.geometry.surfaces.cup import HEIGHT, RADIUS, WALL
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box
from softlab.model.tables.colliders.mesh_collider import MeshCollider

POURED = 4.0  # s
INTERVAL = 0.5  # s: interval of the measurements of a pouring cup


def in_cup(cup: MeshCollider, position: np.ndarray, time: float, margin: float = 0.0) -> np.ndarray:
    """Return a mask (n,) of the positions (n, 3) [m] inside a collider of the shape `cup` at `time` [s], up to its rim.

    `margin` [m]: thickness of the walls that counts as inside.
    """
    assert cup.shape is not None
    scale = cup.shape.scale
    place = (position - np.array(cup.origin) - np.array(cup.velocity) * time) @ cup.turn_at(time)
    far = np.hypot(place[:, 0], place[:, 2])
    low, high = scale * (WALL - HEIGHT / 2), scale * HEIGHT / 2
    return np.asarray((far < scale * (RADIUS - WALL) + margin) & (place[:, 1] > low - margin) & (place[:, 1] < high))


def basin_walls(scene: Scene) -> tuple[Box, ...]:
    """Return the walls `left`, `right`, `back` and `front` of the basin."""
    walls = (scene.parts[name] for name in ("left", "right", "back", "front"))
    return tuple(wall for wall in walls if isinstance(wall, Box))


def in_basin(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the positions between the boxes `left` and `right`, `back` and `front`, below their top."""
    left, right, back, front = basin_walls(scene)
    inside = np.ones(len(position), bool)
    for axis, low, high in ((0, left, right), (2, back, front)):
        inside &= position[:, axis] > low.center[axis]
        inside &= position[:, axis] < high.center[axis]
    return np.asarray(inside & (position[:, 1] < left.center[1] + left.half_size[1]))


def basin_area(scene: Scene, keeps: float) -> float:
    """Area of the basin's floor [m^2], reduced by `keeps` [m] at each wall, its thickness."""
    left, right, back, front = basin_walls(scene)
    sides = []
    for axis, low, high in ((0, left, right), (2, back, front)):
        whole = high.center[axis] - high.half_size[axis] - low.center[axis] - low.half_size[axis]
        sides.append(whole - 2 * keeps)
    return float(sides[0] * sides[1])


def pouring(
    scene: Scene, backend: str = "cpu", precision: str = "float32", threads: str | int = "1x"
) -> Iterator[tuple[float, float, float, np.ndarray]]:
    """Yield (time [s], fraction of the particles in the cup, in the basin, positions) every LOOK of a cup that pours."""
    cup = next(iter(scene.all_of("mesh_collider").values()))
    assert isinstance(cup, MeshCollider)
    with open_simulation(scene, backend, precision=precision, threads=threads) as simulation:
        for k in range(1, round(POURED / INTERVAL) + 1):
            simulation.advance(round(k * INTERVAL / scene.method.dt) - simulation.step)
            position = simulation.state().position.astype(np.float64)
            poured = in_basin(scene, position)
            inside = in_cup(cup, position, simulation.time) & ~poured
            yield simulation.time, float(inside.mean()), float(poured.mean()), position
