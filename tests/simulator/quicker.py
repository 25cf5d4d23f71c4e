"""numba's CUDA simulator without what costs most of its time, and with the same results.

It starts a thread of Python for each of a block's, all at once, looks at them in a loop until all wait at a barrier, and
looks through a module's names at each call of a device function. Here a block's threads are greenlets that take turns: one
runs to its end or its next barrier, or until it waits for a message of another block; those that wait for nothing share one
greenlet; and names are replaced once a launch.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

import numpy as np
from greenlet import getcurrent, greenlet
from numba import cuda
from numba.cuda.simulator import kernel as simulator

from softlab.cpu_backend.core.plain import readable


class _Carrier(greenlet):  # type: ignore[misc]
    """Runs threads of a block one after the other; one that meets a barrier keeps its carrier to the end. The simulator takes
    it for the current thread."""

    syncthreads_count = simulator.BlockThread.syncthreads_count
    syncthreads_and = simulator.BlockThread.syncthreads_and
    syncthreads_or = simulator.BlockThread.syncthreads_or

    def __init__(self, manager: Any, todo: deque, grid_point: Any) -> None:
        super().__init__()
        self._manager, self.todo, self.held = manager, todo, False
        self.blockIdx = simulator.Dim3(*grid_point)

    def run(self) -> None:
        width, height, _ = self._manager._block_dim
        while self.todo and not self.held:
            x, y, z = self.todo.popleft()
            self.threadIdx, self.thread_id = simulator.Dim3(x, y, z), x + width * (y + height * z)
            try:
                self._manager._f(*self._manager.arguments)
            except Exception as error:
                where = f"tid={[x, y, z]} ctaid={list(self.blockIdx)}"
                raise type(error)(f"{where}: {error}" if str(error) else where).with_traceback(
                    error.__traceback__
                ) from None

    def syncthreads(self) -> None:
        self.held = True
        self._manager.waiting.append(self)
        self.parent.switch()

    def give_way(self) -> None:
        """Let the others go on, and other blocks, and go on after them."""
        self.held = True
        self._manager.able.append(self)
        time.sleep(0)
        self.parent.switch()


class _BlockManager(simulator.BlockManager):  # type: ignore[misc]
    """An error of a thread ends the block: it is raised here, where its greenlet was switched to; the others are dropped."""

    def run(self, grid_point: Any, *arguments: Any) -> None:
        self.arguments, self.waiting, self.able = arguments, [], deque()
        todo = deque(np.ndindex(*self._block_dim))
        while todo:
            _Carrier(self, todo, grid_point).switch()
        while self.able or self.waiting:
            if self.able:
                self.able.popleft().switch()
                continue
            met, self.waiting = self.waiting, []
            for carrier in met:
                carrier.switch()


def _readable(argument: Any) -> Any:
    """A record's constants are looked up a hundred times for each mass."""
    inner = getattr(argument, "_ary", None)
    return argument if inner is None or not inner.dtype.names else readable(inner)


_thread = threading.current_thread


def _current_thread() -> Any:
    current = getcurrent()
    return current if isinstance(current, _Carrier) else _thread()


_replaced: list[tuple[dict, str, Any]] = []
_seen: set[int] = set()
_call = simulator.FakeCUDAKernel.__call__
_configured = simulator.FakeCUDAKernel.__getitem__


def _getitem(self: Any, configuration: tuple[Any, ...]) -> Any:
    """Refuses what a driver's launch does, and the simulator takes: sizes of a grid or a block that are no int."""
    for size in configuration[:2]:
        assert all(type(number) is int for number in (size if isinstance(size, tuple) else (size,))), (
            f"a launch takes int, not {type(size).__name__}: {self.fn.__name__}"
        )
    return _configured(self, configuration)


def _called(self: Any, *arguments: Any) -> Any:
    context = simulator._kernel_context
    if context is None:  # a launch, or the host calls a device function
        if self._device:
            return self.fn(*arguments)
        try:
            return _call(self, *(_readable(argument) for argument in arguments))
        finally:
            while _replaced:
                names, name, value = _replaced.pop()
                names[name] = value
            _seen.clear()
    if self.launch is not context:
        self.launch, names = context, self.fn.__globals__
        if id(names) not in _seen:
            _seen.add(id(names))
            for name, value in names.items():
                if value is cuda:
                    _replaced.append((names, name, value))
                    names[name] = context
    return self.fn(*arguments)


def install() -> None:
    threading.current_thread = _current_thread
    simulator.BlockManager = _BlockManager
    simulator.FakeCUDAKernel.launch = None
    simulator.FakeCUDAKernel.__getitem__ = _getitem
    simulator.FakeCUDAKernel.__call__ = _called
