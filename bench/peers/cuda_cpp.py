"""The grid in hand-written CUDA C++ (grid.cu), compiled by NVRTC when it is first needed, replayed in a CUDA graph.

No Python runs between the steps of a graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softlab.bench.peers import cuda_driver
from softlab.bench.peers.base import GridConstants, Opened, Peer, PeerError
from softlab.bench.peers.cuda_driver import checked
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    from cuda.bindings import driver

SOURCE = Path(__file__).with_name("grid.cu")
BLOCK = (32, 8)  # columns, rows: as in grid.cu
CHUNKS = (256, 32, 4, 2)  # launches in a graph; even, so that the two buffers are back in place after each
TYPES = {"float32": ("-DReal=float", "-DPair=float2"), "float64": ("-DReal=double", "-DPair=double2")}
MAX_BLOCKS_DOWN = 65535  # the hardware's limit in the second direction


@cache
def compile_grid(precision: str, architecture: str) -> bytes:
    """Return machine code of grid.cu, by cuda_driver.compile_source."""
    return cuda_driver.compile_source(SOURCE, TYPES[precision], architecture)


class CudaCpp(Peer):
    """One thread per mass, one step per launch, the launches in a graph."""

    name = "cuda_cpp"
    label = "CUDA C++ in a graph"
    backend = "gpu"

    def available(self) -> tuple[bool, str]:
        try:
            driver = cuda_driver.driver()
            checked(driver.cuInit(0), "cuInit")
            if not checked(driver.cuDeviceGetCount(), "cuDeviceGetCount"):
                return False, "no CUDA device"
            self.compile(cuda_driver.architecture())
        except Exception as error:  # a missing driver and a missing library raise several kinds of exception
            text = str(error).splitlines()[0] if str(error) else type(error).__name__
            return False, f"CUDA C++ cannot run here: {text}"
        return True, "cuda.bindings"

    def compile(self, architecture: str) -> bytes:
        """Return machine code, to check that there is a compiler. Raises PeerError."""
        return compile_grid("float32", architecture)

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Grid(CudaConstants(scene, precision), precision)


class Sheet(Opened):
    """Sheet of masses in two buffers that swap at every launch.

    Subclasses define `vector`, the numbers per mass in an array; `function`, the kernel's name; `block`, threads
    (across, down); `_compiled`, its machine code; `_more`, its arguments besides the buffers.
    """

    kernel = f"graph of {CHUNKS[0]} steps"
    block = BLOCK
    function: bytes
    vector: int

    def __init__(self, constants: Any, precision: str):
        self.constants = constants
        self._memory: list[driver.CUdeviceptr] = []
        self._graphs: dict[tuple[int, int], driver.CUgraphExec] = {}
        self._module = self._stream = None
        driver = self._driver = cuda_driver.driver()
        checked(driver.cuInit(0), "cuInit")
        self._device = checked(driver.cuDeviceGet(0), "cuDeviceGet")
        self._context = checked(driver.cuDevicePrimaryCtxRetain(self._device), "cuDevicePrimaryCtxRetain")
        try:
            self._enter()
            self._build(precision)
            self.load(constants.position, constants.velocity)
            self._launch(0)  # loads the kernel: no module may be loaded while a stream is captured
            self.synchronize()
            self._capture()
            self.load(constants.position, constants.velocity)
        except BaseException:
            self.close()
            raise

    def _capture(self) -> None:
        """Capture all graphs, so that no sample includes it."""
        for chunk in CHUNKS:
            self._graph(0, chunk)

    def _build(self, precision: str) -> None:
        constants, driver = self.constants, self._driver
        self._code = np.frombuffer(self._compiled(precision), np.uint8)
        self._module = checked(driver.cuModuleLoadData(self._code.ctypes.data), "cuModuleLoadData")
        self._function = checked(driver.cuModuleGetFunction(self._module, self.function), "cuModuleGetFunction")
        flag = driver.CUstream_flags.CU_STREAM_NON_BLOCKING
        self._stream = checked(driver.cuStreamCreate(int(flag)), "cuStreamCreate")
        self._blocks = self._blocks_over(constants.rows, constants.columns)
        if self._blocks[1] > MAX_BLOCKS_DOWN:
            raise PeerError(f"{constants.rows} rows are more than a launch can have blocks for")
        self._bytes = constants.count * self.vector * np.dtype(constants.real).itemsize
        self._position = [self._allocate(self._bytes) for _ in range(2)]
        self._velocity = [self._allocate(self._bytes) for _ in range(2)]
        self._more = self._pins()
        self._arguments = [self._argument_list(0), self._argument_list(1)]
        self._current = 0

    def _compiled(self, precision: str) -> bytes:
        """Return machine code for the first device."""
        raise NotImplementedError

    def _blocks_over(self, rows: int, columns: int) -> tuple[int, int]:
        """Return the blocks (across, down) of a launch."""
        return -(-columns // self.block[0]), -(-rows // self.block[1])

    def _pins(self) -> list[driver.CUdeviceptr]:
        """Return the device arrays that the kernel takes after the buffers."""
        return []

    def _packed(self, array: np.ndarray, is_position: bool) -> np.ndarray:
        """Return (particles, dimensions) in the layout of the kernel."""
        return np.ascontiguousarray(array, self.constants.real)

    def _allocate(self, size: int) -> driver.CUdeviceptr:
        memory = checked(self._driver.cuMemAlloc(size), "cuMemAlloc")
        self._memory.append(memory)
        return memory

    def _uploaded(self, arrays: Sequence[np.ndarray]) -> list[Any]:
        """Return device memory with the contents of each array."""
        memory = [self._allocate(array.nbytes) for array in arrays]
        for target, array in zip(memory, arrays, strict=True):
            self._upload(target, array)
        return memory

    def _upload(self, target: driver.CUdeviceptr, array: np.ndarray) -> None:
        checked(self._driver.cuMemcpyHtoD(target, array.ctypes.data, array.nbytes), "cuMemcpyHtoD")

    def _argument_list(self, source: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return (addresses of the kernel's arguments, the arrays they point to) for reading from buffer `source`."""
        constants = self.constants
        shape = [np.array([number], np.int32) for number in (constants.rows, constants.columns)]
        arguments = [*self._pointers(source), *shape, np.array(constants.in_order, constants.real)]
        return addresses_of(arguments), arguments

    def _pointers(self, source: int) -> list[np.ndarray]:
        """Return the kernel's pointers to the buffers, from `source` to the other, and to other inputs."""
        target = 1 - source
        buffers = (self._position[source], self._velocity[source], self._position[target], self._velocity[target])
        return [np.array([int(pointer)], np.uint64) for pointer in (*buffers, *self._more)]

    def _enter(self) -> None:
        """Make this context current, since numba or Warp may have activated another one."""
        checked(self._driver.cuCtxSetCurrent(self._context), "cuCtxSetCurrent")

    def _launch(self, source: int) -> None:
        addresses, _ = self._arguments[source]
        checked(
            self._driver.cuLaunchKernel(
                self._function, *self._blocks, 1, *self.block, 1, 0, self._stream, addresses.ctypes.data, 0
            ),
            "cuLaunchKernel",
        )

    def _graph(self, source: int, launches: int) -> driver.CUgraphExec:
        """Return the graph of that many launches, the first reading buffer `source`; captured when it is first needed."""
        key = (source, launches)
        if key not in self._graphs:
            driver = self._driver
            mode = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED
            checked(driver.cuStreamBeginCapture(self._stream, mode), "cuStreamBeginCapture")
            try:
                for number in range(launches):
                    self._launch((source + number) % 2)
            finally:
                graph = checked(driver.cuStreamEndCapture(self._stream), "cuStreamEndCapture")
            self._graphs[key] = checked(driver.cuGraphInstantiate(graph, 0), "cuGraphInstantiate")
            driver.cuGraphDestroy(graph)
            checked(driver.cuGraphUpload(self._graphs[key], self._stream), "cuGraphUpload")
        return self._graphs[key]

    def advance(self, steps: int) -> None:
        self._enter()
        self._advance(steps)

    def _advance(self, launches: int) -> None:
        for chunk in CHUNKS:
            while launches >= chunk:
                checked(self._driver.cuGraphLaunch(self._graph(self._current, chunk), self._stream), "cuGraphLaunch")
                launches -= chunk
        for _ in range(launches):
            self._launch(self._current)
            self._current = 1 - self._current

    def synchronize(self) -> None:
        self._enter()
        checked(self._driver.cuStreamSynchronize(self._stream), "cuStreamSynchronize")

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.synchronize()
        self._current = 0
        for target, array in ((self._position, position), (self._velocity, velocity)):
            self._upload(target[self._current], self._packed(array, array is position))
        checked(self._driver.cuCtxSynchronize(), "cuCtxSynchronize")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self.synchronize()
        arrays = []
        for source in (self._position, self._velocity):
            array = np.empty((self.constants.count, self.vector), self.constants.real)
            checked(self._driver.cuMemcpyDtoH(array.ctypes.data, source[self._current], array.nbytes), "cuMemcpyDtoH")
            arrays.append(np.ascontiguousarray(array[:, : self.constants.position.shape[1]]))
        return arrays[0], arrays[1]

    def close(self) -> None:
        driver = self._driver
        if self._context is None:
            return
        driver.cuCtxSetCurrent(self._context)
        driver.cuCtxSynchronize()
        for graph in self._graphs.values():
            driver.cuGraphExecDestroy(graph)
        for memory in self._memory:
            driver.cuMemFree(memory)
        if self._stream is not None:
            driver.cuStreamDestroy(self._stream)
        if self._module is not None:
            driver.cuModuleUnload(self._module)
        driver.cuDevicePrimaryCtxRelease(self._device)
        self._graphs, self._memory, self._context = {}, [], None


def addresses_of(arguments: list[np.ndarray]) -> np.ndarray:
    """Return the addresses of a kernel's arguments for a launch; `arguments` must live as long."""
    return np.array([array.ctypes.data for array in arguments], np.uint64)


class CudaConstants(GridConstants):
    """Constants with the reciprocal of the step, as in the structs of both sources."""

    @property
    def in_order(self) -> tuple[float, ...]:
        return (*super().in_order, 1 / self.dt)


class _Grid(Sheet):
    function = b"grid_step"
    vector = 2

    def _compiled(self, precision: str) -> bytes:
        return compile_grid(precision, cuda_driver.architecture())

    def _pins(self) -> list[driver.CUdeviceptr]:
        constants = self.constants
        pinned = np.zeros(constants.count, np.uint8)
        pinned[constants.pinned] = 1
        return self._uploaded([np.ascontiguousarray(pinned.reshape(constants.rows, -1).max(axis=1)), pinned])
