"""Ranks that are processes of MPI, on one machine or several: started by `mpiexec`, one window each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cpu_backend.domains.halos import Halo
from cpu_backend.domains.ranks import RankExchange, Ranks
from model.domains.exchange import Exchange, NothingSent
from model.domains.processes import await_request, gather_rows, largest_of, swapped, world_of


class AmongProcesses(NothingSent):
    """What all processes tell one another; see Exchange."""

    def __init__(self, rank: int, world: Any):
        self.rank, self._world = rank, world

    def gather(self, owned: np.ndarray) -> np.ndarray:
        return gather_rows(self._world, owned)

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        return largest_of(self._world, numbers)

    def swap(self, messages: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
        return [swapped(self._world, messages[0])]


class MpiExchange(RankExchange, AmongProcesses):
    """By messages that are sent and received without waiting, looked at until they are there; see Exchange."""

    def __init__(self, halo: Halo, world: Any):
        RankExchange.__init__(self, halo)
        self._world = world
        self._pending: list[tuple[int, Any]] = []
        self._coming: dict[int, Any] = {}

    def post(self) -> None:
        for source, message in self.halo.received.items():  # first, so that what arrives has a place to go to
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
    """All processes that MPI knows of. Raises BackendUnavailable without MPI or with another than the launcher's, SceneError
    for another number of them than `count`."""

    def __init__(self, count: int):
        self._world = world_of(count, "--ranks")
        self.rank, self.count = self._world.Get_rank(), count

    def exchange(self, halo: Halo) -> RankExchange:
        return MpiExchange(halo, self._world)

    def apart(self) -> Exchange:
        return AmongProcesses(self.rank, self._world)
