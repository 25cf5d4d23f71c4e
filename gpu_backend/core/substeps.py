"""Common parts of the position-based solvers on CUDA: steps of many launches, captured in graphs of many steps.

A solver implements `_substep`, the launches of a substep, and `_launches`, their number per step.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.quad_simulation import QuadSimulation
from softlab.model.core.options import unknown_kernel
from softlab.model.scene.scene import Scene

MAX_NODES = 4096  # launches per graph
LARGEST_CHUNK = 256  # steps per graph
KERNELS = ("graph", "launch", "stages")


def launched_kernel(wanted: str | None, what: str, more: tuple[str, ...] = ()) -> str:
    """Return the kernel `wanted`, or the fastest available, of solvers that only launch. Raises SceneError for any
    other.

    `more`: further kernels of the solver, for the message.
    """
    if wanted is not None and wanted not in KERNELS:
        raise unknown_kernel(wanted, (*more, *KERNELS), f"for {what} on the gpu")
    return wanted or ("graph" if can_capture() else "launch")


class Launched:
    """Steps of substeps, by launches; CudaSimulation defines `_graphs`, `_current`, `_count_on`, `_set_counter`."""

    scene: Scene
    _graphs: Graphs | None
    _current: int
    _count_on: Callable[[int], None]
    _set_counter: Callable[[int], None]

    @abstractmethod
    def _substep(self, place: int, substep: int) -> None:
        """Launch one substep, from the current buffers into the others; `place`: number of the step after the
        counter."""

    @property
    @abstractmethod
    def _launches(self) -> int:
        """Number of launches of a step."""

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
    """A position-based simulation on the GPU; model/core/simulation.py defines the contract.

    A substep in three parts allows others to take part, before and after each iteration (gpu_backend/world).
    """

    def _substep(self, place: int, substep: int) -> None:
        """Launch a substep (see Launched)."""
        self.begin_substep(place, substep)
        for iteration in range(self.scene.method.iterations):
            self.iterate(iteration)
        self.end_substep(place, substep)

    def begin_substep(self, place: int, substep: int) -> None:
        """Launch the prediction, into the other buffers, which become the current ones, and the search."""
        raise NotImplementedError

    def iterate(self, iteration: int) -> None:
        """Launch an iteration, in the current buffers."""
        raise NotImplementedError

    def end_substep(self, place: int, substep: int) -> None:
        """Launch the end of a substep."""
        raise NotImplementedError

    @property
    def inertial(self) -> DeviceArray | None:
        """Inertial positions, quads, of solvers that return to them in each iteration, else None. Displacements of
        particles by other solvers must be applied to these, too."""
        return None

    @property
    def substep_start(self) -> DeviceArray:
        """Positions at the start of the substep, quads."""
        return self.position[1 - self._current]
