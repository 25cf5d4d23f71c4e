"""The lab's own XPBD as a peer that approaches implicit Euler's step of the same springs by a few iterations."""

from __future__ import annotations

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.peers.base import Opened, Peer
from softlab.bench.peers.cuda_cpp_cloth import cloth_refusal
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

IMPLICIT = ("implicit-16", "implicit-4", "implicit-1")  # words of bench/peers/scenes.py
APPROACHES = 0.05  # spacings: largest distance of an iterative solver from implicit Euler's step


def implicit_refusal(scene: Scene) -> str | None:
    """Return why an iterative solver of implicit Euler's step (springs without dampers, gravity, pins) cannot run the
    scene.
    """
    if scene.method.solver != "mass-spring" or scene.method.integrator != "implicit-euler":
        return f"it approaches implicit Euler, not {scene.method.label}"
    refusal = cloth_refusal(scene.replace({"method.integrator": "semi-implicit-euler"}))
    if refusal is None and any(springs.damping > 0 for springs in scene.cloth_springs.values()):
        return "its springs' dampers are others"
    return refusal


class LabXpbd(Peer):
    """The lab's XPBD, Gauss-Seidel by colours."""

    scenes: tuple[str, ...] = IMPLICIT

    def __init__(self, backend: str, iterations: int):
        self.backend, self.iterations = backend, iterations
        self.name = f"softlab_xpbd_{iterations}_{backend}"
        self.label = f"softlab XPBD, {iterations} iterations"

    def available(self) -> tuple[bool, str]:
        if self.backend == "gpu":
            from softlab.gpu_backend.core.device import gpu_available

            able, reason = gpu_available()
            if not able:
                return False, reason.splitlines()[0]
        return True, "the lab itself"

    def refusal(self, scene: Scene) -> str | None:
        return implicit_refusal(scene)

    def bound(self, scene: Scene, precision: str) -> float:
        return APPROACHES

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        solved = scene.replace({"method.solver": "xpbd", "method.iterations": self.iterations})
        return LabSimulation(open_simulation(solved, self.backend, threads=threads, precision=precision))


class LabSimulation(Opened):
    """A simulation of the lab in the form of a peer's, with its `threads`."""

    def __init__(self, simulation: Simulation):
        self._simulation = simulation
        self.threads = simulation.threads if simulation.backend == "cpu" else None
        self.kernel = simulation.kernel

    def advance(self, steps: int) -> None:
        self._simulation.advance(steps)

    def synchronize(self) -> None:
        self._simulation.synchronize()

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._simulation.load(State(position, velocity, self._simulation.body.inverse_mass, 0.0, 0))

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._simulation.read("position"), self._simulation.read("velocity")

    def close(self) -> None:
        self._simulation.close()
