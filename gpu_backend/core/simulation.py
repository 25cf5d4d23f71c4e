"""What the GPU's simulations share: buffers in turn, passes through graphs, and the contract's copies and looks.

A solver chooses its plan and kernel, asks whether there is room (`_require_memory`), and starts (`_start`): then its
`_allocate` makes what lies on the device, the state first (`_allocate_state`), and its `_build` compiles every kernel.

`position`, `velocity` are two device arrays each, `_current` tells which pair is the state. `_integers` is the host's copy of
`integers`, number 1 the poke; `_counts`: whether the kernels read the counter of steps; `_flat`: a launch of a thread a mass,
`_grid`: of blocks over the rows and columns of a sheet; `_tools`: kernels `count` and `first_diverged`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.device import memory_info, require_gpu, simulated, unsupported_code
from gpu_backend.core.launch import Graphs, new_stream
from gpu_backend.core.sheet import BLOCK, MAX_BLOCKS_DOWN
from model.core.errors import SceneError
from model.core.memory import require
from model.core.plan import Executor
from model.core.simulation import Options, Simulation
from model.scene.scene import Scene

NOTHING_BAD = np.iinfo(np.int32).max


class CudaSimulation(Simulation):
    """A simulation on the GPU, its state on the device throughout. See model/core/simulation.py for the contract."""

    backend = "gpu"
    position: list[Any]
    velocity: list[Any]
    kept_position: Any
    kept_velocity: Any
    parameters: Any
    integers: Any
    stream: Any
    _integers: np.ndarray
    _counter: Any
    _counts: bool
    _bad: Any
    _current: int
    _flat: tuple
    _tools: Any
    _executor: Executor
    _graphs: Graphs | None = None
    _normals: Any = None

    def __init__(self, scene: Scene, options: Options, stream: Any = None):
        """`stream`: of a world whose members run on one; None: one of its own."""
        self.device = require_gpu()
        self.stream = stream
        super().__init__(scene, options)
        self.particle_count = len(self.body.position)

    @property
    def _is_rk4(self) -> bool:
        return self.scene.method.integrator == "rk4"

    # ------------------------------------------------------------------ the start

    def _require_memory(self, needed: int, field: str, value: str) -> None:
        """Raise SceneError, naming the field, where the device has no room for so many bytes."""
        if not simulated():
            require(needed, memory_info()[0], field, value, "GPU memory")

    def _require_rows(self, sheet: str) -> None:
        """Raise SceneError where a launch of blocks over the sheet has more of them than CUDA takes."""
        if -(-self.body.rows // BLOCK[1]) > MAX_BLOCKS_DOWN:
            most = MAX_BLOCKS_DOWN * BLOCK[1]
            raise SceneError(f"{sheet}.rows", self.body.rows, f"at most {most} rows on the gpu; turn the sheet")

    def _start(self, threads: int = 256) -> None:
        """Everything that a step needs, on the device, in the state at time 0. `threads`: of a block of `_flat`."""
        rows, columns = self.body.rows, self.body.columns
        self.stream = new_stream() if self.stream is None else self.stream
        self._flat = self._over(self.particle_count, threads)
        self._grid = ((-(-columns // BLOCK[0]), -(-rows // BLOCK[1])), BLOCK, self.stream)
        self.shape = (np.int32(rows), np.int32(columns))
        self._allocate()
        self._build_or_explain()
        self.reset()

    def _over(self, count: int, threads: int) -> tuple[int, int, Any]:
        """A launch of at least `count` threads, `threads` a block."""
        return max(1, -(-count // threads)), threads, self.stream

    def on_device(self, array: np.ndarray) -> Any:
        """A flat copy of an array; of an empty one, which kernels do not take, a quad of zeros."""
        flat = np.ascontiguousarray(array).reshape(-1)
        return cuda.to_device(flat if flat.size else np.zeros(4, array.dtype), stream=self.stream)

    def zeros(self, count: int, dtype: Any) -> Any:
        """A flat device array of zeros, which are made there."""
        if simulated():
            return self.on_device(np.zeros(count, dtype))
        found: Any = cuda.device_array(count, dtype, stream=self.stream)
        found.gpu_data.memset(0, stream=self.stream)
        return found

    @abstractmethod
    def new_array(self) -> Any:
        """A device array of zeros for one quantity of every particle."""

    @abstractmethod
    def _allocate(self) -> None:
        """Everything on the device."""

    def _allocate_state(self) -> None:
        """What every solver has there; `_integers` has been set."""
        self.position, self.velocity = [self.new_array(), self.new_array()], [self.new_array(), self.new_array()]
        self.kept_position, self.kept_velocity = self.new_array(), self.new_array()
        self._current = 0
        self.record = self.on_device(self._record)
        self.integers = self.on_device(self._integers)
        self._counter = self.on_device(np.zeros(1, np.int64))
        self._bad = self.on_device(np.full(1, NOTHING_BAD, np.int32))

    @abstractmethod
    def _build(self) -> None:
        """Compile and load every kernel."""

    def _build_or_explain(self) -> None:
        """`_build`; where the driver does not take the compiler's code, with what to do about it."""
        try:
            self._build()
        except Exception as error:
            better = unsupported_code(error)
            if better is None:
                raise
            raise better from error

    # ------------------------------------------------------------------ passes

    def _count_on(self, passes: int) -> None:
        if self._counts:
            self._tools.count[1, 1, self.stream](self._counter, np.int64(passes))

    def _set_counter(self, step: int) -> None:
        if self._counts:
            self._counter.copy_to_device(np.array([step], np.int64), stream=self.stream)

    def _repeat(self, launches: int, launch: Callable[[int, int], None], passes: int) -> None:
        """`launches` launches of `passes` passes each, through graphs where they are used."""
        if self._graphs is not None:
            parity = self._current
            launches = self._graphs.run(parity, launches)
            self._current = parity  # a graph holds an even number of launches
        if launches:
            launch(self._current, launches)
            self._count_on(launches * passes)

    # ------------------------------------------------------------------ the contract

    def _run(self, steps: int) -> None:
        self._executor.run(self.step, steps)

    def _keep(self) -> None:
        self.kept_position.copy_to_device(self.position[self._current], stream=self.stream)
        self.kept_velocity.copy_to_device(self.velocity[self._current], stream=self.stream)

    def _restore(self) -> None:
        self.position[self._current].copy_to_device(self.kept_position, stream=self.stream)
        self.velocity[self._current].copy_to_device(self.kept_velocity, stream=self.stream)

    def _first_diverged(self) -> int:
        self._bad.copy_to_device(np.full(1, NOTHING_BAD, np.int32), stream=self.stream)
        state = self.position[self._current], self.velocity[self._current]
        self._tools.first_diverged[self._flat](*state, self.real(self._bound), *self._middle(), self._bad)
        bad = self.fetch(self._bad)
        return -1 if bad == NOTHING_BAD else bad

    def _middle(self) -> tuple[Any, ...]:
        """(x, y, z) [m] of the scene's centre, from which divergence is measured; a plane lies at z = 0."""
        return tuple(map(self.real, (*self._centre, 0.0)[:3]))

    def fetch(self, array: Any) -> int:
        """The first number of a device array, once everything asked for has been done."""
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return int(host[0])

    def _parameters_changed(self) -> None:
        self._integers[1] = self._poke_particle + 1
        self.record.copy_to_device(self._record, stream=self.stream)
        self.integers.copy_to_device(self._integers, stream=self.stream)
        self.synchronize()

    @abstractmethod
    def _to_host(self, array: Any) -> np.ndarray:
        """A device array of the state as (particles, dimensions)."""

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return self._to_host(self.position[self._current]), self._to_host(self.velocity[self._current])

    def _read_position(self, into: Any) -> Any:
        if into is not None and hasattr(into, "__cuda_array_interface__"):
            out = cuda.as_cuda_array(into)
            self._tools.write_position[self._flat](self.position[self._current], out)
            self.synchronize()
            return into
        position = self._to_host(self.position[self._current])
        if into is None:
            return position
        into[...] = position
        return into

    def _normal_arguments(self) -> tuple[Any, ...]:
        """What `write_normal` wants to know of the sheet besides positions."""
        return np.int32(self.body.rows), np.int32(self.body.columns)

    def _read_normal(self, into: Any) -> Any:
        """Unit vertex normals (particles, 3) of a cloth, computed on the device: see `write_normal` in
        mass_spring/cloth/kernels.py."""
        on_device = into is not None and hasattr(into, "__cuda_array_interface__")
        if not on_device and self._normals is None:
            self._normals = cuda.to_device(np.zeros(self.body.position.shape, self.real), stream=self.stream)
        out = cuda.as_cuda_array(into) if on_device else self._normals
        self._tools.write_normal[self._flat](self.position[self._current], out, *self._normal_arguments())
        self.synchronize()
        if on_device:
            return into
        host = out.copy_to_host(stream=self.stream)
        self.synchronize()
        if into is None:
            return host
        into[...] = host
        return into

    def synchronize(self) -> None:
        """Wait for the stream."""
        if simulated():
            cuda.synchronize()
        else:
            self.stream.synchronize()

    def close(self) -> None:
        super().close()
        if self._graphs is not None:
            self.synchronize()
            self._graphs.close()
            self._graphs = None
