"""What the position-based solvers on CUDA share: steps of many launches, captured in graphs of many steps.

A solver launches a substep (`_substep`), and says of how many launches a step is (`_launches`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from gpu_backend.core.launch import Graphs, can_capture
from gpu_backend.core.quad_simulation import QuadSimulation
from model.core.options import unknown_kernel
from model.scene.scene import Scene

MAX_NODES = 4096  # launches of one graph
LARGEST_CHUNK = 256  # steps of one graph
KERNELS = ("graph", "launch", "stages")


def launched_kernel(wanted: str | None, what: str, more: tuple[str, ...] = ()) -> str:
    """The kernel `wanted`, or the fastest there is, of solvers that only launch; `more`: kernels that are there besides, for
    the message. Raises SceneError for any other."""
    if wanted is not None and wanted not in KERNELS:
        raise unknown_kernel(wanted, (*more, *KERNELS), f"for {what} on the gpu")
    return wanted or ("graph" if can_capture() else "launch")


class Launched:
    """Steps of substeps, by launches; see CudaSimulation for what `_graphs`, `_current`, `_count_on`, `_set_counter` are."""

    scene: Scene
    _graphs: Graphs | None
    _current: int
    _count_on: Callable[[int], None]
    _set_counter: Callable[[int], None]

    @abstractmethod
    def _substep(self, place: int, substep: int) -> None:
        """Launch one substep, from the current buffers into the others; `place`: the step's after the counter."""

    @property
    @abstractmethod
    def _launches(self) -> int:
        """Of a step."""

    def _launch(self, parity: int, steps: int) -> None:
        """Launch `steps` steps, the first from the buffers `parity`."""
        self._current = parity
        for place in range(steps):
            for substep in range(self.scene.method.substeps):
                self._substep(place, substep)

    def _advance_steps(self, step: int, steps: int) -> None:
        self._set_counter(step)
        chunk = LARGEST_CHUNK
        while self._graphs is not None and steps:
            if chunk <= steps and (chunk == 1 or chunk * self._launches <= MAX_NODES):
                parity = self._current
                self._graphs.replay(parity, chunk)
                self._current = parity ^ (chunk * self.scene.method.substeps & 1)
                steps -= chunk
            else:
                chunk //= 2
        if steps:
            self._launch(self._current, steps)
            self._count_on(steps)


class SubstepSimulation(Launched, QuadSimulation):
    """A position-based simulation on the GPU. See model/core/simulation.py for the contract.

    A substep in three is one that others may take part in, before and after each iteration (gpu_backend/world)."""

    def _substep(self, place: int, substep: int) -> None:
        """See Launched."""
        self.begin_substep(place, substep)
        for iteration in range(self.scene.method.iterations):
            self.iterate(iteration)
        self.end_substep(place, substep)

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch what predicts, into the other buffers, which then are the current ones, and searches."""
        raise NotImplementedError

    def iterate(self, iteration: int) -> None:
        """Launch an iteration, in the current buffers."""
        raise NotImplementedError

    def end_substep(self, place: int, substep: int) -> None:
        """Launch what ends a substep."""
        raise NotImplementedError

    @property
    def inertial(self) -> Any:
        """Where particles would be by inertia, quads, of solvers that come back to it in each iteration: what others do to
        their particles is done to these places, too; else None."""
        return None

    @property
    def substep_start(self) -> Any:
        """Positions with which the substep began, quads."""
        return self.position[1 - self._current]
