"""The grid in NVIDIA Warp, as its documentation teaches: one kernel, one thread a mass, arrays of two-vectors.

On the GPU 256 steps are captured in a graph; on the CPU Warp runs on one thread, and launches are recorded once so that
Python costs little a step.
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

import numpy as np

from bench.peers.base import GridConstants, Opened, Peer, PeerError
from model.scene.scene import Scene

CHUNKS = (256, 32, 4, 2)  # steps in a graph; even, so that the two buffers are back in place after each
REMEDY = "pip install 'softlab[peers]'"


@cache
def _warp() -> Any:
    """The package, quiet and initialised. Raises PeerError where it is not here."""
    try:
        import warp

        if hasattr(warp.config, "log_level"):
            warp.config.log_level = warp.LOG_ERROR
        warp.config.quiet = True  # the older word for it
        warp.init()
    except Exception as error:  # what a broken installation raises is not documented
        raise PeerError(f"Warp cannot be loaded ({error}); {REMEDY}") from None
    return warp


@cache
def _make_kernel(precision: str) -> Any:
    wp = _warp()
    real, pair = (wp.float32, wp.vec2f) if precision == "float32" else (wp.float64, wp.vec2d)

    @wp.func
    def pull(here: pair, neighbour: pair, stiffness: real, stiffness_rest: real):
        offset = neighbour - here
        length = wp.length(offset)
        scale = real(0.0)
        if length > real(0.0):
            scale = stiffness - stiffness_rest / length
        return scale * offset

    @wp.kernel(enable_backward=False, module="unique", module_options={"fast_math": True})
    def grid_step(
        position: wp.array2d(dtype=pair),
        velocity: wp.array2d(dtype=pair),
        free: wp.array2d(dtype=wp.uint8),
        stiffness: real,
        stiffness_rest: real,
        damping: real,
        gravity: real,
        dt: real,
        half_dt_squared: real,
        new_position: wp.array2d(dtype=pair),
        new_velocity: wp.array2d(dtype=pair),
    ):
        i, j = wp.tid()
        p = position[i, j]
        v = velocity[i, j]
        acceleration = pair(real(0.0), gravity) - damping * v
        if j + 1 < position.shape[1]:
            acceleration += pull(p, position[i, j + 1], stiffness, stiffness_rest)
        if j > 0:
            acceleration += pull(p, position[i, j - 1], stiffness, stiffness_rest)
        if i + 1 < position.shape[0]:
            acceleration += pull(p, position[i + 1, j], stiffness, stiffness_rest)
        if i > 0:
            acceleration += pull(p, position[i - 1, j], stiffness, stiffness_rest)
        moved = p + dt * v + half_dt_squared * acceleration
        if free[i, j] != wp.uint8(0):
            new_position[i, j] = moved
            new_velocity[i, j] = (moved - p) / dt
        else:
            new_position[i, j] = p
            new_velocity[i, j] = pair(real(0.0), real(0.0))

    return grid_step


class WarpGrid(Peer):
    """`backend`: "cpu" (Warp's CPU device, one thread) or "gpu" (the first CUDA device, in a graph)."""

    def __init__(self, backend: str):
        self.backend = backend
        self.name = f"warp_{backend}"
        self.label = "Warp (one thread)" if backend == "cpu" else "Warp in a graph"

    def available(self) -> tuple[bool, str]:
        try:
            wp = _warp()
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
            return _Grid(GridConstants(scene, precision), precision, self.backend)
        except PeerError:
            raise
        except Exception as error:  # compiling and allocating fail with several kinds of exception
            raise PeerError(f"Warp: {error}") from error


class _Grid(Opened):
    def __init__(self, constants: GridConstants, precision: str, backend: str):
        wp = self._wp = _warp()
        self.constants = constants
        self.threads = 1 if backend == "cpu" else None
        self.kernel = "a launch a step" if backend == "cpu" else f"graph of {CHUNKS[0]} steps"
        self._device = wp.get_device("cpu" if backend == "cpu" else "cuda:0")
        self._pair = wp.vec2f if precision == "float32" else wp.vec2d
        self._shape = (constants.rows, constants.columns)
        zeros = {"shape": self._shape, "dtype": self._pair, "device": self._device}
        self._position, self._velocity = ([wp.zeros(**zeros) for _ in range(2)] for _ in range(2))
        self._free = wp.array(constants.free.astype(np.uint8), dtype=wp.uint8, device=self._device)
        self._kernel = _make_kernel(precision)
        wp.load_module(self._kernel.module, device=self._device)  # nothing may be loaded while a graph is captured
        self._launches = [self._recorded(0), self._recorded(1)]
        self._graphs: dict[tuple[int, int], Any] = {}
        self._current = 0
        if backend == "gpu":
            for chunk in CHUNKS:  # no sample is to hold the capturing of a graph
                self._graph(chunk)
        self.load(constants.position, constants.velocity)

    def _recorded(self, source: int) -> Any:
        target = 1 - source
        return self._wp.launch(
            self._kernel,
            dim=self._shape,
            inputs=[self._position[source], self._velocity[source], self._free, *self.constants.in_order],
            outputs=[self._position[target], self._velocity[target]],
            device=self._device,
            record_cmd=True,
        )

    def _launch(self, steps: int) -> None:
        for _ in range(steps):
            self._launches[self._current].launch()
            self._current = 1 - self._current

    def advance(self, steps: int) -> None:
        if self.threads is None:
            for chunk in CHUNKS:
                while steps >= chunk:
                    self._wp.capture_launch(self._graph(chunk))
                    steps -= chunk
        self._launch(steps)

    def _graph(self, steps: int) -> Any:
        """`steps` steps from the current buffer, captured when they are first needed."""
        key = (self._current, steps)
        if key not in self._graphs:
            with self._wp.ScopedCapture(device=self._device, force_module_load=False) as capture:
                self._launch(steps)
            self._graphs[key] = capture.graph
        return self._graphs[key]

    def synchronize(self) -> None:
        if self.threads is None:
            self._wp.synchronize_device(self._device)

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._current = 0
        for target, array in ((self._position, position), (self._velocity, velocity)):
            shaped = np.ascontiguousarray(array, self.constants.real).reshape(*self._shape, 2)
            target[self._current].assign(shaped)
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = (a[self._current].numpy().reshape(-1, 2) for a in (self._position, self._velocity))
        return position.copy(), velocity.copy()

    def close(self) -> None:
        self._graphs.clear()
        self._launches.clear()
        self._position, self._velocity = [], []
