"""The grid in vectorised NumPy: whole-array operations into preallocated arrays, one thread.

The code of a careful user of NumPy: separate axes, no avoidable temporary, each spring once.
"""

from __future__ import annotations

import numpy as np

from softlab.bench.peers.base import GridConstants, Opened, Peer
from softlab.model.scene.scene import Scene


class NumpyGrid(Peer):
    name = "numpy"
    label = "NumPy"
    backend = "cpu"

    def available(self) -> tuple[bool, str]:
        return True, f"NumPy {np.__version__}"

    def threads(self, wanted: int) -> int:
        return 1

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Grid(GridConstants(scene, precision))


class _Grid(Opened):
    kernel = "whole arrays"
    threads = 1

    def __init__(self, constants: GridConstants):
        self.constants = constants
        shape = (constants.rows, constants.columns)
        rows, columns = shape
        self.position = np.empty((2, *shape), constants.real)  # x, y
        self.velocity = np.empty((2, *shape), constants.real)
        self._acceleration = np.empty_like(self.position)
        self._new = np.empty_like(self.position)
        self._along = np.empty((2, rows, columns - 1), constants.real)
        self._down = np.empty((2, rows - 1, columns), constants.real)
        self._scale = (np.empty(self._along.shape[1:], constants.real), np.empty(self._down.shape[1:], constants.real))
        self._pinned = np.divmod(constants.pinned, columns)
        self.load(constants.position, constants.velocity)

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.position[...] = position.T.reshape(self.position.shape)
        self.velocity[...] = velocity.T.reshape(self.velocity.shape)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        count = self.constants.count
        position, velocity = (np.ascontiguousarray(a.reshape(2, count).T) for a in (self.position, self.velocity))
        return position, velocity

    def synchronize(self) -> None:
        """Return at once, since NumPy is synchronous."""

    def advance(self, steps: int) -> None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(steps):
                self._step()

    def _pull(self, difference: np.ndarray, scale: np.ndarray) -> None:
        """Convert the vector to the neighbour into force over mass, in place; zero for coincident masses."""
        np.hypot(difference[0], difference[1], out=scale)
        coincident = scale == 0
        np.divide(self.constants.stiffness_rest, scale, out=scale)
        np.subtract(self.constants.stiffness, scale, out=scale)
        if coincident.any():
            scale[coincident] = 0
        difference *= scale

    def _step(self) -> None:
        constants, position, velocity = self.constants, self.position, self.velocity
        acceleration, new = self._acceleration, self._new
        np.multiply(velocity, -constants.damping, out=acceleration)
        acceleration[1] += constants.gravity
        np.subtract(position[:, :, 1:], position[:, :, :-1], out=self._along)
        self._pull(self._along, self._scale[0])
        acceleration[:, :, :-1] += self._along
        acceleration[:, :, 1:] -= self._along
        np.subtract(position[:, 1:], position[:, :-1], out=self._down)
        self._pull(self._down, self._scale[1])
        acceleration[:, :-1] += self._down
        acceleration[:, 1:] -= self._down
        np.multiply(velocity, constants.dt, out=new)
        new += position
        acceleration *= constants.half_dt_squared
        new += acceleration
        new[:, *self._pinned] = position[:, *self._pinned]
        np.subtract(new, position, out=velocity)
        velocity /= constants.dt
        self.position, self._new = new, position
