"""Arrays and kernels for the clusters' material on the GPU: shape tables, plastic strain, damping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.quads import AXES, ROWS, SIZE
from softlab.gpu_backend.shape_matching.damping import make_damping_ends, make_gather
from softlab.gpu_backend.shape_matching.kernels import THREADS, TOGETHER
from softlab.gpu_backend.shape_matching.shapes import make_shaped_turn
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.shape_matching.cluster_tables import damping_factors, shape_table, shaping
from softlab.model.tables.method import Method


class ClusterMaterial:
    """Material of `clusters`, for the scene's `parts`. `particle_order` (entries,): entries in the particles' order.
    `plastic`: the state's strains, three quads per cluster, rows; `bent`: those of a look at the state."""

    def __init__(
        self, clusters: Clusters, particle_order: np.ndarray, parts: frozenset[str], real: Real, math: str,
        stream: Stream,
    ):  # fmt: skip
        self._clusters, self._particle_order, self._real, self._stream = clusters, particle_order, real, stream
        self.shaped, self.plastic_parts, self.damped = shaping(parts), "plastic" in parts, "cluster_damping" in parts
        count = ROWS * SIZE * clusters.count
        if self.shaped:
            self._turn = make_shaped_turn(real, math, self.shaped)
            self._shapes, length = self._zeros(count), count if self.plastic_parts else 1
            self._plastic, self._snapshot, self._bent = (self._zeros(length) for _ in range(3))
            self.upload(None)
        if self.damped:
            self._gather, self.ends = make_gather(real, math), make_damping_ends(real, math, parts)
            self._slowing, self._motions = self._zeros(len(particle_order)), self._zeros(count)

    def _zeros(self, count: int) -> DeviceArray:
        return cuda.to_device(np.zeros(count, self._real), stream=self._stream)

    def change(self, method: Method) -> None:
        """Update the tables that depend on the length of a substep."""
        h = method.dt / method.substeps
        if self.shaped:
            table: np.ndarray = shape_table(self._clusters, h, method.iterations).astype(self._real)
            self._shapes.copy_to_device(table.reshape(-1), stream=self._stream)
        if self.damped:
            factors = damping_factors(self._clusters, h)[self._particle_order].astype(self._real)
            self._slowing.copy_to_device(factors, stream=self._stream)

    def turn(self, launch: Any, for_view: bool, arguments: Sequence[Any]) -> None:
        """Turn clusters (shape_matching/shapes.py). A `for_view` at the state does not change its strains."""
        self._turn[launch](*arguments, self._shapes, self._plastic, self._bent if for_view else self._plastic)

    def gather(self, position: DeviceArray, velocity: DeviceArray, entries: Arguments, leans: DeviceArray) -> None:
        """Compute the clusters' rigid motions."""
        blocks = max(1, -(-self._clusters.count // TOGETHER))
        self._gather[blocks, THREADS, self._stream](position, velocity, *entries, leans, self._motions)

    def slowing(self, gathered: Arguments) -> Arguments:
        """Return the clusters' arguments of the kernels of `ends`: `gathered` begins with the starts and clusters of
        particles."""
        return *gathered[:2], self._slowing, self._motions

    # ------------------------------------------------------------------ state

    def store(self) -> None:
        if self.plastic_parts:
            self._snapshot.copy_to_device(self._plastic, stream=self._stream)

    def restore(self) -> None:
        if self.plastic_parts:
            self._plastic.copy_to_device(self._snapshot, stream=self._stream)

    def download(self) -> np.ndarray | None:
        """Return (clusters, 3, 3) on the host; None without plastic clusters."""
        if not self.plastic_parts:
            return None
        return np.ascontiguousarray(self._plastic.copy_to_host().reshape(-1, ROWS, SIZE)[:, :, :AXES])

    def upload(self, plastic: np.ndarray | None) -> None:
        """Upload strains; None: no cluster is bent."""
        if self.plastic_parts:
            rows: np.ndarray = np.zeros((self._clusters.count, ROWS, SIZE), self._real)
            rows[:, :, :AXES] = np.eye(AXES) if plastic is None else plastic
            self._plastic.copy_to_device(rows.reshape(-1), stream=self._stream)
