"""A sheet, bodies or a fluid on several CPU ranks: processes or threads that run the same program with a window
each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from softlab.cpu_backend.core.simulation import QuadsSimulation, RowsSimulation
from softlab.cpu_backend.core.threads import core_count
from softlab.cpu_backend.domains.fluid import FluidWindow
from softlab.cpu_backend.domains.halos import Halo, particles_halo, rows_halo
from softlab.model.base.components import named
from softlab.model.core.families import family_of
from softlab.model.core.options import Options
from softlab.model.core.simulation import Simulation
from softlab.model.domains.exchange import Exchange
from softlab.model.domains.partitioned import PartitionedBodies, is_partitioned, partitions
from softlab.model.domains.shared_bodies import SharedBodies, division, is_apart
from softlab.model.domains.shared_fluid import SharedFluid
from softlab.model.domains.simulation import DecomposedSimulation, cut
from softlab.model.domains.slabs import is_in_slabs, slabs_at_start
from softlab.model.domains.windows import WindowedSimulation
from softlab.model.scene.scene import Scene


class RankExchange(Exchange):
    """Exchange of the `halo` of one window, in the main memory of a rank. Subclasses implement `_send` and
    `_receive`."""

    def __init__(self, halo: Halo):
        self.halo, self.rank = halo, halo.rank

    def post(self) -> None:
        for target in self.halo.sent:
            self._send(target, self.halo.pack(target))

    def wait(self) -> None:
        for source, message in self.halo.received.items():
            self._receive(source, message)
            self.halo.take(source)
        self._finish()

    def _send(self, rank: int, message: np.ndarray) -> None:
        """Begin to send; the message must not change until `_finish`."""
        raise NotImplementedError

    def _receive(self, rank: int, message: np.ndarray) -> None:
        """Return when the message has arrived. Raises BackendUnavailable on a timeout."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Return when the sent messages may be overwritten."""


class Ranks:
    """The ranks of a run: `rank` is this one of `count`."""

    rank: int
    count: int

    def exchange(self, halo: Halo) -> RankExchange:
        """Return the exchange between this rank's window, with `halo`, and the others."""
        raise NotImplementedError

    def apart(self) -> Exchange:
        """Return the exchange among ranks whose windows share no borders."""
        raise NotImplementedError


class OnRanks(WindowedSimulation):
    """This rank's window of any kind (model/domains/windows.py). `divided(scene, count, steps, option)`: the
    decomposition. `threads`: of each rank; `1x`, `2x`, `4x` of its fraction of the cores, or a number."""

    backend = "cpu"
    divided: Callable[[Scene, int, int | None, str], Any]

    def __init__(
        self, scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
    ):
        self._ranks, self._words = ranks, shared_threads(threads, ranks.count)
        decomposition = self.divided(scene, ranks.count, steps, "--ranks")
        super().__init__(scene, options, decomposition, [ranks.rank])  # type: ignore[call-arg]  # of what it is mixed into

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return named(family_of(scene).solvers["cpu"])(scene, options, self._words)

    def _connect(self) -> Exchange:
        return self._ranks.apart()


class RankSimulation(OnRanks, DecomposedSimulation):
    """This rank's window of a sheet."""

    divided = staticmethod(cut)

    def _connect(self) -> Exchange:
        window = cast(RowsSimulation, self.windows[0])
        return self._ranks.exchange(rows_halo(window, self.decomposition, self._ranks.rank))


class RankBodies(OnRanks, SharedBodies):
    """This rank's subset of bodies that never touch."""

    divided = staticmethod(division)


class RankPartitions(OnRanks, PartitionedBodies):
    """This rank's partition of the meshes of bodies."""

    divided = staticmethod(partitions)

    def _connect(self) -> Exchange:
        window = cast(QuadsSimulation, self.windows[0])
        return self._ranks.exchange(particles_halo(window, self.partitions, self._ranks.rank))


class RankFluid(OnRanks, SharedFluid):
    """This rank's slab of a fluid."""

    divided = staticmethod(slabs_at_start)

    def _open(self, place: int, scene: Scene, options: Options) -> Simulation:
        return FluidWindow(scene, options, self._words)


def on_ranks(
    scene: Scene, options: Options, ranks: Ranks, threads: str | int = "1x", steps: int | None = None
) -> RankSimulation | RankBodies | RankPartitions | RankFluid:
    """Return this rank's part of a scene, for any decomposition. Raises SceneError for a scene that has none."""
    if is_in_slabs(scene):
        return RankFluid(scene, options, ranks, threads, steps)
    if is_partitioned(scene, ranks.count):
        return RankPartitions(scene, options, ranks, threads, steps)
    return (RankBodies if is_apart(scene) else RankSimulation)(scene, options, ranks, threads, steps)


def shared_threads(threads: str | int, ranks: int) -> str | int:
    """Return the threads of one of `ranks` ranks on this machine; a number is returned as it is."""
    factors = {"1x": 1, "2x": 2, "4x": 4}
    return max(1, factors[str(threads)] * core_count() // ranks) if threads in factors else threads
