"""Ranks that are MPI processes, on one machine or several: started by `mpiexec`, one window each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softlab.cpu_backend.domains.halos import Halo
from softlab.cpu_backend.domains.ranks import RankExchange, Ranks
from softlab.model.domains.exchange import Exchange, NothingSent
from softlab.model.domains.processes import await_request, gather_rows, largest_of, swapped, world_of

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm, Request


class AmongProcesses(NothingSent):
    """Collective communication among processes (see Exchange)."""

    def __init__(self, rank: int, world: Intracomm):
        self.rank, self._world = rank, world

    def gather(self, owned: np.ndarray) -> np.ndarray:
        return gather_rows(self._world, owned)

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        return largest_of(self._world, numbers)

    def swap(self, messages: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
        return [swapped(self._world, messages[0])]


class MpiExchange(RankExchange, AmongProcesses):
    """Non-blocking messages, polled until they arrive (see Exchange)."""

    def __init__(self, halo: Halo, world: Intracomm):
        RankExchange.__init__(self, halo)
        self._world = world
        self._pending: list[tuple[int, Request]] = []
        self._coming: dict[int, Request] = {}

    def post(self) -> None:
        for source, message in self.halo.received.items():  # first, so that arriving messages have a buffer
            self._coming[source] = self._world.Irecv(message, source)
        super().post()

    def _send(self, rank: int, message: np.ndarray) -> None:
        self._pending.append((rank, self._world.Isend(message, rank)))

    def _receive(self, rank: int, message: np.ndarray) -> None:
        await_request(self._coming.pop(rank), f"rank {rank}")

    def _finish(self) -> None:
        while self._pending:
            rank, request = self._pending.pop()
            await_request(request, f"rank {rank}")


class MpiRanks(Ranks):
    """All processes of MPI. Raises BackendUnavailable without MPI or with another MPI than the launcher's, SceneError
    if their number is not `count`."""

    def __init__(self, count: int):
        self._world = world_of(count, "--ranks")
        self.rank, self.count = self._world.Get_rank(), count

    def exchange(self, halo: Halo) -> RankExchange:
        return MpiExchange(halo, self._world)

    def apart(self) -> Exchange:
        return AmongProcesses(self.rank, self._world)
