"""Windows on GPUs: of any kind, and of sheets."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager

from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.domains.devices import at
from softlab.model.base.components import named
from softlab.model.core.families import family_of
from softlab.model.core.options import Options
from softlab.model.core.sharing.decomposition import Decomposition
from softlab.model.core.simulation import Simulation
from softlab.model.domains.simulation import DecomposedSimulation
from softlab.model.domains.windows import WindowedSimulation
from softlab.model.scene.scene import Scene


class OnGpus(WindowedSimulation):
    """Window k of this process is on GPU `devices[k]` (model/domains/windows.py)."""

    backend = "gpu"
    devices: Sequence[int]

    def _at(self, place: int) -> AbstractContextManager[object]:
        return at(self.devices[place])

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        window: CudaSimulation = named(family_of(scene).solvers["gpu"])(scene, options)
        return window

    def _warn_of_turns(self) -> None:
        """Record in `device` that windows share a GPU."""
        count, here = len(self.devices), len(set(self.devices))
        if here < count:
            self.device = f"{count} windows on {here} x {self.windows[0].device}"


class GpuWindows(OnGpus, DecomposedSimulation):
    """Windows of a sheet, the domain `places[k]` on GPU `devices[k]` (model/domains/simulation.py)."""

    def __init__(
        self, scene: Scene, options: Options, cut: Decomposition, places: Sequence[int], devices: Sequence[int]
    ):
        self.devices = devices
        super().__init__(scene, options, cut, places)
