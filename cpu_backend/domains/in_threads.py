"""Ranks that are threads of one process: for tests, and to study a decomposition without MPI."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from queue import Empty, Queue
from typing import Any, TypeVar

import numpy as np

from softlab.cpu_backend.domains.halos import Halo
from softlab.cpu_backend.domains.ranks import RankExchange, Ranks
from softlab.model.base.errors import BackendUnavailable
from softlab.model.domains.exchange import PATIENCE, Exchange, NothingSent
from softlab.model.domains.processes import lost


class Meeting:
    """Communication between the threads of `count` ranks: a queue for each pair of neighbours, a table for gathered
    values. `patience` [s]: timeout of waiting for another thread."""

    def __init__(self, count: int, patience: float = PATIENCE):
        self.count, self.patience = count, patience
        self.queues: dict[tuple[int, int], Queue[np.ndarray]] = {
            (source, target): Queue() for source in range(count) for target in range(count)
        }
        self.posted: list[object] = [None] * count
        self.barrier = threading.Barrier(count)

    def all_of(self, rank: int, what: Any) -> Sequence[Any]:
        """Return the value `what` of every rank."""
        self.posted[rank] = what
        try:
            self.barrier.wait(self.patience)
            messages = list(self.posted)
            self.barrier.wait(self.patience)  # before any rank writes its next value
        except threading.BrokenBarrierError:
            raise lost("another rank", self.patience) from None
        return messages


class AmongThreads(NothingSent):
    """Collective communication among threads (see Exchange)."""

    def __init__(self, rank: int, meeting: Meeting):
        self.rank, self._meeting = rank, meeting

    def gather(self, owned: np.ndarray) -> np.ndarray:
        return np.concatenate(self._meeting.all_of(self.rank, owned))

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        largest: np.ndarray = np.max(self._meeting.all_of(self.rank, numbers), axis=0)
        return largest

    def swap(self, messages: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
        return [[message[self.rank] for message in self._meeting.all_of(self.rank, messages[0])]]


class ThreadExchange(RankExchange, AmongThreads):
    """Messages through queues (see Exchange)."""

    def __init__(self, halo: Halo, meeting: Meeting):
        RankExchange.__init__(self, halo)
        self._meeting = meeting

    def _send(self, rank: int, message: np.ndarray) -> None:
        self._meeting.queues[self.rank, rank].put(message.copy())

    def _receive(self, rank: int, message: np.ndarray) -> None:
        try:
            message[...] = self._meeting.queues[rank, self.rank].get(timeout=self._meeting.patience)
        except Empty:
            raise lost(f"rank {rank}", self._meeting.patience) from None


class ThreadRanks(Ranks):
    """The ranks as seen by one of the threads."""

    def __init__(self, meeting: Meeting, rank: int):
        self.meeting, self.rank, self.count = meeting, rank, meeting.count

    def exchange(self, halo: Halo) -> RankExchange:
        return ThreadExchange(halo, self.meeting)

    def apart(self) -> Exchange:
        return AmongThreads(self.rank, self.meeting)


Result = TypeVar("Result")


def run_in_threads(count: int, program: Callable[[Ranks], Result], patience: float = PATIENCE) -> list[Result]:
    """Return the results of `program(ranks)` on each of `count` ranks. Raises the first error that originated on a
    rank."""
    meeting = Meeting(count, patience)
    results: dict[int, Result] = {}
    errors: list[BaseException | None] = [None] * count

    def run(rank: int) -> None:
        try:
            results[rank] = program(ThreadRanks(meeting, rank))
        except BaseException as error:
            errors[rank] = error
            meeting.barrier.abort()

    threads = [threading.Thread(target=run, args=(rank,), daemon=True) for rank in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    raised = [error for error in errors if error is not None]
    direct = [error for error in raised if not isinstance(error, BackendUnavailable)]
    for error in direct or raised:
        raise error
    return [results[rank] for rank in range(count)]
