"""A fluid on several GPUs of one host, in one process, by slabs of space.

A window is an ordinary fluid, run by stages, like a fluid with an empty sink: its active particles come first. Windows
communicate through the host.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softlab.gpu_backend.core.device import require_gpu
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.domains.devices import devices_for
from softlab.gpu_backend.domains.windows import OnGpus
from softlab.gpu_backend.fluid.solver import Fluid
from softlab.gpu_backend.fluid.sort_kernels import AXES, BOX
from softlab.model.core.options import Options
from softlab.model.core.plan import Moment
from softlab.model.core.simulation import Simulation
from softlab.model.domains.exchange import Exchange, NothingSent
from softlab.model.domains.shared_fluid import SharedFluid
from softlab.model.domains.slabs import slabs_at_start
from softlab.model.scene.scene import Scene


class FluidWindow(Fluid):
    """The window of a GPU (model/domains/shared_fluid.py). Arrays have capacity for all of the scene's particles."""

    @property
    def _flows(self) -> bool:
        return True

    def _allocate(self) -> None:
        self.plan = replace(self.plan, parts=self.plan.parts | {"sink"})
        super()._allocate()

    def run_stage(self, name: str, moment: Moment) -> None:
        """Run one stage of the plan."""
        self.stages[name](moment)

    def box(self) -> np.ndarray:
        """Return (6,) float64 [m]: the lowest predicted positions, then the highest ones."""
        boxes = self.cells.boxes.copy_to_host(stream=self.stream)
        self.synchronize()
        boxes = boxes.reshape(-1, BOX).astype(np.float64)
        return np.concatenate([boxes[:, :AXES].min(axis=0), boxes[:, AXES:].max(axis=0)])

    def take_box(self, box: np.ndarray) -> None:
        """Use this box for the sort into cells."""
        boxes = np.tile(box.astype(self.real), self.cells.blocks)
        self.cells.boxes.copy_to_device(boxes, stream=self.stream)
        self.synchronize()

    def particles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (numbers (n,), positions and velocities (2 x dimensions, n)) of the active particles."""
        now, axes = self._current, self.scene.dimensions
        particle = self.particle[now].copy_to_host(stream=self.stream)
        self.synchronize()
        number = self._among(particle)
        arrays = []
        for array in (self.position[now], self.velocity[now]):
            quads = array[: SIZE * max(1, len(number))].copy_to_host(stream=self.stream)  # arrays there cannot be empty
            self.synchronize()
            arrays.append(quads.reshape(-1, SIZE)[: len(number), :axes].T)
        return number, np.concatenate(arrays)

    def set_particles(self, number: np.ndarray, values: np.ndarray) -> None:
        """Replace all active particles by these."""
        now, axes, count = self._current, self.scene.dimensions, len(number)
        fluid = self.scene.fluid_set.fluid[number]
        for array, some, fourth in (
            (self.position[now], values[:axes], fluid),
            (self.velocity[now], values[axes:], 0.0),
        ):
            quads = np.zeros((max(1, count), SIZE), self.real)
            quads[:count, :axes], quads[:count, 3] = some.T, fourth
            array[: quads.size].copy_to_device(quads.reshape(-1), stream=self.stream)
        particle = np.zeros(self.particle_count + 1, np.int32)
        particle[:count], particle[-1] = number, count
        self.particle[now].copy_to_device(particle, stream=self.stream)
        self.synchronize()

    def multipliers_at(self, places: np.ndarray) -> np.ndarray:
        """Return the multipliers of the last substep [m^2], by place after it."""
        multipliers: np.ndarray = self.multipliers.copy_to_host(stream=self.stream)
        self.synchronize()
        return multipliers[places]


class GpuFluid(OnGpus, SharedFluid):
    """Slabs on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        slabs = slabs_at_start(scene, count, steps, "--gpus")
        require_gpu()
        self.devices = devices_for(count)
        super().__init__(scene, options, slabs, range(count))
        self._warn_of_turns()

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return FluidWindow(scene, options)

    def _connect(self) -> Exchange:
        return NothingSent()
