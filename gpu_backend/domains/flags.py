"""Borders written into the neighbour's memory, with a flag that a kernel there waits for: no event, no host in between.

So a whole cycle, as many steps as the halo lasts and an exchange, is captured once in a graph of each GPU, and many
cycles are replayed for the cost of one launch. A wait has a timeout, after which a check of the state reports the
neighbour as lost. Windows that share a GPU alternate instead: all have pushed before the first of them waits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, Stream, require_gpu, simulated
from softlab.gpu_backend.core.launch import Graphs
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.domains.devices import at, connect, devices_for
from softlab.gpu_backend.domains.kernels import FLAG_STRIDE, MOST_BLOCKS, THREADS, blocks_for, make_border_kernels
from softlab.gpu_backend.domains.units import StateUnits
from softlab.gpu_backend.domains.windows import GpuWindows
from softlab.gpu_backend.mass_spring.bands import Bands
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.options import Options
from softlab.model.core.sharing.decomposition import Border, Decomposition
from softlab.model.domains.exchange import Exchange
from softlab.model.domains.simulation import cut
from softlab.model.scene.scene import Scene

FROZEN = ("resident", "stages")  # kernels whose launches have numbers that a graph would freeze
CHUNKS = (16, 4, 2)  # cycles per graph: even, so that buffers are back in place; more would save no time


class FlagExchange(Exchange):
    """Exchange by flags (see Exchange). `windows`: simulations, window k on GPU `devices[k]`.

    For each border, the GPU of the receiver has an inbox, flags, and the number of exchanges that it received; the GPU of
    the sender has the number that each of its blocks sent. The GPU of each window has a flag of failed exchanges.
    `alone`: True if each window has its own GPU.
    """

    def __init__(self, windows: Sequence[CudaSimulation], decomposition: Decomposition, devices: Sequence[int]):
        self.windows, self.decomposition, self.devices = windows, decomposition, devices
        self.alone = len(set(devices)) == len(windows)
        self.states = [StateUnits(window, decomposition.columns) for window in windows]
        self._kernels = make_border_kernels(self.states[0].unit)
        borders, places = decomposition.borders, range(len(windows))
        zeros = np.zeros(MOST_BLOCKS, np.int32)
        self._inbox = {b: self._on(b.target, np.zeros(4 * self._count(b), self.states[0].unit)) for b in borders}
        self._flags = {b: self._on(b.target, np.zeros(MOST_BLOCKS * FLAG_STRIDE, np.int32)) for b in borders}
        self._sent = {b: self._on(b.source, zeros) for b in borders}
        self._taken = {b: self._on(b.target, zeros[:1]) for b in borders}
        self.out = [[b for b in borders if b.source == k] for k in places]
        self.into = [[b for b in borders if b.target == k] for k in places]
        self.failed = [self._on(k, np.zeros(1, np.int32)) for k in places]
        self._load()

    def _count(self, border: Border) -> int:
        return border.rows * self.states[0].row

    def _on(self, place: int, array: np.ndarray) -> DeviceArray:
        with at(self.devices[place]):
            copy = cuda.to_device(array)
            cuda.synchronize()
            return copy

    def _load(self) -> None:
        """Compile and load every kernel on every GPU, by an exchange of no data: loading a kernel while another one
        waits could block the kernel that it waits for."""
        for give in (True, False):
            for place, window in enumerate(self.windows):
                with at(self.devices[place]):
                    for border in self.out[place] if give else self.into[place]:
                        (self.push if give else self.take)(border, window.stream, nothing=True)
                    window.synchronize()

    def _launch(self, border: Border, stream: Stream) -> tuple[int, int, Stream]:
        """Return the launch configuration; under the simulator, which runs every thread of every block, two small
        blocks."""
        return (2, 8, stream) if simulated() else (blocks_for(self._count(border)), THREADS, stream)

    def push(self, border: Border, stream: Stream, nothing: bool = False) -> None:
        """Push a border into the inbox of its target, queued on the GPU of its source."""
        state, count = self.states[border.source], 0 if nothing else self._count(border)
        self._kernels.push[self._launch(border, stream)](
            *state.now, np.int32(border.from_row * state.row), np.int32(count), self._inbox[border], self._flags[border],
            self._sent[border],
        )  # fmt: skip

    def take(self, border: Border, stream: Stream, nothing: bool = False) -> None:
        """Copy a halo from the inbox, once it has arrived, queued on the GPU of its target."""
        state, count = self.states[border.target], 0 if nothing else self._count(border)
        launch = self._launch(border, stream)
        self._kernels.wait[1, MOST_BLOCKS, stream](
            self._flags[border], np.int32(launch[0]), self._taken[border], self.failed[border.target]
        )
        self._kernels.take[launch](
            *state.now, np.int32(border.to_row * state.row), np.int32(count), self._inbox[border], self._taken[border]
        )

    def post(self) -> None:
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for border in self.out[place]:
                    self.push(border, window.stream)
        if not self.alone:
            for window in self.windows:  # a wait on a GPU must not block the work that it waits for
                window.synchronize()

    def wait(self) -> None:
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                for border in self.into[place]:
                    self.take(border, window.stream)

    def require_answers(self) -> None:
        """Raise BackendUnavailable if a window timed out."""
        for place, window in enumerate(self.windows):
            with at(self.devices[place]):
                if window.fetch(self.failed[place]) != 0:
                    raise BackendUnavailable(
                        f"a neighbour of GPU {self.devices[place]} does not answer",
                        "start the run again, or use --link nccl",
                    )


class FlagSimulation(GpuWindows):
    """Windows on the GPUs of this machine, `count` of them, with cycles in graphs if each window has its own GPU.

    `graphs`: also if they share one, on which windows of kernels that do not fill it run concurrently (for tests).
    """

    exchange: FlagExchange
    _bands: Sequence[Bands | None] = ()
    _cycles: Sequence[Graphs] = ()

    def __init__(
        self, scene: Scene, options: Options, count: int, steps: int | None = None, graphs: bool | None = None
    ):
        self._graphs_asked = graphs
        require_gpu()
        decomposition, devices = cut(scene, count, steps, "--gpus"), devices_for(count)
        connect(devices)
        super().__init__(scene, options, decomposition, range(count), devices)
        self._warn_of_turns()

    def _connect(self) -> Exchange:
        exchange = FlagExchange(self.windows, self.decomposition, self.devices)
        frozen = any(window._counts or window.kernel in FROZEN for window in self.windows)
        wanted = exchange.alone if self._graphs_asked is None else self._graphs_asked
        if wanted and not simulated() and not frozen:
            self.exchange = exchange
            self._bands = [self._bands_of(place) for place in range(len(self.windows))]
            self._cycles = [self._graphs_of(place) for place in range(len(self.windows))]
        return exchange

    def _bands_of(self, place: int) -> Bands | None:
        """Return the bands of a window, so that an exchange only delays the rows at its edge."""
        window, touched = self.windows[place], 2 * self.decomposition.halo
        if window.kernel != "tiles" or not hasattr(window._tiles, "bands") or "middle" in window._passes:
            return None
        above, below = place > 0, place < len(self.windows) - 1
        with self._at(place):
            bands: Bands | None = window._tiles.bands(touched * above, touched * below)
            return bands

    def _graphs_of(self, place: int) -> Graphs:
        window, bands = self.windows[place], self._bands[place]

        def launch(parity: int, count: int) -> None:
            window._current = parity
            graphs, window._graphs = window._graphs, None  # so that its launches are captured one by one
            try:
                for _ in range(count):
                    window._run(self.decomposition.steps)
                    for border in self.exchange.out[place]:
                        self.exchange.push(border, window.stream)
                    for border in self.exchange.into[place]:
                        self.exchange.take(border, window.stream)
            finally:
                window._graphs = graphs

        def launch_bands(parity: int, count: int) -> None:
            assert bands is not None
            window._current = parity
            bands.fork()
            for _ in range(count):
                for steps in window._tiles.parts_of(self.decomposition.steps):
                    window._tiles.launch_in(bands, 0, steps)
                for border in self.exchange.out[place]:
                    self.exchange.push(border, bands.streams[_edge(border.target > place)])
                for border in self.exchange.into[place]:
                    self.exchange.take(border, bands.streams[_edge(border.source > place)])
            bands.join()

        return Graphs(window.stream, launch if bands is None else launch_bands, lambda count: None)

    def _run_windows(self, first: int, steps: int) -> None:
        done = self._replay_cycles(steps // self.decomposition.steps) if self._cycles else 0
        super()._run_windows(first + done, steps - done)

    def _replay_cycles(self, cycles: int) -> int:
        """Return the number of steps of windows done in graphs of an even number of cycles, after which every buffer is
        back in its place."""
        left = cycles
        for chunk in CHUNKS:
            if left < chunk:
                continue
            for place, window in enumerate(self.windows):  # all are launched before the first of them waits for another
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
                bands = self._bands[place]
                if bands is not None:
                    bands.close()
        self._cycles = self._bands = ()
        super().close()


def _edge(below: bool) -> int:
    """Return the index of a window's band at its edge below, or above."""
    return -1 if below else 0
