"""Record the kernels that a simulation launches, and with which arguments, without running them.

Inside `recorded`, every call of a compiled kernel is noted and nothing is computed: no compilation, no change of a state.
`fake_gpu` stands in for the driver of a GPU, so that simulations of the GPU open on a machine without one. Nothing here
imports the lab, so that this file can be loaded beside the code of an older commit.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

# Constants of grids in former versions, which only the manufactured force read: no measured kernel has it
MANUFACTURED = ("amplitude", "inertia", "spacing")
BUILDING = {"squared_distances", "start_threads"}  # call compiled functions to sample a distance field, before any step


@dataclass(frozen=True)
class Launch:
    """A kernel (a dispatcher of numba) and the arguments of one of its calls."""

    kernel: object
    arguments: tuple[object, ...]


@contextmanager
def recorded() -> Iterator[list[Launch]]:
    """Record the calls of compiled CPU functions and the launches of CUDA kernels inside, without running them.

    Calls that build the initial state of a simulation are run and not recorded: their results are among the arrays.
    """
    from numba.core.registry import CPUDispatcher

    calls: list[Launch] = []
    run = CPUDispatcher.__call__

    def note(kernel: object, arguments: tuple[object, ...]) -> None:
        calls.append(Launch(kernel, arguments))

    def note_or_run(kernel: CPUDispatcher, *arguments: object) -> object:
        if sys._getframe(1).f_code.co_name in BUILDING:
            return run(kernel, *arguments)
        note(kernel, arguments)
        return None

    with ExitStack() as stack:
        stack.enter_context(patch.object(CPUDispatcher, "__call__", note_or_run, create=True))
        with suppress(ImportError):
            from numba.cuda.dispatcher import CUDADispatcher

            def launcher(kernel: object, configuration: object) -> Callable[..., None]:
                return lambda *arguments: note(kernel, arguments)

            stack.enter_context(patch.object(CUDADispatcher, "__getitem__", launcher))
        yield calls


def arrays_of(calls: list[Launch]) -> Iterator[np.ndarray | np.void]:
    """Return every array and record among the arguments of the calls, each once; of device arrays the host's copy."""
    seen: dict[int, object] = {}
    waiting: list[object] = [argument for call in calls for argument in call.arguments]
    while waiting:
        value = waiting.pop()
        if isinstance(value, tuple | list):
            waiting.extend(value)
        elif isinstance(value, DeviceArray):
            waiting.append(value.array)
        elif isinstance(value, np.ndarray | np.void) and id(value) not in seen:
            seen[id(value)] = value
            yield value


def array_hash(array: np.ndarray | np.void) -> str | None:
    """Return a hash of an array's numbers in their order, or of a record's nonzero values in any order (only names
    identify fields); None for an array of a single value, such as scratch memory."""
    names = array.dtype.names
    if names is not None:
        unread = MANUFACTURED if set(MANUFACTURED) <= set(names) else ()
        values = [np.asarray(array[name]) for name in names if name not in unread]
        known = sorted(f"{value.dtype.str} {value.tobytes().hex()}" for value in values if value.any())
        return hashlib.sha256("|".join(known).encode()).hexdigest()[:16]
    flat = np.ascontiguousarray(array).reshape(-1)
    if (
        flat.size == 0
        or flat.dtype == object
        or (flat.view(np.uint8).reshape(flat.size, -1) == flat[:1].view(np.uint8)).all()
    ):
        return None
    return hashlib.sha256(flat.dtype.str.encode() + flat.tobytes()).hexdigest()[:16]


def combined(digests: Iterable[str | None]) -> str:
    """Return one hash (16 hexadecimal digits) of a set of hashes, in any order."""
    return hashlib.sha256(" ".join(sorted(filter(None, set(digests)))).encode()).hexdigest()[:16]


# ---------------------------------------------------------------------- a GPU that is not there


class DeviceArray:
    """Host copy of an array that would be on the device."""

    def __init__(self, array: np.ndarray):
        self.array = array
        self.gpu_data = SimpleNamespace(memset=lambda *_, **__: None)

    def copy_to_device(self, other: object, stream: object = 0) -> None:
        source = other.array if isinstance(other, DeviceArray) else np.asarray(other)
        self.array.reshape(-1)[...] = source.reshape(-1).view(self.array.dtype)

    def copy_to_host(self, ary: np.ndarray | None = None, stream: object = 0) -> np.ndarray:
        if ary is None:
            return self.array.copy()
        ary[...] = self.array
        return ary

    def __getitem__(self, place: int | slice) -> DeviceArray:
        return DeviceArray(self.array[place])

    def __setitem__(self, place: int | slice, value: object) -> None:
        self.array[place] = value.array if isinstance(value, DeviceArray) else value

    def __len__(self) -> int:
        return len(self.array)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        attribute = getattr(self.array, name)
        if callable(attribute):
            return lambda *args, **how: DeviceArray(attribute(*args, **{k: v for k, v in how.items() if k != "stream"}))
        return attribute


class _Stream:
    handle = 0

    def synchronize(self) -> None:
        """Do nothing: there is nothing to wait for."""


class _Compiled:
    """Stand-in for a compiled kernel whose machine code is not needed."""

    cooperative = False

    def __init__(self, multiprocessors: int):
        function = SimpleNamespace(handle=0, device=SimpleNamespace(id=0))
        self._codelibrary = SimpleNamespace(get_cufunc=lambda: function)
        self._multiprocessors = multiprocessors

    def max_cooperative_grid_blocks(self, threads: int, shared_bytes: int = 0) -> int:
        return self._multiprocessors * max(1, 1024 // max(1, int(threads)))


H200 = {"MULTIPROCESSOR_COUNT": 132, "MAX_SHARED_MEMORY_PER_BLOCK_OPTIN": 232448, "compute_capability": (9, 0)}


@contextmanager
def fake_gpu(**attributes: object) -> Iterator[None]:
    """Make numba.cuda inside behave as with a GPU of these attributes (by default an H200's).

    Arrays are in main memory, graphs are empty. Launch kernels inside only under `recorded`.
    """
    from cuda.bindings import runtime
    from numba import cuda
    from numba.cuda import dispatcher
    from numba.cuda.cudadrv import driver

    device = SimpleNamespace(name="no GPU", id=0, **(H200 | attributes))
    context = SimpleNamespace(get_memory_info=lambda: (1 << 37, 1 << 37), device=device)
    stands_in = {
        "is_available": lambda: True,
        "get_current_device": lambda: device,
        "current_context": lambda *_: context,
        "stream": _Stream,
        "synchronize": lambda: None,
        "to_device": lambda array, stream=0, copy=True, to=None: DeviceArray(np.array(array)),
        "device_array": lambda shape, dtype=np.float64, stream=0, **_: DeviceArray(np.zeros(shape, dtype)),
        "as_cuda_array": lambda array, sync=True: array,
    }
    graph: dict[str, object] = {name: lambda *_: (0, 0) for name in ("cudaStreamEndCapture", "cudaGraphInstantiate")}
    for name in ("cudaStreamBeginCapture", "cudaGraphDestroy", "cudaGraphLaunch", "cudaGraphExecDestroy"):
        graph[name] = lambda *_: (0,)
    with ExitStack() as stack:
        for module, names in ((cuda, stands_in), (runtime, graph)):
            for name, value in names.items():
                stack.enter_context(patch.object(module, name, value))
        kernels = {"compile": lambda *_: _Compiled(device.MULTIPROCESSOR_COUNT), "typeof_pyval": lambda *_: None}
        for name, value in kernels.items():
            stack.enter_context(patch.object(dispatcher.CUDADispatcher, name, value))
        stack.enter_context(patch.object(dispatcher, "get_current_device", lambda: device))
        stack.enter_context(patch.dict(vars(driver.driver), cuKernelSetAttribute=lambda *_: None))
        yield
