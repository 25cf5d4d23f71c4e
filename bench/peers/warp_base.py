"""Common parts of the peers made with NVIDIA Warp: loading it, its devices, and steps that are captured in a graph."""

from __future__ import annotations

from abc import abstractmethod
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from softlab.bench.peers.base import Opened, Peer, PeerError, SheetStart
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    import warp

CHUNKS = (256, 32, 4, 2)  # steps in a graph; even, so that two buffers are back in place after each
REMEDY = "pip install 'soft-body-lab[peers]'"


@cache
def load_warp() -> ModuleType:
    """Return the package, quiet and initialised. Raises PeerError if it is not installed."""
    try:
        import warp

        config = warp.config
        if hasattr(config, "log_level"):
            config.log_level = warp.LOG_ERROR
        config.quiet = True  # older name of the option
        warp.init()
    except Exception as error:  # the exceptions of a broken installation are not documented
        raise PeerError(f"Warp cannot be loaded ({error}); {REMEDY}") from None
    return warp


def numbers(precision: str, components: int) -> tuple[type, type]:
    """Return Warp's types of a number in that precision, and of a vector of 2 or 3 of them."""
    wp, suffix = load_warp(), "f" if precision == "float32" else "d"
    return getattr(wp, precision), getattr(wp, f"vec{components}{suffix}")


class WarpPeer(Peer):
    """Peer on Warp.

    `backend`: "cpu" (Warp's CPU device, one thread) or "gpu" (the first CUDA device). `kind`: prefix of its name in the
    store; `title`: of its label.
    """

    kind: str
    title: str

    def __init__(self, backend: str):
        self.backend = backend
        self.name = f"{self.kind}_{backend}"
        self.label = f"{self.title} (one thread)" if backend == "cpu" else f"{self.title} in a graph"

    def available(self) -> tuple[bool, str]:
        try:
            wp = load_warp()
            if self.backend == "gpu" and not wp.is_cuda_available():
                return False, "Warp sees no CUDA device"
            if self.backend == "cpu" and not wp.is_cpu_available():
                return False, "this build of Warp has no CPU device"
        except Exception as error:
            return False, str(error)
        return True, f"Warp {wp.__version__}"

    def threads(self, wanted: int) -> int | None:
        return 1 if self.backend == "cpu" else None

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        try:
            return self.opened(scene, precision)
        except PeerError:
            raise
        except Exception as error:  # compiling and allocating fail with several kinds of exception
            raise PeerError(f"{self.title}: {error}") from error

    @abstractmethod
    def opened(self, scene: Scene, precision: str) -> Opened:
        """Return the result of `open`; may raise any error of the package."""


class Replayed(Opened):
    """Simulation on a device of Warp, whose steps are captured in graphs and replayed, on the CPU too.

    No Python runs between the steps. Subclasses: `_step`, one step that launches kernels; `_current`, 0 or 1, the one
    of two buffers that has the state, if there are two; `chunks`: steps in a graph.
    """

    chunks: tuple[int, ...] = CHUNKS

    def __init__(self, backend: str):
        self._wp = load_warp()
        self.threads = 1 if backend == "cpu" else None
        self.kernel = f"graph of {self.chunks[0]} steps"
        self._device = self._wp.get_device("cpu" if backend == "cpu" else "cuda:0")
        self._graphs: dict[tuple[int, int], object] = {}
        self._current = 0

    @abstractmethod
    def _step(self) -> None:
        """Do one step from the current buffer; swap buffers if there are two."""

    def _capture(self) -> None:
        """Capture all graphs, so that no sample includes it. Kernels must be loaded before."""
        self._step()
        self._step()
        self.synchronize()
        for chunk in self.chunks:
            self._graph(chunk)

    def _graph(self, steps: int) -> object:
        """Return the graph of `steps` steps from the current buffer, captured when it is first needed."""
        key = (self._current, steps)
        if key not in self._graphs:
            with self._wp.ScopedCapture(device=self._device, force_module_load=False) as capture:
                for _ in range(steps):
                    self._step()
            self._graphs[key] = capture.graph
        return self._graphs[key]

    def advance(self, steps: int) -> None:
        for chunk in self.chunks:
            while steps >= chunk:
                self._wp.capture_launch(self._graph(chunk))
                steps -= chunk
        for _ in range(steps):
            self._step()

    def synchronize(self) -> None:
        if self.threads is None:
            self._wp.synchronize_device(self._device)

    def close(self) -> None:
        self._graphs.clear()


class ReplayedSheet(Replayed):
    """Sheet of masses in rows and columns, two buffers in turn, a launch per step.

    `constants`: of the scene; `components` of a position, 2 or 3; `kernel(position, velocity, free, *given,
    new_position, new_velocity)`.
    """

    def __init__(
        self, constants: SheetStart, precision: str, backend: str, components: int, kernel: warp.Kernel, inputs: list
    ):
        super().__init__(backend)
        wp = self._wp
        self.constants, self._components, self._kernel, self._inputs = constants, components, kernel, inputs
        self._shape = (constants.rows, constants.columns)
        zeros = {"shape": self._shape, "dtype": numbers(precision, components)[1], "device": self._device}
        self._position, self._velocity = ([wp.zeros(**zeros) for _ in range(2)] for _ in range(2))
        self._free = wp.array(constants.free.astype(np.uint8), dtype=wp.uint8, device=self._device)
        wp.load_module(kernel.module, device=self._device)  # no module may be loaded while a graph is captured
        self._launches = [self._recorded(0), self._recorded(1)]
        self._capture()
        self.load(constants.position, constants.velocity)

    def _recorded(self, source: int) -> warp.Launch:
        target = 1 - source
        return self._wp.launch(
            self._kernel,
            dim=self._shape,
            inputs=[self._position[source], self._velocity[source], self._free, *self._inputs],
            outputs=[self._position[target], self._velocity[target]],
            device=self._device,
            record_cmd=True,
        )

    def _step(self) -> None:
        self._launches[self._current].launch()
        self._current = 1 - self._current

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._current = 0
        for target, array in ((self._position, position), (self._velocity, velocity)):
            target[0].assign(np.ascontiguousarray(array, self.constants.real).reshape(*self._shape, self._components))
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        arrays = self._position[self._current], self._velocity[self._current]
        position, velocity = (array.numpy().reshape(-1, self._components).copy() for array in arrays)
        return position, velocity

    def close(self) -> None:
        super().close()
        self._launches.clear()
        self._position, self._velocity = [], []
