"""A sheet, bodies or a fluid on several CPU ranks: processes or threads that have a window each and run the same program."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.core.simulation import RowsSimulation
from cpu_backend.core.threads import core_count
from cpu_backend.domains.fluid import FluidWindow
from model.core.families import family_of
from model.core.family import named
from model.core.options import Options
from model.core.simulation import Simulation
from model.domains.decomposition import Border, Decomposition
from model.domains.exchange import Exchange
from model.domains.shared_bodies import SharedBodies, division, is_apart
from model.domains.shared_fluid import SharedFluid
from model.domains.simulation import DecomposedSimulation, cut
from model.domains.slabs import is_in_slabs, slabs_at_start
from model.scene.scene import Scene


class RankExchange(Exchange):
    """Of one window in the main memory of a rank. A way of sending says how a message goes to another rank and comes from
    one: `_send`, `_receive`."""

    def __init__(self, window: RowsSimulation, decomposition: Decomposition, rank: int):
        self.window, self.rank, self.decomposition = window, rank, decomposition
        self._out = [border for border in decomposition.borders if border.source == rank]
        self._in = [border for border in decomposition.borders if border.target == rank]
        self._sent = {border.target: self._message(border) for border in self._out}
        self._received = {border.source: self._message(border) for border in self._in}

    def _message(self, border: Border) -> np.ndarray:
        planes, columns = 2 * self.window.scene.dimensions, self.decomposition.columns
        return np.zeros((planes, border.rows, columns), self.window.real)

    def post(self) -> None:
        for border in self._out:
            message = self._sent[border.target]
            message[...] = self.window.rows(border.from_row, border.rows)
            self._send(border.target, message)

    def wait(self) -> None:
        for border in self._in:
            message = self._received[border.source]
            self._receive(border.source, message)
            self.window.take_rows(border.to_row, message)
        self._finish()

    def _send(self, rank: int, message: np.ndarray) -> None:
        """Begin to send; the message stays as it is until `_finish`."""
        raise NotImplementedError

    def _receive(self, rank: int, message: np.ndarray) -> None:
        """Return with the message. Raises BackendUnavailable where none comes."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Return when what was sent may be overwritten."""


class Ranks:
    """Those that run together: `rank` is this one of `count`."""

    rank: int
    count: int

    def exchange(self, window: RowsSimulation, decomposition: Decomposition) -> RankExchange:
        """Between this rank's window and the others'."""
        raise NotImplementedError

    def apart(self) -> Exchange:
        """Among ranks whose windows send each other no borders of rows."""
        raise NotImplementedError


class RankSimulation(DecomposedSimulation):
    """This rank's window of a sheet. `threads`: of each rank; `1x`, `2x`, `4x` of its share of the cores, or a number."""

    backend = "cpu"

    def __init__(
        self, scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
    ):
        self._ranks, self._words = ranks, shared_threads(threads, ranks.count)
        super().__init__(scene, options, cut(scene, ranks.count, steps, "--ranks"), [ranks.rank])

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return named(family_of(scene).solvers["cpu"])(scene, options, self._words)

    def _connect(self) -> Exchange:
        window: Any = self.windows[0]
        return self._ranks.exchange(window, self.decomposition)


class RankBodies(SharedBodies):
    """This rank's share of bodies that never meet. `threads`: as of RankSimulation."""

    backend = "cpu"

    def __init__(
        self, scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
    ):
        self._ranks, self._words = ranks, shared_threads(threads, ranks.count)
        super().__init__(scene, options, division(scene, ranks.count, steps, "--ranks"), [ranks.rank])

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return named(family_of(scene).solvers["cpu"])(scene, options, self._words)

    def _connect(self) -> Exchange:
        return self._ranks.apart()


class RankFluid(SharedFluid):
    """This rank's slab of a fluid. `threads`: as of RankSimulation."""

    backend = "cpu"

    def __init__(
        self, scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
    ):
        self._ranks, self._words = ranks, shared_threads(threads, ranks.count)
        super().__init__(scene, options, slabs_at_start(scene, ranks.count, steps, "--ranks"), [ranks.rank])

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return FluidWindow(scene, options, self._words)

    def _connect(self) -> Exchange:
        return self._ranks.apart()


def on_ranks(
    scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
) -> RankSimulation | RankBodies | RankFluid:
    """This rank's part of a scene, whichever way it is shared. Raises SceneError for one that is not."""
    if is_in_slabs(scene):
        return RankFluid(scene, options, ranks, threads, steps)
    return (RankBodies if is_apart(scene) else RankSimulation)(scene, options, ranks, threads, steps)


def shared_threads(threads: str | int, ranks: int) -> str | int:
    """The threads of one of so many ranks on this machine; a number is taken as it is."""
    factors = {"1x": 1, "2x": 2, "4x": 4}
    return max(1, factors[str(threads)] * core_count() // ranks) if threads in factors else threads
