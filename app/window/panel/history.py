"""Energy and momentum of a world over time, for the panel's curves."""

from __future__ import annotations

from math import hypot

import numpy as np

from softlab.app.window.measures import Statistics
from softlab.model.core.simulation import Simulation

LENGTH = 240  # looks that are kept
COLUMNS = ("time", "energy", "kinetic", "momentum")


class History:
    """The last LENGTH measurements of a world: `rows` (measurements, 4), of COLUMNS [s, J, J, kg m/s], the newest last."""

    def __init__(self) -> None:
        self.rows = np.zeros((0, len(COLUMNS)))
        self._seen: tuple[Statistics | None, Simulation | None] = (None, None)

    def record(self, world: Simulation, statistics: Statistics) -> None:
        """Append the statistics of a world, if they are new; start again for another world or an earlier time."""
        before, of = self._seen
        if statistics is before:
            return
        self._seen = statistics, world
        if (len(self.rows) and world.time < self.rows[-1, 0]) or (of is not None and _other(world, of)):
            self.rows = self.rows[:0]
        if len(self.rows) and world.time == self.rows[-1, 0]:
            self.rows = self.rows[:-1]
        row = (world.time, statistics.energy, statistics.kinetic, hypot(*statistics.momentum))
        self.rows = np.vstack([self.rows, [row]])[-LENGTH:]

    def column(self, name: str) -> np.ndarray:
        """Return a column (measurements,) by name."""
        return self.rows[:, COLUMNS.index(name)]


def _other(world: Simulation, before: Simulation) -> bool:
    """Return True if the scene of the world is another one, and not the same one reopened."""
    return (
        world.scene.title != before.scene.title or world.scene.grid.particle_count != before.scene.grid.particle_count
    )
