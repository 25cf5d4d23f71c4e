"""Halos of a rank's window, packed into and unpacked from messages in main memory: rows of a sheet, particles of a
mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

import numpy as np

from softlab.cpu_backend.core.simulation import QuadsSimulation, RowsSimulation
from softlab.model.core.sharing.decomposition import Decomposition
from softlab.model.core.sharing.partitions import Partitions

Places = TypeVar("Places")


class Halo(Generic[Places]):
    """Halo of the window of `rank`: messages `sent` and `received`, by target and source rank, of what lies at the
    places `outgoing` and `incoming`. `read(places)` returns the current state there, `write(places, message)` replaces
    it."""

    def __init__(
        self, rank: int, read: Callable[[Places], np.ndarray], write: Callable[[Places, np.ndarray], None],
        outgoing: Mapping[int, Places], incoming: Mapping[int, Places],
    ):  # fmt: skip
        self.rank, self._read, self._write, self._outgoing, self._incoming = rank, read, write, outgoing, incoming
        self.sent, self.received = (
            {other: np.array(read(places), order="C") for other, places in some.items()}
            for some in (outgoing, incoming)
        )

    def pack(self, target: int) -> np.ndarray:
        """Return the message to rank `target`, with the current state."""
        message = self.sent[target]
        message[...] = self._read(self._outgoing[target])
        return message

    def take(self, source: int) -> None:
        """Write the data received from rank `source` into the state."""
        self._write(self._incoming[source], self.received[source])


def rows_halo(window: RowsSimulation, decomposition: Decomposition, rank: int) -> Halo:
    """Return the halo of a sheet: rows."""
    borders = decomposition.borders
    return Halo(
        rank,
        lambda rows: window.rows(*rows),
        lambda rows, message: window.take_rows(rows[0], message),
        {border.target: (border.from_row, border.rows) for border in borders if border.source == rank},
        {border.source: (border.to_row, border.rows) for border in borders if border.target == rank},
    )


def particles_halo(window: QuadsSimulation, partitions: Partitions, rank: int) -> Halo:
    """Return the halo of a mesh: particles."""
    messages = partitions.messages
    return Halo(
        rank,
        window.some_particles,
        window.take_particles,
        {one.target: one.from_places for one in messages if one.source == rank},
        {one.source: one.to_places for one in messages if one.target == rank},
    )
