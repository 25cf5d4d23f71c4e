"""Lattices of bodies on a CUDA device: the arrays of their kernels, and the order of launches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, Stream
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.shape_matching.lattice_kernels import (
    N_COPIES,
    N_REGION,
    NUMBERS,
    PLANES,
    THREADS,
    make_lattice_kernels,
)
from softlab.model.assets.lattice import VALUES
from softlab.model.base.types import Real
from softlab.model.particles.body_set import BodySet
from softlab.model.tables.method import Method

FRAME = 12
BUSY = 2**17  # threads that occupy a large device: a hundred multiprocessors with a thousand each


def lattice_bytes(body_set: BodySet, item: int) -> int:
    """Return the device memory [bytes] for the lattices of a body set without its particles; `item`: bytes of a
    number."""
    clusters = sum(one.copies * one.lattice.size for one in body_set.lattices)
    return item * clusters * (2 * PLANES + 3 * SIZE + FRAME)


class Lattices:
    """The lattices of a body set. `rotation` and `new_rotation` (clusters, 4) flat, `frames` as those of other clusters."""

    def __init__(self, body_set: BodySet, real: Real, math: str, stream: Stream):
        self.copies, self.real, self.stream = body_set.lattices, real, stream
        self.clusters = sum(one.copies * one.lattice.size for one in self.copies)
        self.rotation: Any = None
        self.view_rotation: Any = None
        self.frames: Any = None
        self._numbers: list[np.ndarray] = []
        self._tables: list[Any] = []
        self._values: list[Any] = []
        self._kernels: Any = None
        if not self.copies:
            return
        self._kernels = make_lattice_kernels(real, math)
        self._one, self._other = (self._zeros(PLANES * self.clusters) for _ in range(2))
        self.rotation, self.view_rotation, self._snapshot = (self._zeros(SIZE * self.clusters) for _ in range(3))
        self.frames = self._zeros(FRAME * self.clusters)
        begin = 0
        for one in self.copies:
            tables = [axis.table(real).reshape(-1) for axis in one.lattice.axes]
            nx, ny, nz = one.lattice.counts
            numbers = np.zeros(NUMBERS, np.int32)
            places = np.cumsum([0, *(table.size for table in tables[:2])])
            numbers[:] = nx, ny, nz, one.lattice.region, one.copies, one.first_particle, begin, *places
            self._numbers.append(numbers)
            self._tables.append(self._on_device(np.concatenate(tables)))
            self._values.append(self._zeros(VALUES))
            begin += one.copies * one.lattice.size
        self._values_on_device = [self._on_device(numbers) for numbers in self._numbers]

    def _on_device(self, array: np.ndarray) -> DeviceArray:
        return cuda.to_device(np.ascontiguousarray(array), stream=self.stream)

    def _zeros(self, count: int) -> DeviceArray:
        return self._on_device(np.zeros(count, self.real))

    @property
    def launches(self) -> int:
        """Number of launches of an iteration."""
        return 7 * len(self.copies)

    def store(self) -> None:
        if self.copies:
            self._snapshot.copy_to_device(self.rotation, stream=self.stream)

    def restore(self) -> None:
        if self.copies:
            self.rotation.copy_to_device(self._snapshot, stream=self.stream)

    def settle(self) -> None:
        """Use the rotations computed for the last view as those of the state."""
        if self.copies:
            self.rotation.copy_to_device(self.view_rotation, stream=self.stream)

    def change(self, method: Method) -> None:
        """Apply a changed step length."""
        for one, stored in zip(self.copies, self._values, strict=True):
            values: np.ndarray = one.values(method.dt / method.substeps, method.iterations).astype(self.real)
            stored.copy_to_device(values, stream=self.stream)

    def _launch(self, kernel: Any, n: int, threads: int, arrays: Sequence[Any]) -> None:
        blocks = max(1, -(-threads // THREADS))
        kernel[blocks, THREADS, self.stream](
            self._values_on_device[n], self._values[n], self._tables[n], np.int32(self.clusters), *arrays
        )

    def _scan(self, kernel: Any, n: int, axis: int, arrays: Sequence[Any]) -> None:
        """Do a pass along an axis, y or z, with as few threads per group of windows as occupy the device."""
        numbers = [int(number) for number in self._numbers[n]]
        counts, width = numbers[:3], 2 * numbers[N_REGION] + 1
        size = counts[0] * counts[1] * counts[2] * numbers[N_COPIES]
        span = max(1, min(width, size // BUSY))
        counts[axis] = -(-counts[axis] // width) * -(-width // span)
        threads = counts[0] * counts[1] * counts[2] * numbers[N_COPIES]
        self._launch(kernel, n, threads, (*arrays, np.int32(span)))

    def match(self, position: DeviceArray, new_rotation: DeviceArray, for_view: bool = False) -> None:
        """Compute all lattices' rotations at `position`, from those of the state into `new_rotation`; with `for_view` their
        frames, else the arrays that `move` needs."""
        run = self._kernels
        for n, one in enumerate(self.copies):
            each = one.copies * one.lattice.size
            self._launch(run.sum_lines, n, each, (position, self._one))
            self._scan(run.sum_slices, n, 1, (position, self._one, self._other))
            self._scan(run.sum_windows, n, 2, (position, self._other, self._one))
            self._launch(run.turn, n, each, (position, self._one, self.rotation, new_rotation, self.frames, for_view))

    def move(self, position: DeviceArray) -> None:
        """Move the masses of all lattices, in place, after `match`."""
        run = self._kernels
        for n, one in enumerate(self.copies):
            self._scan(run.goal_slices, n, 2, (position, self._one, self._other))
            self._scan(run.goal_lines, n, 1, (position, self._other, self._one))
            self._launch(run.move_lines, n, one.copies * one.lattice.size, (position, self._one))
