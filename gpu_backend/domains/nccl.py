"""A sheet on several GPUs of one host or of many: a process of MPI for each, borders sent by NCCL.

Written against the documentation of nccl4py 0.6 (NVIDIA, "NCCL4Py": Communicator.init, send, recv, group; get_unique_id). It
has never run: it was written where there is no GPU. What is the same for every way of sending (model/domains, the windows)
is tested without it. NVLink multicast is left off (NCCL_NVLS_ENABLE=0), since a group of two asks for nothing of it.
"""

from __future__ import annotations

import os
import time
from contextlib import AbstractContextManager
from importlib.util import find_spec
from typing import Any

import numpy as np

from gpu_backend.core.device import require_gpu
from gpu_backend.core.quads import SIZE
from gpu_backend.domains.devices import at, gpu_count, new_event, sharing
from model.core.errors import BackendUnavailable, SceneError
from model.core.families import family_of
from model.core.family import named
from model.core.options import Options
from model.core.simulation import Simulation
from model.domains.decomposition import Border, Decomposition
from model.domains.exchange import PATIENCE, Exchange
from model.domains.processes import gather_rows, largest_of, lost, mpi
from model.domains.simulation import DecomposedSimulation, cut
from model.scene.scene import Scene

INSTALL = 'pip install "nccl4py[cu13]" (or [cu12]) and the lab\'s extra mpi'
NAP = 1e-4  # s, between two looks at an event


def nccl() -> Any:
    """The module nccl.core of nccl4py. Raises BackendUnavailable."""
    if find_spec("nccl") is None:
        raise BackendUnavailable("nccl4py is not installed", INSTALL)
    os.environ.setdefault("NCCL_NVLS_ENABLE", "0")
    try:
        import nccl.core as found
    except ImportError as error:  # of the library that it speaks to
        raise BackendUnavailable(f"NCCL cannot be loaded ({error})", INSTALL) from None
    return found


class NcclExchange(Exchange):
    """See Exchange. All that is sent and received in an exchange is one group on the window's stream, which orders it with
    the steps before and after."""

    def __init__(self, window: Any, decomposition: Decomposition, world: Any):
        self.window, self.decomposition, self._world, self.rank = window, decomposition, world, world.Get_rank()
        self._out = [border for border in decomposition.borders if border.source == self.rank]
        self._in = [border for border in decomposition.borders if border.target == self.rank]
        self._nccl = nccl()
        mine = self._nccl.get_unique_id() if self.rank == 0 else None
        self._group = self._nccl.Communicator.init(world.Get_size(), self.rank, world.bcast(mine, root=0))
        handle = window.stream.handle
        self._stream = int(getattr(handle, "value", handle) or 0)
        self._done = new_event()

    def _run_of(self, array: Any, row: int, border: Border) -> Any:
        """The rows of a border as real numbers, which NCCL knows: of pairs in a plane, of quads in space."""
        numbers = self.decomposition.columns * (2 if self.window.scene.dimensions == 2 else SIZE)
        return array.view(self.window.real)[row * numbers : (row + border.rows) * numbers]

    def post(self) -> None:
        now = self.window._current
        state = self.window.position[now], self.window.velocity[now]
        with self._nccl.group():
            for border in self._out:
                for array in state:
                    self._group.send(self._run_of(array, border.from_row, border), border.target, stream=self._stream)
            for border in self._in:
                for array in state:
                    self._group.recv(self._run_of(array, border.to_row, border), border.source, stream=self._stream)

    def wait(self) -> None:
        """The stream waits by itself; `require_answers` for how long."""

    def require_answers(self) -> None:
        """Return when all that was asked for has been done. Raises BackendUnavailable after PATIENCE."""
        self._done.record(self.window.stream)
        end = time.monotonic() + PATIENCE
        while not self._done.query():
            if time.monotonic() > end:
                self._group.abort()
                raise lost("another GPU", PATIENCE)
            time.sleep(NAP)

    def gather(self, owned: np.ndarray) -> np.ndarray:
        return gather_rows(self._world, owned, self.decomposition)

    def largest(self, number: float) -> float:
        return largest_of(self._world, number)

    def close(self) -> None:
        self._group.destroy()


class NcclSimulation(DecomposedSimulation):
    """This process's window of a sheet that `count` processes share; see model/domains/simulation.py."""

    backend = "gpu"
    exchange: NcclExchange

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        require_gpu()
        nccl()
        self._world = mpi().COMM_WORLD
        if self._world.Get_size() != count:
            raise SceneError("--gpus", count, f"MPI has {self._world.Get_size()} processes; start mpiexec -n {count}")
        place = self._world.Split_type(mpi().COMM_TYPE_SHARED).Get_rank()  # among the processes of this host
        if place >= gpu_count() and not sharing():
            raise BackendUnavailable(
                f"process {place} of this host has no GPU: {gpu_count()} are here",
                "start as many on each as it has GPUs",
            )
        self._device = place % gpu_count()
        super().__init__(scene, options, cut(scene, count, steps, "--gpus"), [self._world.Get_rank()])

    def _at(self, place: int) -> AbstractContextManager[Any]:
        return at(self._device)

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        window: Simulation = named(family_of(scene).solvers["gpu"])(scene, options)
        return window

    def _connect(self) -> Exchange:
        with at(self._device):
            return NcclExchange(self.windows[0], self.decomposition, self._world)

    def _run(self, steps: int) -> None:
        with at(self._device):
            super()._run(steps)

    def _first_diverged(self) -> int:
        with at(self._device):
            self.exchange.require_answers()
        return super()._first_diverged()
