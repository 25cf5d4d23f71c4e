"""A sheet on several GPUs of one host, in one process: each window on a GPU, borders read from the neighbour's memory;
and the common parts of all windows that read their messages.

All work is queued on streams, nothing waits on the host: a window steps, and records an event; its neighbours' streams
wait for it, read their halos, and record another, which the window's next step waits for. Windows may share a GPU, then
they alternate on it: no kernel waits for another, so nothing can hang.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from softlab.gpu_backend.core.device import require_gpu
from softlab.gpu_backend.domains.devices import at, connect, devices_for, new_event
from softlab.gpu_backend.domains.kernels import make_border_kernels
from softlab.gpu_backend.domains.units import StateUnits
from softlab.gpu_backend.domains.windows import OnGpus
from softlab.model.core.options import Options
from softlab.model.core.sharing.decomposition import Border, Decomposition
from softlab.model.domains.exchange import Exchange
from softlab.model.domains.simulation import DecomposedSimulation, cut
from softlab.model.scene.scene import Scene


class PullExchange(Exchange):
    """Exchange by reads (see Exchange). `windows`: simulations, window k on GPU `devices[k]`, each of which reads its
    messages (`_pull`). `messages`: all of an exchange; `columns`: of a row of state."""

    def __init__(self, windows: Sequence[Any], messages: Sequence[Any], devices: Sequence[int], columns: int = 1):
        self.windows, self.devices = windows, devices
        self._into = [[one for one in messages if one.target == k] for k in range(len(windows))]
        self._readers = [[one.target for one in messages if one.source == k] for k in range(len(windows))]
        self._states = [StateUnits(window, columns) for window in windows]
        self._kernels = make_border_kernels(self._states[0].unit)
        self._stepped = [self._event(k) for k in range(len(windows))]
        self._pulled = [self._event(k) for k in range(len(windows))]

    def _event(self, place: int) -> Any:
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
                self._taken(window)
        self._record(self._pulled)
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for reader in self._readers[place]:
                    self._await(self._pulled[reader], window)

    def _pull(self, window: Any, message: Any) -> None:
        """Queue, on the window's stream, the read of the message."""
        raise NotImplementedError

    def _taken(self, window: Any) -> None:
        """Do further work after a window has read all messages."""

    def _record(self, events: Sequence[Any]) -> None:
        for place, window in enumerate(self.windows):
            if events[place] is not None:
                with at(self.devices[place]):
                    events[place].record(window.stream)

    @staticmethod
    def _await(event: Any, window: Any) -> None:
        if event is not None:
            event.wait(window.stream)


class PeerExchange(PullExchange):
    """Exchange between windows of a sheet."""

    def __init__(self, windows: Sequence[Any], decomposition: Decomposition, devices: Sequence[int]):
        super().__init__(windows, decomposition.borders, devices, decomposition.columns)

    def _pull(self, window: Any, border: Border) -> None:
        source, mine = self._states[border.source], self._states[border.target]
        count, row = border.rows * mine.row, mine.row
        self._kernels.pull[window._over(count, 256)](
            *source.now, np.int32(border.from_row * row), *mine.now, np.int32(border.to_row * row), np.int32(count)
        )


class GpuWindows(OnGpus, DecomposedSimulation):
    """Windows of a sheet, the domain `mine[k]` on GPU `devices[k]` (model/domains/simulation.py)."""

    def __init__(self, scene: Scene, options: Options, cut: Decomposition, mine: Sequence[int], devices: Sequence[int]):
        self.devices = devices
        super().__init__(scene, options, cut, mine)


class PeerSimulation(GpuWindows):
    """Windows on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        require_gpu()
        found = cut(scene, count, steps, "--gpus")
        devices = devices_for(count)
        connect(devices)
        super().__init__(scene, options, found, range(count), devices)
        self._tell_of_turns()

    def _connect(self) -> Exchange:
        return PeerExchange(self.windows, self.decomposition, self.devices)
