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
        self._particles, self._held = LANES, np.zeros(1, np.int64)
        super()._allocate()

    def _grow(self, count: int) -> None:
        """Increase the capacity to `count` particles. The snapshot and the results of the last substep are
        preserved."""
        kept, counts, multiplier = self._kept, self._counts, self._world.work.multiplier
        self._particles = min(int(SPARE * count), len(self.body.position))
        room = self._room
        super()._allocate()
        self._counts[:], self._world.work.multiplier[:room] = counts, multiplier[:room]
        for array, old in zip(self._kept, kept, strict=True):
            for plane in range(len(old) // room):
                array[plane * self._room :][:room] = old[plane * room :][:room]
        self._kept[-1][:] = kept[-1]
        self._executor = Executor(self.plan, self._stages())

    @property
    def _now(self) -> tuple[np.ndarray, ...]:
        return (*self._state, self._held)

    @property
    def there(self) -> int:
        return int(self._held[0])

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
        found: np.ndarray = self._world.table.boxes.reshape(-1, BOX)
        return found

    def particles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (numbers (n,), positions and velocities (2 x dimensions, n)) of the active particles."""
        count = self.there
        return self._state.number[:count], np.concatenate([array[:, :count] for array in self._planes])

    def hold(self, number: np.ndarray, values: np.ndarray) -> None:
        """Replace all active particles by these."""
        count, axes = len(number), self.scene.dimensions
        if count > self._particles:
            self._grow(count)
        self._held[0], self._state.number[:count] = count, number
        self._state.fluid[:count] = self.scene.fluid_set.fluid[number]
        for array, some in zip(self._planes, (values[:axes], values[axes:]), strict=True):
            array[:, :count] = some

    @property
    def _planes(self) -> Any:
        axes, room = self.scene.dimensions, self._room
        return [array[: axes * room].reshape(axes, room) for array in self._state[:2]]

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Remove all particles: those in a slab and near it are `held`."""
        self._held[0] = 0

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        return self._state.position, self._state.velocity, np.argsort(self._state.number[: self.there]), self._room

    def _first_diverged(self) -> int:
        found = super()._first_diverged()
        return found if found < 0 else int(np.sort(self._state.number[: self.there])[found])

    def multipliers_at(self, places: np.ndarray) -> np.ndarray:
        """Return the multipliers of the last substep [m^2], by place after it."""
        found: np.ndarray = self._world.work.multiplier[places]
        return found
