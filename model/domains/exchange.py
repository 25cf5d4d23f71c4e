"""The interface of every exchange between windows: threads, MPI, pointers into a neighbour's memory, NCCL."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

PATIENCE = 60.0  # s; longest wait for a neighbour


class Exchange(ABC):
    """Exchange between the windows of one scene, those of this process and of others.

    One exchange is a `post` and a `wait`; all processes make the same calls in the same order. `rank`: of this process;
    0 for a single one.
    """

    rank = 0

    @abstractmethod
    def post(self) -> None:
        """Send the borders of this process's windows, as they are after all operations requested so far."""

    @abstractmethod
    def wait(self) -> None:
        """Make sure that the halos have arrived before any operation requested later.

        Raises BackendUnavailable where a neighbour does not respond, at the latest when the state is read.
        """

    def gather(self, owned: np.ndarray) -> np.ndarray:
        """Return the rows (masses, axes) of all processes, in order, from those that each owns. A single process has
        them all."""
        return owned

    def largest(self, number: float) -> float:
        """Return the largest `number` of all processes."""
        return float(self.largest_each(np.array([number], np.float64))[0])

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        """Return the elementwise maximum over the processes, (n,) float64."""
        return numbers.copy()

    def swap(self, messages: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
        """Send `messages`, bytes, from each window of this process to every window of all; return those received by
        each of this process's windows from every window."""
        return [list(came) for came in zip(*messages, strict=True)]

    def close(self) -> None:  # noqa: B027 - nothing to free is a valid answer
        """Free its resources."""


class NothingSent(Exchange):
    """Exchange between parts none of which acts on another; they are joined when a state is gathered."""

    def post(self) -> None:
        """Do nothing."""

    def wait(self) -> None:
        """Do nothing."""
