"""The grid in hand-written CUDA C++ (grid.cu), compiled by NVRTC when it is first needed, replayed in a CUDA graph.

Everything goes through the driver interface of cuda.bindings, in the device's primary context, which numba and Warp use
as well. No Python runs between the steps of a graph.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers.base import GridConstants, Opened, Peer, PeerError
from model.scene.scene import Scene

SOURCE = Path(__file__).with_name("grid.cu")
BLOCK = (32, 8)  # columns, rows: as grid.cu has it
CHUNKS = (256, 32, 4, 2)  # steps in a graph; even, so that the two buffers are back in place after each
OPTIONS = ("--use_fast_math", "--std=c++17")
TYPES = {"float32": ("-DReal=float", "-DPair=float2"), "float64": ("-DReal=double", "-DPair=double2")}
MAX_BLOCKS_DOWN = 65535  # the hardware's limit in the second direction
REMEDY = "pip install -e '.[cuda13]' (or cuda12)"


def _driver() -> Any:
    from cuda.bindings import driver

    return driver


def _checked(result: tuple, what: str) -> Any:
    """What a call of cuda.bindings returned, its status apart. Raises PeerError."""
    status, *values = result
    if int(status) != 0:
        raise PeerError(f"{what}: {getattr(status, 'name', status)}")
    return values[0] if values else None


@cache
def compile_grid(precision: str, architecture: str) -> bytes:
    """Machine code of grid.cu, see `compile_source`."""
    return compile_source(SOURCE, TYPES[precision], architecture)


def compile_source(source: Path, definitions: tuple[str, ...], architecture: str) -> bytes:
    """Machine code (cubin) of a source for a real architecture such as `sm_90`: by NVRTC, else by nvcc.

    Raises PeerError where neither is here or the source does not compile. Needs no GPU.
    """
    options = [*OPTIONS, *definitions, f"--gpu-architecture={architecture}"]
    try:
        from cuda.bindings import nvrtc

        program = _checked(
            nvrtc.nvrtcCreateProgram(source.read_bytes(), source.name.encode(), 0, [], []), "nvrtcCreateProgram"
        )
    except PeerError:
        raise
    except Exception as error:  # a missing library shows as one of several kinds of exception
        return _compile_with_nvcc(source, options, f"NVRTC is not here ({error})")
    try:
        status = nvrtc.nvrtcCompileProgram(program, len(options), [option.encode() for option in options])
        if int(status[0]) != 0:
            size = _checked(nvrtc.nvrtcGetProgramLogSize(program), "nvrtcGetProgramLogSize")
            log = b" " * size
            nvrtc.nvrtcGetProgramLog(program, log)
            raise PeerError(f"NVRTC refuses {source.name}: {log.decode(errors='replace').strip()}")
        size = _checked(nvrtc.nvrtcGetCUBINSize(program), "nvrtcGetCUBINSize")
        code = b" " * size
        _checked(nvrtc.nvrtcGetCUBIN(program, code), "nvrtcGetCUBIN")
        return code
    finally:
        nvrtc.nvrtcDestroyProgram(program)


def _compile_with_nvcc(source: Path, options: list[str], reason: str) -> bytes:
    nvcc = shutil.which("nvcc")
    if nvcc is None:
        raise PeerError(f"{reason}, nor is nvcc; {REMEDY}")
    with tempfile.TemporaryDirectory(prefix="softlab-peers-") as work:
        target = Path(work) / "code.cubin"
        try:
            done = subprocess.run(
                [nvcc, "--cubin", *options, str(source), "-o", str(target)], capture_output=True, text=True, timeout=300
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise PeerError(f"{reason}, and nvcc does not run: {error}") from None
        if done.returncode:
            raise PeerError(f"{reason}, and nvcc refuses {source.name}: {(done.stderr or done.stdout).strip()}")
        return target.read_bytes()


class CudaCpp(Peer):
    """One thread a mass, one step a launch, the launches in a graph."""

    name = "cuda_cpp"
    label = "CUDA C++ in a graph"
    backend = "gpu"

    def available(self) -> tuple[bool, str]:
        try:
            driver = _driver()
            _checked(driver.cuInit(0), "cuInit")
            if not _checked(driver.cuDeviceGetCount(), "cuDeviceGetCount"):
                return False, "no CUDA device"
            compile_grid("float32", architecture())
        except Exception as error:  # no driver and no library show as several kinds of exception
            text = str(error).splitlines()[0] if str(error) else type(error).__name__
            return False, f"CUDA C++ cannot run here: {text}"
        return True, "cuda.bindings"

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Grid(_Constants(scene, precision), precision)


def architecture() -> str:
    """`sm_90`: of the first device."""
    driver = _driver()
    device = _checked(driver.cuDeviceGet(0), "cuDeviceGet")
    names = driver.CUdevice_attribute
    parts = [
        _checked(driver.cuDeviceGetAttribute(name, device), "cuDeviceGetAttribute")
        for name in (
            names.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR,
            names.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR,
        )
    ]
    return f"sm_{parts[0]}{parts[1]}"


class Sheet(Opened):
    """A sheet of masses in two buffers that swap at every step. Subclasses: `vector`, the numbers of a mass in an array;
    `function`, the kernel's name; `_compiled`, its machine code; `_constants`, what it reads besides the buffers."""

    kernel = f"graph of {CHUNKS[0]} steps"
    function: bytes
    vector: int

    def __init__(self, constants: Any, precision: str):
        self.constants = constants
        self._memory: list[Any] = []
        self._graphs: dict[tuple[int, int], Any] = {}
        self._module = self._stream = None
        driver = self._driver = _driver()
        _checked(driver.cuInit(0), "cuInit")
        self._device = _checked(driver.cuDeviceGet(0), "cuDeviceGet")
        self._context = _checked(driver.cuDevicePrimaryCtxRetain(self._device), "cuDevicePrimaryCtxRetain")
        try:
            self._enter()
            self._build(precision)
            self.load(constants.position, constants.velocity)
            self._launch(0)  # loads the kernel: nothing may be loaded while a stream is captured
            self.synchronize()
            for chunk in CHUNKS:  # no sample is to hold the capturing of a graph
                self._graph(0, chunk)
            self.load(constants.position, constants.velocity)
        except BaseException:
            self.close()
            raise

    def _build(self, precision: str) -> None:
        constants, driver = self.constants, self._driver
        self._code = np.frombuffer(self._compiled(precision), np.uint8)
        self._module = _checked(driver.cuModuleLoadData(self._code.ctypes.data), "cuModuleLoadData")
        self._function = _checked(driver.cuModuleGetFunction(self._module, self.function), "cuModuleGetFunction")
        flag = driver.CUstream_flags.CU_STREAM_NON_BLOCKING
        self._stream = _checked(driver.cuStreamCreate(int(flag)), "cuStreamCreate")
        blocks_across, blocks_down = (-(-constants.columns // BLOCK[0]), -(-constants.rows // BLOCK[1]))
        if blocks_down > MAX_BLOCKS_DOWN:
            raise PeerError(f"at most {MAX_BLOCKS_DOWN * BLOCK[1]} rows")
        self._blocks = (blocks_across, blocks_down)
        self._bytes = constants.count * self.vector * np.dtype(constants.real).itemsize
        self._position = [self._allocate(self._bytes) for _ in range(2)]
        self._velocity = [self._allocate(self._bytes) for _ in range(2)]
        self._more = self._pins()
        self._arguments = [self._argument_list(0), self._argument_list(1)]
        self._current = 0

    def _compiled(self, precision: str) -> bytes:
        """Machine code for the first device."""
        raise NotImplementedError

    def _pins(self) -> list[Any]:
        """Device arrays that the kernel takes after the buffers."""
        return []

    def _packed(self, array: np.ndarray, is_position: bool) -> np.ndarray:
        """(particles, dimensions) as the kernel wants it."""
        return np.ascontiguousarray(array, self.constants.real)

    def _allocate(self, size: int) -> Any:
        memory = _checked(self._driver.cuMemAlloc(size), "cuMemAlloc")
        self._memory.append(memory)
        return memory

    def _upload(self, target: Any, array: np.ndarray) -> None:
        _checked(self._driver.cuMemcpyHtoD(target, array.ctypes.data, array.nbytes), "cuMemcpyHtoD")

    def _argument_list(self, source: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """(addresses of the kernel's arguments, what they point to) for reading from buffer `source`."""
        constants = self.constants
        pointers = [
            self._position[source], self._velocity[source], self._position[1 - source], self._velocity[1 - source],
            *self._more,
        ]  # fmt: skip
        held = [np.array([int(pointer)], np.uint64) for pointer in pointers]
        held += [np.array([number], np.int32) for number in (constants.rows, constants.columns)]
        held.append(np.array(constants.in_order, constants.real))  # struct Constants
        return np.array([array.ctypes.data for array in held], np.uint64), held

    def _enter(self) -> None:
        """Others (numba, Warp) may have left another context current."""
        _checked(self._driver.cuCtxSetCurrent(self._context), "cuCtxSetCurrent")

    def _launch(self, source: int) -> None:
        addresses, _ = self._arguments[source]
        _checked(
            self._driver.cuLaunchKernel(
                self._function, *self._blocks, 1, *BLOCK, 1, 0, self._stream, addresses.ctypes.data, 0
            ),
            "cuLaunchKernel",
        )

    def _graph(self, source: int, steps: int) -> Any:
        """The graph of `steps` steps, the first reading buffer `source`; captured when it is first needed."""
        key = (source, steps)
        if key not in self._graphs:
            driver = self._driver
            mode = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED
            _checked(driver.cuStreamBeginCapture(self._stream, mode), "cuStreamBeginCapture")
            try:
                for step in range(steps):
                    self._launch((source + step) % 2)
            finally:
                graph = _checked(driver.cuStreamEndCapture(self._stream), "cuStreamEndCapture")
            self._graphs[key] = _checked(driver.cuGraphInstantiate(graph, 0), "cuGraphInstantiate")
            driver.cuGraphDestroy(graph)
            _checked(driver.cuGraphUpload(self._graphs[key], self._stream), "cuGraphUpload")
        return self._graphs[key]

    def advance(self, steps: int) -> None:
        self._enter()
        for chunk in CHUNKS:
            while steps >= chunk:
                _checked(self._driver.cuGraphLaunch(self._graph(self._current, chunk), self._stream), "cuGraphLaunch")
                steps -= chunk
        for _ in range(steps):
            self._launch(self._current)
            self._current = 1 - self._current

    def synchronize(self) -> None:
        self._enter()
        _checked(self._driver.cuStreamSynchronize(self._stream), "cuStreamSynchronize")

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.synchronize()
        self._current = 0
        for target, array in ((self._position, position), (self._velocity, velocity)):
            self._upload(target[self._current], self._packed(array, array is position))
        _checked(self._driver.cuCtxSynchronize(), "cuCtxSynchronize")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self.synchronize()
        arrays = []
        for source in (self._position, self._velocity):
            array = np.empty((self.constants.count, self.vector), self.constants.real)
            _checked(self._driver.cuMemcpyDtoH(array.ctypes.data, source[self._current], array.nbytes), "cuMemcpyDtoH")
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


class _Constants(GridConstants):
    @property
    def in_order(self) -> tuple[float, ...]:
        return (*super().in_order, 1 / self.dt)


class _Grid(Sheet):
    function = b"grid_step"
    vector = 2

    def _compiled(self, precision: str) -> bytes:
        return compile_grid(precision, architecture())

    def _pins(self) -> list[Any]:
        constants = self.constants
        pinned = np.zeros(constants.count, np.uint8)
        pinned[constants.pinned] = 1
        arrays = np.ascontiguousarray(pinned.reshape(constants.rows, -1).max(axis=1)), pinned
        memory = [self._allocate(array.nbytes) for array in arrays]
        for target, array in zip(memory, arrays, strict=True):
            self._upload(target, array)
        return memory
