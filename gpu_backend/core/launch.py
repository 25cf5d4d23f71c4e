"""CUDA graphs: a run of passes captured once and replayed for the cost of one launch.

A launch from Python costs 10 to 40 microseconds, a captured one about one. Captured scalars are frozen, so values that
change during a run (constants, the step counter) are in small device arrays that the kernels read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from numba import cuda

from softlab.gpu_backend.core.compile import Kernel
from softlab.gpu_backend.core.device import Arguments, Stream, simulated
from softlab.model.base.errors import BackendUnavailable

if TYPE_CHECKING:
    from cuda.bindings import runtime

CHUNKS = (256, 64, 16, 4, 2)  # passes per graph; even, so that ping-pong buffers are back in place after each


def _checked(result: tuple) -> Any:
    status, *values = result
    if int(status) != 0:
        raise RuntimeError(f"CUDA graph: {status!s}")
    return values[0] if values else None


class Graphs:
    """Runs passes over the grid through captured graphs.

    `launch(parity, count)` launches `count` passes, the first reading the buffer `parity`; `after(count)` is launched
    behind them (it advances the step counter). Graphs are cached by parity and count. Every kernel must have run once
    before: nothing may be compiled or loaded while a stream is captured.
    """

    def __init__(self, stream: Stream, launch: Callable[[int, int], None], after: Callable[[int], None]):
        try:
            from cuda.bindings import runtime
        except ImportError as error:
            raise BackendUnavailable(
                f"cuda.bindings is missing ({error})", "pip install cuda-bindings, or --kernel launch"
            ) from None
        self._runtime = runtime
        self._stream = stream
        self._launch, self._after = launch, after
        self._graphs: dict[tuple[int, int], runtime.cudaGraphExec_t] = {}

    def run(self, parity: int, count: int) -> int:
        """Run as many of `count` passes as fill even chunks; returns the rest (0 or 1)."""
        for chunk in CHUNKS:
            while count >= chunk:
                self.replay(parity, chunk)
                count -= chunk
        return count

    def replay(self, parity: int, count: int) -> None:
        """Run `count` passes as one graph, captured the first time."""
        self.ready(parity, count)
        _checked(self._runtime.cudaGraphLaunch(self._graphs[parity, count], self._handle()))

    def ready(self, parity: int, count: int) -> None:
        """Capture the graph of `count` passes from buffer `parity`, unless it exists."""
        if (parity, count) not in self._graphs:
            self._graphs[parity, count] = self._capture(parity, count)

    def _handle(self) -> runtime.cudaStream_t:
        handle = self._stream.handle  # an integer-like object of cuda.bindings, or a ctypes pointer of older versions
        return self._runtime.cudaStream_t(int(getattr(handle, "value", handle) or 0))

    def _capture(self, parity: int, count: int) -> runtime.cudaGraphExec_t:
        runtime = self._runtime
        mode = runtime.cudaStreamCaptureMode.cudaStreamCaptureModeRelaxed
        _checked(runtime.cudaStreamBeginCapture(self._handle(), mode))
        try:
            self._launch(parity, count)
            self._after(count)
        finally:
            graph = _checked(runtime.cudaStreamEndCapture(self._handle()))
        executable = _checked(runtime.cudaGraphInstantiate(graph, 0))
        _checked(runtime.cudaGraphDestroy(graph))
        return executable

    def close(self) -> None:
        for executable in self._graphs.values():
            self._runtime.cudaGraphExecDestroy(executable)
        self._graphs.clear()


def prepare(kernel: Kernel, arguments: Arguments, shared: int, cooperative: bool = False) -> None:
    """Compile a kernel for these arguments, and allow it `shared` bytes of dynamic shared memory, also above 48 KB.

    `cooperative`: all blocks are launched together or not at all.
    """
    if simulated():
        return
    from numba.cuda.cudadrv.driver import binding, driver

    compiled = kernel.compile(tuple(kernel.typeof_pyval(argument) for argument in arguments))
    function = compiled._codelibrary.get_cufunc()
    attribute = binding.CUfunction_attribute.CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES
    driver.cuKernelSetAttribute(attribute, shared, function.handle, function.device.id)
    compiled.cooperative = cooperative


def can_capture() -> bool:
    """Return True if streams can be captured: on a real GPU, not under the simulator."""
    return not simulated()


def new_stream() -> Any:
    """Return a new stream to capture and run on; the simulator has only the default one."""
    return cuda.stream() if can_capture() else 0
