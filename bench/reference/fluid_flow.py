"""What comes by emitters and ends in sinks, in slow, plain NumPy float64.

From what model/fluid/plan.py says, without model/formulas: a nozzle's layers leave it a rest distance apart at its speed; who
leaves is the waiting particle of its fluid with the lowest number."""

from __future__ import annotations

from math import ceil

import numpy as np

from model.fluid.fluid_set import PARKED
from model.scene.scene import Scene


class Flow:
    """Of a scene whose emitters' speeds stay; `h` [s]: of a substep."""

    def __init__(self, scene: Scene, h: float):
        self.scene, self.h, self.missing = scene, h, 0
        self.nozzles = {
            name: part.nozzle(scene.fluid_set.spacing, scene.dimensions) for name, part in scene.emitters.items()
        }

    def layers(self, name: str, time: float) -> float:
        """How many have passed the nozzle."""
        part = self.scene.emitters[name]
        stop = np.inf if part.stop is None else part.stop
        return part.speed / self.scene.fluid_set.spacing * (min(max(time, part.start), stop) - part.start)

    def emit(self, number: int, position: np.ndarray, velocity: np.ndarray) -> None:
        """Those that leave in a substep, into arrays (particles, 3) in which others are PARKED."""
        found = self.scene.fluid_set
        for name, part in self.scene.emitters.items():
            passed = [self.layers(name, (number + k) * self.h) for k in (0, 1)]
            own = 0 if part.fluid is None else list(self.scene.fluids).index(part.fluid)
            for layer in range(ceil(passed[0]), ceil(passed[1])):
                waiting = np.flatnonzero((found.fluid == own) & ~found.there(position))
                points = self.nozzles[name] + (passed[1] - layer) * found.spacing * part.way
                self.missing += max(0, len(points) - len(waiting))
                position[waiting[: len(points)]] = points[: len(waiting)]
                velocity[waiting[: len(points)]] = part.speed * part.way

    def ended(self, position: np.ndarray) -> np.ndarray:
        """(n,) bool: who is in a sink."""
        found = np.zeros(len(position), bool)
        for sink in self.scene.sinks.values():
            found |= sink.holds(position)
        return found

    @staticmethod
    def park(position: np.ndarray, velocity: np.ndarray, gone: np.ndarray) -> None:
        """Those of that number wait."""
        position[gone], velocity[gone] = PARKED, 0.0
