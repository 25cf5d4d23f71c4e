"""Spray and foam of a run whose last state is drawn. They depend on the history, so they are updated frame by frame, as
in a clip."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.model.core.simulation import Simulation
from softlab.model.fluid.foam import FoamPoints
from softlab.model.scene.scene import Scene
from softlab.model.tables.fluid import Foam

FRAME = 1 / 60  # s


def shows_foam(scene: Scene, view_options: Sequence[str]) -> bool:
    """Return True if pictures of a scene with these view options show foam."""
    return bool(scene.fluids) and ("foam" in view_options or scene.foam is not None)


def frame_steps(simulation: Simulation, frame: float = FRAME) -> int:
    """Number of steps whose duration is nearest to `frame` [s], at least 1."""
    return max(1, round(frame / simulation.scene.method.dt))


class Foaming:
    """Updates the `points` of a run frame by frame."""

    def __init__(self, simulation: Simulation):
        self.points = FoamPoints(simulation.scene, simulation.scene.foam or Foam())
        self.every = frame_steps(simulation)
        self.observe(simulation)

    def observe(self, simulation: Simulation) -> None:
        """Update the points from the current state, with which a frame ends."""
        self.points.follow(simulation.read("position"), simulation.read("velocity"), simulation.time)
