"""The hand in the demo: which mass is selected, and the force it is poked with. No window in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.simulation import Simulation

DOWN = (0.0, -1.0)
NO_POKE: tuple[None, tuple[float, float]] = (None, (0.0, 0.0))


@dataclass(frozen=True)
class Poke:
    """A held force: `target` [m] where the pointer drags to, or None for a push in `direction` from the keyboard."""

    particle: int
    target: tuple[float, float] | None
    direction: tuple[float, float] = DOWN


class Hand:
    """`selected` mass, `held` poke, `direction` of the next poke from the keyboard. `world` and `position` (particles,
    2) are given to each call, because the world is another one after a change of backend."""

    def __init__(self) -> None:
        self.selected: int | None = None
        self.held: Poke | None = None
        self.direction = DOWN
        self._given: tuple[int | None, tuple[float, float]] = NO_POKE  # what the world holds now

    def forget(self) -> None:
        """The world holds no poke (any more): it is a new one, or was reset."""
        self._given = NO_POKE

    def move(self, columns: int, rows: int, world: Simulation) -> int:
        """Select the neighbour `columns` to the right and `rows` up; with nothing selected yet, the middle mass."""
        body = world.body
        self.direction = (float(columns), float(rows))
        if self.selected is None:
            self.selected = (body.rows // 2) * body.columns + body.columns // 2
        else:
            row, column = divmod(self.selected, body.columns)
            row = min(max(row - rows, 0), body.rows - 1)
            column = min(max(column + columns, 0), body.columns - 1)
            self.selected = row * body.columns + column
        if self.held is not None and self.held.target is None:
            self.held = Poke(self.selected, None, self.direction)
        return self.selected

    def force(self, world: Simulation, position: np.ndarray, frame_time: float) -> tuple[float, float]:
        """The held force [N] on the mass where it is now; (0, 0) without one. `frame_time` [s]: simulated time for
        which the force stays as it is."""
        if self.held is None:
            return 0.0, 0.0
        gain = pointer_stiffness(world, frame_time)
        if self.held.target is None:
            reach = 2 * world.scene.grid.spacing
            return self.held.direction[0] * gain * reach, self.held.direction[1] * gain * reach
        x, y = position[self.held.particle].astype(float)
        force = gain * (self.held.target[0] - x), gain * (self.held.target[1] - y)
        return force if all(map(math.isfinite, force)) else (0.0, 0.0)

    def push(self, world: Simulation, position: np.ndarray, frame_time: float) -> None:
        """Give the world the force of the held poke, or let go. Raises what `Simulation.poke` raises."""
        wanted = (self.held.particle, self.force(world, position, frame_time)) if self.held else NO_POKE
        if wanted != self._given:  # every call makes the simulation look at its whole state
            world.poke(*wanted)
            self._given = wanted


def nearest(position: np.ndarray, x: float, y: float, reach: float) -> int | None:
    """The mass of `position` (particles, 2) nearest to (x, y) [m] and not further than `reach` [m], or None."""
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.hypot(position[:, 0] - x, position[:, 1] - y)
    distance[~np.isfinite(distance)] = np.inf
    particle = int(np.argmin(distance))
    return particle if distance[particle] <= reach else None


def pointer_stiffness(world: Simulation, frame_time: float) -> float:
    """Newtons per metre between mass and pointer.

    One spring's stiffness: the force is renewed once a frame only, and a mass in a grid gives way by less than
    force / stiffness, so it draws nearer to the pointer frame by frame without overshooting. A mass on no spring would
    overshoot, so there the frame's own time sets the stiffness.
    """
    scene = world.scene
    if scene.springs and scene.grid.spring_count:
        return scene.springs.stiffness
    return 0.2 * scene.grid.mass / frame_time**2
