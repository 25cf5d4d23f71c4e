"""A fluid on several CPU ranks, divided into slabs of space: a rank's window is an ordinary fluid with some of the
particles active."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from softlab.cpu_backend.fluid.cells import AXES, BOX
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.solver import Fluid
from softlab.model.core.plan import Executor, Moment

SPARE = 1.25  # factor of the capacity for particles when it must grow


class FluidWindow(Fluid):
    """The window of a rank (model/domains/shared_fluid.py). Arrays have capacity for its particles so far and some
    more; the cell table is that of all particles, which determine its width."""

    def _allocate(self) -> None:
        self._particles, self._active_count = LANES, np.zeros(1, np.int64)
        super()._allocate()

    def _grow(self, count: int) -> None:
        """Increase the capacity to `count` particles. The snapshot and the results of the last substep are
        preserved."""
        snapshot, counts, multiplier = self._snapshot, self._counts, self._world.work.multiplier
        self._particles = min(int(SPARE * count), len(self.body.position))
        capacity = self._capacity
        super()._allocate()
        self._counts[:], self._world.work.multiplier[:capacity] = counts, multiplier[:capacity]
        for array, old in zip(self._snapshot, snapshot, strict=True):
            for plane in range(len(old) // capacity):
                array[plane * self._capacity :][:capacity] = old[plane * capacity :][:capacity]
        self._snapshot[-1][:] = snapshot[-1]
        self._executor = Executor(self.plan, self._stages())

    @property
    def _now(self) -> tuple[np.ndarray, ...]:
        return (*self._state, self._active_count)

    @property
    def there(self) -> int:
        return int(self._active_count[0])

    def run_stage(self, name: str, moment: Moment) -> None:
        """Run one stage of the plan."""
        numba.set_num_threads(self._bands)
        self.stages[name](moment)

    def box(self) -> np.ndarray:
        """Return (6,) float64 [m]: the lowest predicted positions, then the highest ones."""
        boxes = self._boxes
        return np.concatenate([boxes[:, :AXES].min(axis=0), boxes[:, AXES:].max(axis=0)]).astype(np.float64)

    def take_box(self, box: np.ndarray) -> None:
        """Use this box for the sort into cells."""
        self._boxes[:] = box.astype(self.real)

    @property
    def _boxes(self) -> np.ndarray:
        """Boxes of the bands (bands, 6)."""
        boxes: np.ndarray = self._world.table.boxes.reshape(-1, BOX)
        return boxes

    def particles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (numbers (n,), positions and velocities (2 x dimensions, n)) of the active particles."""
        count = self.there
        return self._state.number[:count], np.concatenate([array[:, :count] for array in self._planes])

    def set_particles(self, number: np.ndarray, values: np.ndarray) -> None:
        """Replace all active particles by these."""
        count, axes = len(number), self.scene.dimensions
        if count > self._particles:
            self._grow(count)
        self._active_count[0], self._state.number[:count] = count, number
        self._state.fluid[:count] = self.scene.fluid_set.fluid[number]
        for array, some in zip(self._planes, (values[:axes], values[axes:]), strict=True):
            array[:, :count] = some

    @property
    def _planes(self) -> Any:
        axes, capacity = self.scene.dimensions, self._capacity
        return [array[: axes * capacity].reshape(axes, capacity) for array in self._state[:2]]

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Remove all particles; `hold` then stores those in the slab and its halo."""
        self._active_count[0] = 0

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        return self._state.position, self._state.velocity, np.argsort(self._state.number[: self.there]), self._capacity

    def _first_diverged(self) -> int:
        bad = super()._first_diverged()
        return bad if bad < 0 else int(np.sort(self._state.number[: self.there])[bad])

    def multipliers_at(self, places: np.ndarray) -> np.ndarray:
        """Return the multipliers of the last substep [m^2], by the order after it."""
        multipliers: np.ndarray = self._world.work.multiplier[places]
        return multipliers
