"""Common parts of the GPU's simulations: alternating buffers, passes through graphs, transfers and checks.

A solver chooses its plan and kernel, checks that there is memory (`_require_memory`), and starts (`_start`): then its
`_allocate` makes the device arrays, the state first (`_allocate_state`), and its `_build` compiles every kernel.

`position`, `velocity` are two device arrays each, `_current` is the index of the state. `_integers` is the host's copy
of `integers`, number 1 the poke; `_counts`: true if the kernels read the counter of steps; `_flat`: a launch of one
thread per mass, `_grid`: of blocks over the rows and columns of a sheet; `_tools`: kernels `count` and
`first_diverged`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import (
    Arguments,
    DeviceArray,
    Stream,
    memory_info,
    require_gpu,
    simulated,
    unsupported_code,
)
from softlab.gpu_backend.core.launch import Graphs, new_stream
from softlab.gpu_backend.core.sheet import BLOCK, MAX_BLOCKS_DOWN
from softlab.model.base.errors import SceneError
from softlab.model.base.memory import require
from softlab.model.core.family import written
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options, Simulation
from softlab.model.scene.scene import Scene

NOTHING_BAD = np.iinfo(np.int32).max


class CudaSimulation(Simulation):
    """A simulation on the GPU, its state on the device throughout; model/core/simulation.py defines the contract."""

    backend = "gpu"
    position: list[DeviceArray]
    velocity: list[DeviceArray]
    stored_position: DeviceArray
    stored_velocity: DeviceArray
    integers: DeviceArray
    stream: Any  # a Stream, once the simulation has started
    _integers: np.ndarray
    _counter: DeviceArray
    _counts: bool
    _bad: DeviceArray
    _current: int
    _flat: tuple
    _tools: SimpleNamespace
    _executor: Executor
    _graphs: Graphs | None = None
    _normals: DeviceArray | None = None

    def __init__(self, scene: Scene, options: Options, stream: Stream | None = None):
        """Open the simulation. `stream`: of a world whose members run on one; None: a new one."""
        self.device = require_gpu()
        self.stream = stream
        super().__init__(scene, options)
        self.particle_count = len(self.body.position)

    @property
    def _is_rk4(self) -> bool:
        return self.scene.method.integrator == "rk4"

    # ------------------------------------------------------------------ start

    def _require_memory(self, needed: int, field: str, value: str) -> None:
        """Raise SceneError, naming the field, if the device does not have so many free bytes."""
        if not simulated():
            require(needed, memory_info()[0], field, value, "GPU memory")

    def _require_rows(self, sheet: str) -> None:
        """Raise SceneError if a launch of blocks over the sheet has more of them than CUDA allows."""
        if -(-self.body.rows // BLOCK[1]) > MAX_BLOCKS_DOWN:
            most = MAX_BLOCKS_DOWN * BLOCK[1]
            raise SceneError(
                f"{sheet}.rows", self.body.rows, f"at most {most} rows on the gpu; exchange rows and columns"
            )

    def _start(self, threads: int = 256) -> None:
        """Allocate everything for a step on the device, in the state at time 0. `threads`: of a block of `_flat`."""
        rows, columns = self.body.rows, self.body.columns
        self.stream = new_stream() if self.stream is None else self.stream
        self._flat = self._over(self.particle_count, threads)
        self._grid = ((-(-columns // BLOCK[0]), -(-rows // BLOCK[1])), BLOCK, self.stream)
        self.shape = (np.int32(rows), np.int32(columns))
        self._allocate()
        self._build_or_explain()
        self.reset()

    def _over(self, count: int, threads: int) -> tuple[int, int, Stream]:
        """Return a launch of at least `count` threads, `threads` per block."""
        return max(1, -(-count // threads)), threads, self.stream

    def on_device(self, array: np.ndarray) -> DeviceArray:
        """Return a flat device copy of an array; for an empty one, which kernels do not accept, a quad of zeros."""
        flat = np.ascontiguousarray(array).reshape(-1)
        return cuda.to_device(flat if flat.size else np.zeros(4, array.dtype), stream=self.stream)

    def zeros(self, count: int, dtype: np.dtype | type) -> DeviceArray:
        """Return a flat device array of zeros, written on the device."""
        if simulated():
            return self.on_device(np.zeros(count, dtype))
        array = cuda.device_array(count, dtype, stream=self.stream)
        array.gpu_data.memset(0, stream=self.stream)
        return array

    @abstractmethod
    def new_array(self) -> DeviceArray:
        """Return a device array of zeros for one quantity of every particle."""

    @abstractmethod
    def _allocate(self) -> None:
        """Allocate everything on the device."""

    def _allocate_state(self) -> None:
        """Allocate the common arrays of all solvers; `_integers` must be set."""
        self.position, self.velocity = [self.new_array(), self.new_array()], [self.new_array(), self.new_array()]
        self.stored_position, self.stored_velocity = self.new_array(), self.new_array()
        self._current = 0
        self.record = self.on_device(self._record)
        self.integers = self.on_device(self._integers)
        self._counter = self.on_device(np.zeros(1, np.int64))
        self._bad = self.on_device(np.full(1, NOTHING_BAD, np.int32))

    @abstractmethod
    def _build(self) -> None:
        """Compile and load every kernel."""

    def _build_or_explain(self) -> None:
        """Run `_build`; if the driver rejects the compiler's code, raise an error with the remedy."""
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
        """Do `launches` launches of `passes` passes each, through graphs if they are used."""
        if self._graphs is not None:
            parity = self._current
            launches = self._graphs.run(parity, launches)
            self._current = parity  # a graph has an even number of launches
        if launches:
            launch(self._current, launches)
            self._count_on(launches * passes)

    # ------------------------------------------------------------------ the contract

    def _run(self, steps: int) -> None:
        self._executor.run(self.step, steps)

    def _store_snapshot(self) -> None:
        self.stored_position.copy_to_device(self.position[self._current], stream=self.stream)
        self.stored_velocity.copy_to_device(self.velocity[self._current], stream=self.stream)

    def _restore(self) -> None:
        self.position[self._current].copy_to_device(self.stored_position, stream=self.stream)
        self.velocity[self._current].copy_to_device(self.stored_velocity, stream=self.stream)

    def _first_diverged(self) -> int:
        self._bad.copy_to_device(np.full(1, NOTHING_BAD, np.int32), stream=self.stream)
        state = self.position[self._current], self.velocity[self._current]
        self._tools.first_diverged[self._flat](*state, self.real(self._bound), *self._middle(), self._bad)
        bad = self.fetch(self._bad)
        return -1 if bad == NOTHING_BAD else bad

    def _middle(self) -> tuple[np.floating, ...]:
        """Return (x, y, z) [m] of the scene's centre, from which divergence is measured; a plane is at z = 0."""
        return tuple(map(self.real, (*self._centre, 0.0)[:3]))

    def fetch(self, array: DeviceArray) -> int:
        """Return the first number of a device array, after everything queued is done."""
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return int(host[0])

    def _parameters_changed(self) -> None:
        self._integers[1] = self._poke_particle + 1
        self.record.copy_to_device(self._record, stream=self.stream)
        self.integers.copy_to_device(self._integers, stream=self.stream)
        self.synchronize()

    @abstractmethod
    def _to_host(self, array: DeviceArray) -> np.ndarray:
        """Return a device array of the state as (particles, dimensions)."""

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return self._to_host(self.position[self._current]), self._to_host(self.velocity[self._current])

    def _read_position(self, into: Any) -> Any:
        if into is not None and hasattr(into, "__cuda_array_interface__"):
            out = cuda.as_cuda_array(into)
            self._tools.write_position[self._flat](self.position[self._current], out)
            self.synchronize()
            return into
        return written(self._to_host(self.position[self._current]), into)

    def _normal_arguments(self) -> Arguments:
        """Return the arguments of `write_normal` about the sheet, besides positions."""
        return np.int32(self.body.rows), np.int32(self.body.columns)

    def _read_normal(self, into: Any) -> Any:
        """Return unit vertex normals (particles, 3) of a cloth, computed on the device by `write_normal` of
        mass_spring/cloth/kernels.py."""
        on_device = into is not None and hasattr(into, "__cuda_array_interface__")
        if not on_device and self._normals is None:
            self._normals = cuda.to_device(np.zeros(self.body.position.shape, self.real), stream=self.stream)
        out = cuda.as_cuda_array(into) if on_device else self._normals
        assert out is not None
        self._tools.write_normal[self._flat](self.position[self._current], out, *self._normal_arguments())
        self.synchronize()
        if on_device:
            return into
        host = out.copy_to_host(stream=self.stream)
        self.synchronize()
        return written(host, into)

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
