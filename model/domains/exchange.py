"""What every way of sending between windows offers: threads, MPI, pointers into a neighbour's memory, NCCL."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

PATIENCE = 60.0  # s; no wait for a neighbour takes longer


class Exchange(ABC):
    """Between the windows of one scene, those of this process and of others. One exchange is a `post` and a `wait`; all
    processes make the same calls in the same order. `rank`: of this process; one alone is number 0."""

    rank = 0

    @abstractmethod
    def post(self) -> None:
        """Send the borders of this process's windows, as they are once everything asked for so far has been done."""

    @abstractmethod
    def wait(self) -> None:
        """See to it that the halos are there before anything that is asked for next is done. Raises BackendUnavailable where
        a neighbour does not answer, at the latest when the state is looked at."""

    def gather(self, owned: np.ndarray) -> np.ndarray:
        """Of the rows (masses, axes) that each process owns, those of all, in order. One process has them all."""
        return owned

    def largest(self, number: float) -> float:
        """The largest of what the processes say."""
        return float(self.largest_each(np.array([number], np.float64))[0])

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        """(n,) float64: the largest of what the processes say in each place."""
        return numbers.copy()

    def swap(self, messages: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
        """`messages`: of each window of this process one to every window of all, bytes. What came to each of this process
        from every window."""
        return [list(came) for came in zip(*messages, strict=True)]

    def close(self) -> None:  # noqa: B027 - nothing to free is a valid answer
        """Free what it holds."""


class NothingSent(Exchange):
    """Between parts none of which acts on another: they meet where a state is gathered."""

    def post(self) -> None:
        """Nothing."""

    def wait(self) -> None:
        """For nobody."""
