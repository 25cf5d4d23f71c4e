"""Halos of a rank's window, packed into and unpacked from messages in main memory: rows of a sheet, particles of a
mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softlab.cpu_backend.core.simulation import QuadsSimulation, RowsSimulation
from softlab.model.core.sharing.decomposition import Decomposition
from softlab.model.core.sharing.partitions import Partitions


class Halo:
    """Halo of the window of `rank`: messages `sent` and `received`, by target and source rank."""

    rank: int
    sent: Mapping[int, np.ndarray]
    received: Mapping[int, np.ndarray]

    def pack(self, target: int) -> np.ndarray:
        """Return the message to rank `target`, with the current state."""
        raise NotImplementedError

    def take(self, source: int) -> None:
        """Write the data received from rank `source` into the state."""
        raise NotImplementedError


class RowsHalo(Halo):
    """Halo of a sheet: rows."""

    def __init__(self, window: RowsSimulation, decomposition: Decomposition, rank: int):
        self.window, self.rank = window, rank
        planes, columns = 2 * window.scene.dimensions, decomposition.columns
        self._out = {border.target: border for border in decomposition.borders if border.source == rank}
        self._in = {border.source: border for border in decomposition.borders if border.target == rank}
        self.sent, self.received = (
            {other: np.zeros((planes, border.rows, columns), window.real) for other, border in some.items()}
            for some in (self._out, self._in)
        )

    def pack(self, target: int) -> np.ndarray:
        border, message = self._out[target], self.sent[target]
        message[...] = self.window.rows(border.from_row, border.rows)
        return message

    def take(self, source: int) -> None:
        self.window.take_rows(self._in[source].to_row, self.received[source])


class ParticlesHalo(Halo):
    """Halo of a mesh: particles."""

    def __init__(self, window: QuadsSimulation, partitions: Partitions, rank: int):
        self.window, self.rank = window, rank
        self._out = {one.target: one.from_places for one in partitions.messages if one.source == rank}
        self._in = {one.source: one.to_places for one in partitions.messages if one.target == rank}
        self.sent, self.received = (
            {other: np.zeros((2, len(places), 3), window.real) for other, places in some.items()}
            for some in (self._out, self._in)
        )

    def pack(self, target: int) -> np.ndarray:
        message = self.sent[target]
        message[...] = self.window.some_particles(self._out[target])
        return message

    def take(self, source: int) -> None:
        self.window.take_particles(self._in[source], self.received[source])
