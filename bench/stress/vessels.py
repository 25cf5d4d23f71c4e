"""Vessels of fluids, their contents and levels: a cup that pours, and two communicating vessels (F10)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.stress.trial import Check, Trial
from softlab.model.geometry.surfaces.cup import HEIGHT, RADIUS, WALL
from softlab.model.scene.scene import Scene

LEVELLED = 6.0  # s: simulated time until the levels are measured
PERIODS = 2  # periods of their oscillation over which levels are averaged
POURED = 4.0  # s
LOOK = 0.5  # s: interval of the measurements of a pouring cup
BELOW, OFF = "deepest below the floor", "difference of levels, of a rest distance"
BIAS = "height off the volume's, of a rest distance"


def in_cup(cup: Any, position: np.ndarray, time: float, margin: float = 0.0) -> np.ndarray:
    """Return a mask (n,) of the positions (n, 3) [m] inside a collider of the shape `cup` at `time` [s], up to its rim.

    `margin` [m]: thickness of the walls that counts as inside.
    """
    scale = cup.shape.scale
    place = (position - np.array(cup.origin) - np.array(cup.velocity) * time) @ cup.turn_at(time)
    far = np.hypot(place[:, 0], place[:, 2])
    low, high = scale * (WALL - HEIGHT / 2), scale * HEIGHT / 2
    return np.asarray((far < scale * (RADIUS - WALL) + margin) & (place[:, 1] > low - margin) & (place[:, 1] < high))


def in_basin(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the positions between the boxes `left` and `right`, `back` and `front`, below their top."""
    left, right, back, front = (scene.parts[name] for name in ("left", "right", "back", "front"))
    inside = np.ones(len(position), bool)
    low: Any
    for axis, low, high in ((0, left, right), (2, back, front)):
        inside &= position[:, axis] > low.center[axis]
        inside &= position[:, axis] < high.center[axis]  # type: ignore[attr-defined]
    top: Any = left
    return np.asarray(inside & (position[:, 1] < top.center[1] + top.half_size[1]))


def basin_area(scene: Scene, keeps: float) -> float:
    """Area of the basin's floor [m^2], reduced by `keeps` [m] at each wall, its thickness."""
    left, right, back, front = (scene.parts[name] for name in ("left", "right", "back", "front"))
    sides = []
    low: Any
    for axis, low, high in ((0, left, right), (2, back, front)):
        whole = high.center[axis] - high.half_size[axis] - low.center[axis] - low.half_size[axis]  # type: ignore[attr-defined]
        sides.append(whole - 2 * keeps)
    return float(sides[0] * sides[1])


def pouring(scene: Scene, seconds: float = POURED, **how: Any) -> Iterator[tuple[float, float, float, np.ndarray]]:
    """Yield (time [s], fraction of the particles in the cup, in the basin, positions) every LOOK of a cup that pours."""
    cup: Any = next(iter(scene.all_of("mesh_collider").values()))
    with open_simulation(scene, **how) as simulation:
        for k in range(1, round(seconds / LOOK) + 1):
            simulation.advance(round(k * LOOK / scene.method.dt) - simulation.step)
            position = simulation.state().position.astype(np.float64)
            poured = in_basin(scene, position)
            inside = in_cup(cup, position, simulation.time) & ~poured
            yield simulation.time, float(inside.mean()), float(poured.mean()), position


def levels_out(trial: Trial) -> list[Check]:
    """F10: water in two vessels that are connected below, all of it in one of them at first.

    In the end it has the same level in both, that of its volume, to a fraction of a layer. It oscillates with the
    period of a column as long as the path between the surfaces (Torricelli), over which levels are averaged; nothing
    passes a wall.
    """
    scene = trial.scene
    found, wall = scene.fluid_set, scene.parts["wall"]
    middle, half = wall.center[0], wall.half_size[0]  # type: ignore[attr-defined]
    right, gap = scene.parts["right"].point[0], wall.center[1] - wall.half_size[1]  # type: ignore[attr-defined]
    each = right - middle - half
    level = found.particle_count * found.lattice.volume / (2 * each) - gap * half / each
    period = 2 * np.pi * np.sqrt((2 * level + 2 * half + each) / 2 / 9.81)
    begin, levels, lowest = trial.steps(LEVELLED), [], 0.0
    for state in trial.watch(range(begin, begin + trial.steps(PERIODS * period), 4)):
        place = state.position.astype(np.float64)
        lowest = min(lowest, float(place[:, 1].min()))
        sides = place[place[:, 0] < middle - half], place[place[:, 0] > middle + half]
        levels.append([len(side) * found.lattice.volume / each for side in sides])
    heights = np.mean(levels, axis=0)
    return [
        Check(OFF, float(abs(heights[0] - heights[1]) / found.spacing), "", "<", 0.5),
        Check(BIAS, float(np.abs(heights - level).max() / found.spacing), "", "<", 0.5),
        Check(BELOW, -lowest, "m", "<", 1e-6),
    ]
