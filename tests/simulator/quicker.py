"""numba's CUDA simulator without what costs most of its time, and with the same results.

It starts a thread of Python for each of a block's, all at once, looks at them in a loop until all wait at a barrier, and
looks through a module's names at each call of a device function. Here one thread of a block runs at a time, to its end or
its next barrier, or until it waits for a message of another block; those that wait for nothing share one thread of Python;
and names are replaced once a launch.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

import numpy as np
from numba import cuda
from numba.cuda.simulator import kernel as simulator


class _Carrier(simulator.BlockThread):  # type: ignore[misc]
    """Runs threads of a block one after the other; one that meets a barrier keeps its carrier to the end."""

    def __init__(self, manager: Any, todo: deque, grid_point: Any) -> None:
        super().__init__(self._run_them, manager, grid_point, todo[0], False)
        self.todo, self.turn, self.held = todo, threading.Semaphore(0), False

    def _run_them(self) -> None:
        width, height, _ = self._manager._block_dim
        while self.todo and not self.held:
            x, y, z = self.todo.popleft()
            self.threadIdx, self.thread_id = simulator.Dim3(x, y, z), x + width * (y + height * z)
            self._manager._f(*self._manager.arguments)

    def run(self) -> None:
        super().run()  # keeps an exception
        self._manager.turn.release()

    def syncthreads(self) -> None:
        self.held = True
        self._manager.waiting.append(self)
        self._manager.turn.release()
        self.turn.acquire()
        if self.abort:
            raise RuntimeError("another thread of the block ended with an error")

    def give_way(self) -> None:
        """Let the others go on, and go on after them."""
        self.held = True
        self._manager.able.append(self)
        self._manager.turn.release()
        self.turn.acquire()
        if self.abort:
            raise RuntimeError("another thread of the block ended with an error")


class _BlockManager(simulator.BlockManager):  # type: ignore[misc]
    def run(self, grid_point: Any, *arguments: Any) -> None:
        self.arguments, self.turn, self.waiting, self.able = arguments, threading.Semaphore(0), [], deque()
        todo = deque(np.ndindex(*self._block_dim))
        while todo:
            self._let(carrier := _Carrier(self, todo, grid_point), carrier.start)
        while self.able or self.waiting:
            if self.able:
                carrier = self.able.popleft()
                self._let(carrier, carrier.turn.release, list(self.able))
                continue
            met, self.waiting = self.waiting, []
            for place, carrier in enumerate(met):
                self._let(carrier, carrier.turn.release, met[place + 1 :])

    def _let(self, carrier: Any, run: Any, others: Any = ()) -> None:
        """Let a carrier run to its next barrier or its end; of an error tell all who wait."""
        run()
        self.turn.acquire()
        if carrier.exception:
            for other in [*others, *self.waiting]:
                other.abort = True
                other.turn.release()
            raise carrier.exception[0].with_traceback(carrier.exception[1])


_replaced: list[tuple[dict, str, Any]] = []
_seen: set[int] = set()
_call = simulator.FakeCUDAKernel.__call__


def _called(self: Any, *arguments: Any) -> Any:
    context = simulator._get_kernel_context() if simulator._kernel_context else None
    if context is None and not self._device:
        try:
            return _call(self, *arguments)
        finally:
            while _replaced:
                names, name, value = _replaced.pop()
                names[name] = value
            _seen.clear()
    names = self.fn.__globals__
    if context is not None and id(names) not in _seen:  # there is none where the host calls a device function
        _seen.add(id(names))
        for name, value in names.items():
            if value is cuda:
                _replaced.append((names, name, value))
                names[name] = context
    return self.fn(*arguments)


def install() -> None:
    simulator.BlockManager = _BlockManager
    simulator.FakeCUDAKernel.__call__ = _called
