"""Borders written into the neighbour's memory, with a flag that a kernel there waits for: no event, no host in between.

So a whole cycle, as many steps as the halo lasts and an exchange, is captured once in a graph of each GPU, and many cycles
are replayed for the price of one launch. A wait has an end, then a look at the state says that the neighbour is lost.
Windows that share a GPU take turns instead: all have pushed before the first of them looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.device import simulated
from gpu_backend.core.launch import Graphs
from gpu_backend.domains.devices import at
from gpu_backend.domains.kernels import BLOCKS, FLAG_STRIDE, THREADS, make_border_kernels, make_moves
from gpu_backend.domains.peers import PeerSimulation
from model.core.errors import BackendUnavailable
from model.core.options import Options
from model.domains.decomposition import Border, Decomposition
from model.domains.exchange import Exchange
from model.scene.scene import Scene

FROZEN = ("resident", "stages")  # kernels whose launches carry numbers that a graph would freeze
CHUNKS = (16, 4, 2)  # cycles of a graph: even, so that buffers are back in place; more would save no time


class FlagExchange(Exchange):
    """See Exchange. `windows`: as of PeerExchange. Of each border the receiver's GPU has an inbox and flags, of each window
    its own has the number of exchanges done (`epochs`) and whether one failed (`failed`). `alone`: each has its own GPU."""

    def __init__(self, windows: Sequence[Any], decomposition: Decomposition, devices: Sequence[int]):
        self.windows, self.decomposition, self.devices = windows, decomposition, devices
        self.alone = len(set(devices)) == len(windows)
        real, axes = windows[0].real, windows[0].scene.dimensions
        self._kernels = make_border_kernels(real, axes)
        pair = np.complex64 if real is np.float32 else np.complex128
        numbers = 4 * make_moves(axes).pairs  # of a mass in an inbox: both halves, position and velocity
        borders, places = decomposition.borders, range(len(windows))
        self._inbox = {b: self._on(b.target, np.zeros(numbers * self._count(b), pair)) for b in borders}
        self._flags = {b: self._on(b.target, np.zeros(BLOCKS * FLAG_STRIDE, np.int32)) for b in borders}
        self._out = [[b for b in borders if b.source == k] for k in places]
        self._in = [[b for b in borders if b.target == k] for k in places]
        self.epochs = [self._on(k, np.zeros(1, np.int32)) for k in places]
        self.failed = [self._on(k, np.zeros(1, np.int32)) for k in places]
        self._load()

    def _count(self, border: Border) -> int:
        return border.rows * self.decomposition.columns

    def _on(self, place: int, array: np.ndarray) -> Any:
        with at(self.devices[place]):
            found = cuda.to_device(array)
            cuda.synchronize()
            return found

    def _load(self) -> None:
        """Compile and load every kernel on every GPU, by an exchange that moves nothing: a kernel that is loaded while
        another one waits could hold up what it waits for."""
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for border in self._in[place]:
                    nothing = (np.int32(0), np.int32(0), self._inbox[border], self._flags[border], self.epochs[place])
                    now = window._current
                    self._kernels.push[self._launch(window)](window.position[now], window.velocity[now], *nothing)
                    self._kernels.take[self._launch(window)](
                        window.position[now], window.velocity[now], *nothing, self.failed[place]
                    )
                self._kernels.count_on[1, 1, window.stream](self.epochs[place])
                window.synchronize()

    @staticmethod
    def _launch(window: Any) -> tuple[int, int, Any]:
        """Under the simulator, which runs every thread of every block, two small ones."""
        return (2, 8, window.stream) if simulated() else (BLOCKS, THREADS, window.stream)

    def post(self) -> None:
        for place in range(len(self.windows)):
            self.post_of(place)
        if not self.alone:
            for window in self.windows:  # nothing may wait on a GPU for what it keeps from running there
                window.synchronize()

    def wait(self) -> None:
        for place in range(len(self.windows)):
            self.wait_of(place)

    def post_of(self, place: int) -> None:
        """The borders of one window into the inboxes of its neighbours."""
        window, columns = self.windows[place], self.decomposition.columns
        now = window._current
        with at(self.devices[place]):
            for border in self._out[place]:
                self._kernels.push[self._launch(window)](
                    window.position[now], window.velocity[now], np.int32(border.from_row * columns),
                    np.int32(self._count(border)), self._inbox[border], self._flags[border], self.epochs[place],
                )  # fmt: skip

    def wait_of(self, place: int) -> None:
        """One window's halos from its inboxes, once they are there."""
        window, columns = self.windows[place], self.decomposition.columns
        now = window._current
        with at(self.devices[place]):
            for border in self._in[place]:
                self._kernels.take[self._launch(window)](
                    window.position[now], window.velocity[now], np.int32(border.to_row * columns),
                    np.int32(self._count(border)), self._inbox[border], self._flags[border], self.epochs[place],
                    self.failed[place],
                )  # fmt: skip
            self._kernels.count_on[1, 1, window.stream](self.epochs[place])

    def require_answers(self) -> None:
        """Raises BackendUnavailable where a window waited in vain."""
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                if window.fetch(self.failed[place]) != 0:
                    raise BackendUnavailable(
                        f"a neighbour of GPU {self.devices[place]} does not answer",
                        "start the run again; --link peer waits by events instead of flags",
                    )


class FlagSimulation(PeerSimulation):
    """As PeerSimulation, with a FlagExchange, and cycles in graphs where each window has a GPU to itself. `graphs`: also
    where they share one, on which windows of kernels that do not fill it run beside one another (for tests)."""

    exchange: FlagExchange
    _cycles: Sequence[Graphs] = ()

    def __init__(
        self, scene: Scene, options: Options, count: int, steps: int | None = None, graphs: bool | None = None
    ):
        self._graphs_asked = graphs
        super().__init__(scene, options, count, steps)

    def _connect(self) -> Exchange:
        exchange = FlagExchange(self.windows, self.decomposition, self.devices)
        frozen = any(window._counts or window.kernel in FROZEN for window in self.windows)
        wanted = exchange.alone if self._graphs_asked is None else self._graphs_asked
        if wanted and not simulated() and not frozen:
            self.exchange = exchange
            self._cycles = [self._graphs_of(place) for place in range(len(self.windows))]
        return exchange

    def _graphs_of(self, place: int) -> Graphs:
        def launch(parity: int, count: int) -> None:
            window = self.windows[place]
            window._current = parity
            kept, window._graphs = window._graphs, None  # whose launches are captured one by one
            try:
                for _ in range(count):
                    window._run(self.decomposition.steps)
                    self.exchange.post_of(place)
                    self.exchange.wait_of(place)
            finally:
                window._graphs = kept

        return Graphs(self.windows[place].stream, launch, lambda count: None)

    def _run(self, steps: int) -> None:
        cycles = steps // self.decomposition.steps
        done = self._replay_cycles(cycles) if self._cycles else 0
        if steps > done:
            super()._run(steps - done)

    def _replay_cycles(self, cycles: int) -> int:
        """Steps done in graphs of an even number of cycles, after which every buffer is back in its place."""
        left = cycles
        for chunk in CHUNKS:
            if left < chunk:
                continue
            for place, window in enumerate(self.windows):  # all, before the first of them waits for another
                with self._at(place):
                    parity = window._current
                    self._cycles[place].ready(parity, chunk)
                    window._current = parity
            while left >= chunk:
                for place, window in enumerate(self.windows):
                    with self._at(place):
                        self._cycles[place].replay(window._current, chunk)
                left -= chunk
        return (cycles - left) * self.decomposition.steps

    def _first_diverged(self) -> int:
        self.exchange.require_answers()
        return super()._first_diverged()

    def close(self) -> None:
        for place, graphs in enumerate(self._cycles):
            with self._at(place):
                self.windows[place].synchronize()
                graphs.close()
        self._cycles = ()
        super().close()
