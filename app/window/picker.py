"""The selected mass of the demo and the force of the poke on it. No window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.window.mouse_constraint import MouseConstraint
from softlab.model.core.simulation import Simulation

NO_POKE: tuple[None, tuple[float, ...]] = (None, ())


@dataclass(frozen=True)
class Poke:
    """A force on a particle: toward `target` [m], the pointer's position, or (None) along `direction` from the
    keyboard."""

    particle: int
    target: tuple[float, ...] | None
    direction: tuple[float, ...] = (0.0, -1.0)


class Picker:
    """`selected` mass, active `poke`, `direction` of the next poke from the keyboard (`down` at first).

    Each call takes `world` and `position` (particles, dimensions), because a change of backend replaces the world.
    """

    def __init__(self, dimensions: int = 2) -> None:
        self.selected: int | None = None
        self.poke: Poke | None = None
        self.down: tuple[float, ...] = (0.0, -1.0, 0.0)[:dimensions]
        self.direction = self.down
        self._applied: tuple[int | None, tuple[float, ...]] = NO_POKE  # what the world holds now
        self._before: tuple[int, np.ndarray] | None = None  # the mass that was pulled last, and where it was then
        self._constraint: MouseConstraint | None = None  # on a body

    def forget(self) -> None:
        """Discard the applied poke, after the world was replaced or reset."""
        self._applied, self._constraint = NO_POKE, None

    def _constraint_on(self, world: Simulation, particle: int) -> MouseConstraint:
        if self._constraint is None or self._constraint.particle != particle:
            self._constraint = MouseConstraint(world, particle)
        return self._constraint

    def move(self, columns: int, rows: int, world: Simulation, direction: tuple[float, ...]) -> int:
        """Select the neighbour `columns` to the right and `rows` up; the first time, the middle mass. `direction`: of
        the next poke, the unit vector of the arrow key.
        """
        body = world.body
        self.direction = direction
        if self.selected is None:
            self.selected = (body.rows // 2) * body.columns + body.columns // 2
            if presentation_of(world.scene).grips:  # of those that are there
                active = np.flatnonzero(body.inverse_mass)
                self.selected = int(active[len(active) // 2])
        else:
            row, column = divmod(self.selected, body.columns)
            row = min(max(row - rows, 0), body.rows - 1)
            column = min(max(column + columns, 0), body.columns - 1)
            self.selected = row * body.columns + column
        return self.move_to(self.selected, direction)

    def move_to(self, particle: int, direction: tuple[float, ...]) -> int:
        """Select a mass; `direction` as in `move`."""
        self.selected, self.direction = particle, direction
        if self.poke is not None and self.poke.target is None:
            self.poke = Poke(particle, None, direction)
        return particle

    def force(self, world: Simulation, position: np.ndarray, interval: float) -> tuple[float, ...]:
        """Return the force [N] of the poke on the mass at its current position; 0 without a poke.

        `interval` [s]: simulated time for which the force stays constant.
        """
        nothing = (0.0,) * len(self.down)
        if self.poke is None:
            return nothing
        if presentation_of(world.scene).grips:
            place = position[self.poke.particle].astype(float)
            constraint = self._constraint_on(world, self.poke.particle)
            vector = constraint.force(world, place, self.poke.target, self.poke.direction, interval)
            return tuple(vector.tolist()) if np.isfinite(vector).all() else nothing
        gain = pointer_stiffness(world, interval)
        if self.poke.target is None:
            displacement = 2 * world.scene.grid.spacing
            return tuple(part * gain * displacement for part in self.poke.direction)
        place = position[self.poke.particle].astype(float)
        wanted = gain * (np.array(self.poke.target) - place)
        if len(place) == 3 and self._before is not None and self._before[0] == self.poke.particle:
            damping = pointer_damping(world.scene.grid.mass, gain, interval)
            wanted -= damping * (place - self._before[1]) / interval
        force = tuple(wanted.tolist())
        return force if all(map(math.isfinite, force)) else nothing

    def push(self, world: Simulation, position: np.ndarray, interval: float) -> None:
        """Apply the force of the poke to the world, or release it. Raises the errors of `Simulation.poke`. A body is
        not poked but pulled, see `pull`."""
        if presentation_of(world.scene).grips:
            self._constraint = self._constraint if self.poke else None
            return
        wanted = (self.poke.particle, self.force(world, position, interval)) if self.poke else NO_POKE
        self._before = (self.poke.particle, position[self.poke.particle].astype(float)) if self.poke else None
        if wanted != self._applied:  # every call makes the simulation look at its whole state
            world.poke(*wanted)
            self._applied = wanted

    def pull(self, world: Simulation, interval: float) -> None:
        """Pull the poked body for the next `interval` [s] of steps. Raises Diverged."""
        if self.poke is not None and presentation_of(world.scene).grips:
            self._constraint_on(world, self.poke.particle).pull(world, self.poke.target, self.poke.direction, interval)


def neighbour(position: np.ndarray, candidates: np.ndarray, selected: int, direction: tuple[float, ...]) -> int:
    """Return the nearest of `candidates` (n,) to `selected` within 45 degrees of `direction` (3,), or `selected` if none is.

    `position` (particles, 3) [m].
    """
    away = position[candidates].astype(np.float64) - position[selected]
    distance = np.linalg.norm(away, axis=1)
    in_direction = (away @ np.asarray(direction) > math.sqrt(0.5) * distance) & (distance > 0)
    if not in_direction.any():
        return selected
    return int(candidates[np.argmin(np.where(in_direction, distance, np.inf))])


def pointer_damping(mass: float, stiffness: float, interval: float) -> float:
    """Damping [N s/m] of a pulled `mass` [kg] of a cloth: critical for the mass alone, but limited so that a force kept
    for `interval` [s] removes at most half of its velocity."""
    return min(2 * math.sqrt(stiffness * mass), 0.5 * mass / interval)


def pointer_stiffness(world: Simulation, interval: float) -> float:
    """Return the stiffness [N/m] between mass and pointer.

    It is the stiffness of one spring: the force is updated once per frame, and a mass in a grid moves by less than
    force / stiffness, so it approaches the pointer frame by frame without overshooting. A mass without springs would
    overshoot, so there the interval between updates determines the stiffness. For a cloth it is the smaller of the two,
    since no spring acts across the sheet.
    """
    scene = world.scene
    if scene.springs and scene.grid.spring_count:
        return scene.springs.stiffness
    alone = 0.2 * scene.grid.mass / interval**2
    return min(alone, max((springs.stiffness for springs in scene.cloth_springs.values()), default=alone))
