"""Ranks that are processes of MPI, on one machine or several: started by `mpiexec`, one window each."""

from __future__ import annotations

import shutil
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from cpu_backend.core.simulation import RowsSimulation
from cpu_backend.domains.in_threads import lost
from cpu_backend.domains.ranks import RankExchange, Ranks
from model.core.errors import BackendUnavailable, SceneError
from model.domains.decomposition import Decomposition
from model.domains.exchange import PATIENCE

INSTALL = "pip install -e \".[mpi]\" in the lab's folder, or the system's MPI and mpi4py"
LOOKS = 1000  # at a message before a rank that waits lets others have its core
NAP = 5e-5  # s


def mpi() -> Any:
    """mpi4py's MPI. Raises BackendUnavailable."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:  # the second where there is mpi4py without a library of MPI
        raise BackendUnavailable(f"MPI is not installed ({error})", INSTALL) from None
    return MPI


def mpi_installed() -> None:
    """Raises BackendUnavailable without mpi4py. Does not start MPI in this process, which is to start others."""
    if find_spec("mpi4py") is None:
        raise BackendUnavailable("mpi4py is not installed", INSTALL)


def mpiexec() -> str:
    """The launcher of the MPI that mpi4py speaks to: beside this Python, or on the path. Raises BackendUnavailable."""
    mpi_beside = Path(sys.executable).with_name("mpiexec")
    found = str(mpi_beside) if mpi_beside.exists() else shutil.which("mpiexec")
    if not found:
        raise BackendUnavailable("mpiexec, which starts ranks, was not found", INSTALL)
    return found


class MpiExchange(RankExchange):
    """By messages that are sent and received without waiting, looked at until they are there; see Exchange."""

    def __init__(self, window: RowsSimulation, decomposition: Decomposition, rank: int, world: Any):
        super().__init__(window, decomposition, rank)
        self._world: Any = world
        self._pending: list[tuple[int, Any]] = []
        self._coming: dict[int, Any] = {}
        self._counts = np.array([d.end - d.first for d in decomposition.domains]) * decomposition.columns

    def post(self) -> None:
        for border in self._in:  # first, so that what arrives has a place to go to
            self._coming[border.source] = self._world.Irecv(self._received[border.source], border.source)
        super().post()

    def _send(self, rank: int, message: np.ndarray) -> None:
        self._pending.append((rank, self._world.Isend(message, rank)))

    def _receive(self, rank: int, message: np.ndarray) -> None:
        _await(self._coming.pop(rank), f"rank {rank}")

    def _finish(self) -> None:
        while self._pending:
            rank, request = self._pending.pop()
            _await(request, f"rank {rank}")

    def gather(self, owned: np.ndarray) -> np.ndarray:
        axes = owned.shape[1]
        whole = np.empty((int(self._counts.sum()), axes), owned.dtype)
        kind = mpi().FLOAT if owned.dtype == np.float32 else mpi().DOUBLE
        row = kind.Create_contiguous(axes).Commit()  # counts of MPI are 32-bit: of masses, not of numbers
        try:
            parts = [owned, len(owned), row], [whole, self._counts, None, row]
            _await(self._world.Iallgatherv(*parts), "another rank")
        finally:
            row.Free()
        return whole

    def largest(self, number: float) -> float:
        found = np.zeros(1)
        _await(self._world.Iallreduce(np.array([number], np.float64), found, mpi().MAX), "another rank")
        return float(found[0])


def _await(request: Any, who: str) -> None:
    """Return when a request is done. Raises BackendUnavailable after PATIENCE."""
    looks, end = 0, None
    while not request.Test():
        looks += 1
        if looks % LOOKS == 0:
            now = time.monotonic()
            end = end or now + PATIENCE
            if now > end:
                raise lost(who, PATIENCE)
            time.sleep(NAP)


def abort(status: int) -> None:
    """End all ranks, of which one does not answer."""
    mpi().COMM_WORLD.Abort(status)


class MpiRanks(Ranks):
    """All processes that MPI knows of. Raises BackendUnavailable without MPI, SceneError for another number of them than
    `count`."""

    def __init__(self, count: int):
        self._world = mpi().COMM_WORLD
        self.rank, self.count = self._world.Get_rank(), self._world.Get_size()
        if self.count != count:
            raise SceneError("--ranks", count, f"MPI has {self.count}; start the run with mpiexec -n {count}")

    def exchange(self, window: RowsSimulation, decomposition: Decomposition) -> RankExchange:
        return MpiExchange(window, decomposition, self.rank, self._world)
