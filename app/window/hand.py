"""The hand in the demo: which mass is selected, and the force it is poked with. No window in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.window.grip import Grip
from softlab.model.core.simulation import Simulation

NO_POKE: tuple[None, tuple[float, ...]] = (None, ())


@dataclass(frozen=True)
class Poke:
    """A held force: `target` [m] where the pointer drags to, or None for a push in `direction` from the keyboard."""

    particle: int
    target: tuple[float, ...] | None
    direction: tuple[float, ...] = (0.0, -1.0)


class Hand:
    """`selected` mass, `held` poke, `direction` of the next poke from the keyboard (`down` at first). `world` and `position`
    (particles, dimensions) are given to each call, because the world is another one after a change of backend."""

    def __init__(self, dimensions: int = 2) -> None:
        self.selected: int | None = None
        self.held: Poke | None = None
        self.down: tuple[float, ...] = (0.0, -1.0, 0.0)[:dimensions]
        self.direction = self.down
        self._given: tuple[int | None, tuple[float, ...]] = NO_POKE  # what the world holds now
        self._before: tuple[int, np.ndarray] | None = None  # the mass that was pulled last, and where it was then
        self._grip: Grip | None = None  # on a body

    def forget(self) -> None:
        """The world holds no poke (any more): it is a new one, or was reset."""
        self._given, self._grip = NO_POKE, None

    def _hold(self, world: Simulation, particle: int) -> Grip:
        if self._grip is None or self._grip.particle != particle:
            self._grip = Grip(world, particle)
        return self._grip

    def move(self, columns: int, rows: int, world: Simulation, direction: tuple[float, ...]) -> int:
        """Select the neighbour `columns` to the right and `rows` up; with nothing selected yet, the middle mass.

        `direction`: of the next poke, the unit vector that the arrow key means.
        """
        body = world.body
        self.direction = direction
        if self.selected is None:
            self.selected = (body.rows // 2) * body.columns + body.columns // 2
            if presentation_of(world.scene).grips:  # of those that are there
                there = np.flatnonzero(body.inverse_mass)
                self.selected = int(there[len(there) // 2])
        else:
            row, column = divmod(self.selected, body.columns)
            row = min(max(row - rows, 0), body.rows - 1)
            column = min(max(column + columns, 0), body.columns - 1)
            self.selected = row * body.columns + column
        return self.move_to(self.selected, direction)

    def move_to(self, particle: int, direction: tuple[float, ...]) -> int:
        """Select a mass; `direction` as in `move`."""
        self.selected, self.direction = particle, direction
        if self.held is not None and self.held.target is None:
            self.held = Poke(particle, None, direction)
        return particle

    def force(self, world: Simulation, position: np.ndarray, hold_time: float) -> tuple[float, ...]:
        """The held force [N] on the mass where it is now; 0 without one. `hold_time` [s]: simulated time for which the force
        stays as it is."""
        nothing = (0.0,) * len(self.down)
        if self.held is None:
            return nothing
        if presentation_of(world.scene).grips:
            place, grip = position[self.held.particle].astype(float), self._hold(world, self.held.particle)
            found = grip.force(world, place, self.held.target, self.held.direction, hold_time)
            return tuple(found.tolist()) if np.isfinite(found).all() else nothing
        gain = pointer_stiffness(world, hold_time)
        if self.held.target is None:
            reach = 2 * world.scene.grid.spacing
            return tuple(part * gain * reach for part in self.held.direction)
        place = position[self.held.particle].astype(float)
        wanted = gain * (np.array(self.held.target) - place)
        if len(place) == 3 and self._before is not None and self._before[0] == self.held.particle:
            damping = pointer_damping(world.scene.grid.mass, gain, hold_time)
            wanted -= damping * (place - self._before[1]) / hold_time
        force = tuple(wanted.tolist())
        return force if all(map(math.isfinite, force)) else nothing

    def push(self, world: Simulation, position: np.ndarray, hold_time: float) -> None:
        """Give the world the force of the held poke, or let go. Raises what `Simulation.poke` raises. A body is not poked
        but pulled, see `pull`."""
        if presentation_of(world.scene).grips:
            self._grip = self._grip if self.held else None
            return
        wanted = (self.held.particle, self.force(world, position, hold_time)) if self.held else NO_POKE
        self._before = (self.held.particle, position[self.held.particle].astype(float)) if self.held else None
        if wanted != self._given:  # every call makes the simulation look at its whole state
            world.poke(*wanted)
            self._given = wanted

    def pull(self, world: Simulation, hold_time: float) -> None:
        """Pull the held body for the steps of `hold_time` [s] that follow. Raises Diverged."""
        if self.held is not None and presentation_of(world.scene).grips:
            self._hold(world, self.held.particle).pull(world, self.held.target, self.held.direction, hold_time)


def neighbour(position: np.ndarray, own: np.ndarray, selected: int, direction: tuple[float, ...]) -> int:
    """Of the particles `own` (n,) at `position` (particles, 3) [m] the nearest to `selected` that lies within 45 degrees of
    `direction` (3,) from it; itself where none does."""
    away = position[own].astype(np.float64) - position[selected]
    distance = np.linalg.norm(away, axis=1)
    that_way = (away @ np.asarray(direction) > math.sqrt(0.5) * distance) & (distance > 0)
    if not that_way.any():
        return selected
    return int(own[np.argmin(np.where(that_way, distance, np.inf))])


def pointer_damping(mass: float, stiffness: float, hold_time: float) -> float:
    """Newton seconds per metre that a pulled `mass` [kg] of a cloth is slowed by: critical for the mass alone, but
    never so much that the force, `hold_time` [s] old, takes more than half of its velocity."""
    return min(2 * math.sqrt(stiffness * mass), 0.5 * mass / hold_time)


def pointer_stiffness(world: Simulation, hold_time: float) -> float:
    """Newtons per metre between mass and pointer.

    One spring's stiffness: the force is renewed once a frame only, and a mass in a grid gives way by less than
    force / stiffness, so it draws nearer to the pointer frame by frame without overshooting. A mass on no spring would
    overshoot, so there the time for which the force is held sets the stiffness; of a cloth the smaller, since across the
    sheet no spring holds a mass.
    """
    scene = world.scene
    if scene.springs and scene.grid.spring_count:
        return scene.springs.stiffness
    alone = 0.2 * scene.grid.mass / hold_time**2
    return min(alone, max((springs.stiffness for springs in scene.cloth_springs.values()), default=alone))
