"""Bodies whose meshes are divided into partitions on several GPUs of one host, in one process: halos are read from the
neighbours' memory after each substep, as borders of a sheet are (peers.py).

The kernels that keep a whole mesh on the chip do not support partitions: windows are launched, in graphs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import require_gpu
from softlab.gpu_backend.core.substeps import launched_kernel
from softlab.gpu_backend.domains.devices import at, connect, devices_for
from softlab.gpu_backend.domains.peers import PullExchange
from softlab.gpu_backend.domains.windows import OnGpus
from softlab.model.core.options import Options
from softlab.model.core.sharing.partitions import Message, Partitions
from softlab.model.domains.exchange import Exchange
from softlab.model.domains.partitioned import PartitionedBodies, partitions
from softlab.model.scene.scene import Scene

THREADS = 256  # per block that reads


class ParticlesExchange(PullExchange):
    """Exchange between windows of meshes."""

    def __init__(self, windows: Sequence[Any], found: Partitions, devices: Sequence[int]):
        super().__init__(windows, found.messages, devices)
        self._places: dict[tuple[int, int], tuple[Any, Any]] = {}
        for message in found.messages:
            with at(devices[message.target]):
                stream, row = windows[message.target].stream, self._states[message.target].row
                self._places[message.source, message.target] = (
                    cuda.to_device(_units(message.from_places, row), stream=stream),
                    cuda.to_device(_units(message.to_places, row), stream=stream),
                )

    def _pull(self, window: Any, message: Message) -> None:
        source, mine = self._states[message.source], self._states[message.target]
        here, there = self._places[message.source, message.target]
        self._kernels.pull_some[window._over(len(here), THREADS)](
            *source.now, here, *mine.now, there, np.int32(len(here))
        )

    def _taken(self, window: Any) -> None:
        window.state_taken()


def _units(places: np.ndarray, row: int) -> np.ndarray:
    """Return (n x row,) int32: the units of particles, `row` units each."""
    return (row * places[:, None] + np.arange(row)).ravel().astype(np.int32)


class GpuPartitions(OnGpus, PartitionedBodies):
    """Partitions on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        found = partitions(scene, count, steps, "--gpus")
        require_gpu()
        kernel = launched_kernel(options.kernel, "a partition of tetrahedral bodies")
        self.devices = devices_for(count)
        connect(self.devices)
        super().__init__(scene, replace(options, kernel=kernel), found, range(count))
        self._tell_of_turns()

    def _connect(self) -> Exchange:
        return ParticlesExchange(self.windows, self.partitions, self.devices)
