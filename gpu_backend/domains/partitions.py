"""Bodies whose meshes are divided into partitions on several GPUs of one host, in one process: halos are read from the
neighbours' memory after each substep.

All work is queued on streams, nothing waits on the host: a window steps, and records an event; its neighbours' streams
wait for it, read their halos, and record another, which the window's next step waits for. Windows may share a GPU, then
they alternate on it: no kernel waits for another, so nothing can hang. The kernels that keep a whole mesh on the chip do
not support partitions: windows are launched, in graphs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, Event, require_gpu
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.domains.devices import at, connect, devices_for, new_event
from softlab.gpu_backend.domains.kernels import make_border_kernels
from softlab.gpu_backend.domains.units import StateUnits
from softlab.gpu_backend.domains.windows import OnGpus
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import Message, Partitions
from softlab.model.domains.exchange import Exchange
from softlab.model.domains.partitioned import PartitionedBodies, partitions
from softlab.model.scene.scene import Scene

THREADS = 256  # per block that reads


class ParticlesExchange(Exchange):
    """Exchange by reads (see Exchange) between windows of meshes. `windows`: simulations, window k on GPU `devices[k]`,
    each of which reads its messages."""

    def __init__(self, windows: Sequence[Any], decomposition: Partitions, devices: Sequence[int]):
        self.windows, self.devices = windows, devices
        self._into = [[one for one in decomposition.messages if one.target == k] for k in range(len(windows))]
        self._readers = [[one.target for one in decomposition.messages if one.source == k] for k in range(len(windows))]
        self._states = [StateUnits(window) for window in windows]
        self._kernels = make_border_kernels(self._states[0].unit)
        self._stepped = [self._event(k) for k in range(len(windows))]
        self._pulled = [self._event(k) for k in range(len(windows))]
        self._places: dict[tuple[int, int], tuple[DeviceArray, DeviceArray]] = {}
        for message in decomposition.messages:
            with at(devices[message.target]):
                stream, row = windows[message.target].stream, self._states[message.target].row
                self._places[message.source, message.target] = (
                    cuda.to_device(_units(message.from_places, row), stream=stream),
                    cuda.to_device(_units(message.to_places, row), stream=stream),
                )

    def _event(self, place: int) -> Event | None:
        with at(self.devices[place]):
            return new_event()

    def post(self) -> None:
        self._record(self._stepped)

    def wait(self) -> None:
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for border in self._into[place]:
                    self._await(self._stepped[border.source], window)
                    self._pull(window, border)
                window.state_taken()
        self._record(self._pulled)
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for reader in self._readers[place]:
                    self._await(self._pulled[reader], window)

    def _pull(self, window: CudaSimulation, message: Message) -> None:
        """Queue, on the window's stream, the read of the message."""
        source, target = self._states[message.source], self._states[message.target]
        here, there = self._places[message.source, message.target]
        self._kernels.pull_some[window._over(len(here), THREADS)](
            *source.now, here, *target.now, there, np.int32(len(here))
        )

    def _record(self, events: Sequence[Event | None]) -> None:
        for event, device, window in zip(events, self.devices, self.windows, strict=True):
            if event is not None:
                with at(device):
                    event.record(window.stream)

    @staticmethod
    def _await(event: Event | None, window: CudaSimulation) -> None:
        if event is not None:
            event.wait(window.stream)


def _units(places: np.ndarray, row: int) -> np.ndarray:
    """Return (n x row,) int32: the units of particles, `row` units each."""
    return (row * places[:, None] + np.arange(row)).ravel().astype(np.int32)


class GpuPartitions(OnGpus, PartitionedBodies):
    """Partitions on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        decomposition = partitions(scene, count, steps, "--gpus")
        require_gpu()
        kernel = launched_kernel(options.kernel, "a partition of tetrahedral bodies")
        self.devices = devices_for(count)
        connect(self.devices)
        super().__init__(scene, replace(options, kernel=kernel), decomposition, range(count))
        self._warn_of_turns()

    def _connect(self) -> Exchange:
        return ParticlesExchange(self.windows, self.partitions, self.devices)
