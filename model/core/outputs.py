"""What `Simulation.read` returns: one declaration per output. A family lists those of its scenes (model/core/family.py)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from softlab.model.scene.scene import Scene


@dataclass(frozen=True)
class Output:
    """An output, computed from the current state when it is read.

    `shape`: in words; `compute(simulation)` returns a new host array. `write(simulation, into)`: the same into an array,
    which may be one of the device; None: through the host.
    """

    name: str
    shape: str
    unit: str
    doc: str
    compute: Callable[[Any], np.ndarray]
    write: Callable[[Any, Any], Any] | None = None

    def read(self, simulation: Any, into: Any = None) -> Any:
        """Return the output in `into`, or in a new host array."""
        if self.write is not None:
            return self.write(simulation, into)
        result = self.compute(simulation)
        if into is None:
            return result
        into[...] = result
        return into


def _on_device(name: str, shape: str, unit: str, doc: str, write: Callable[[Any, Any], Any]) -> Output:
    return Output(name, shape, unit, doc, lambda simulation: np.asarray(write(simulation, None)), write)


POSITION = _on_device(
    "position", "(particles, dimensions)", "m", "positions", lambda simulation, into: simulation._read_position(into)
)
VELOCITY = Output(
    "velocity", "(particles, dimensions)", "m/s", "velocities", lambda simulation: simulation._download()[1]
)
STRAIN = Output(
    "strain", "(springs,)", "1", "length over rest length - 1 of springs; (tetrahedra,) of tetrahedra, (particles,) density "
    "over rest density - 1 of fluids", lambda simulation: simulation._read_strain()
)  # fmt: skip
NORMAL = _on_device(
    "normal", "(particles, 3)", "1", "unit normals of a surface", lambda simulation, into: simulation._read_normal(into)
)
OF_ALL = (POSITION, VELOCITY)


def of_springs(scene: Scene) -> tuple[Output, ...]:
    """Return the outputs of grids, cloths and meshes."""
    return (STRAIN, NORMAL) if scene.dimensions == 3 else (STRAIN,)
