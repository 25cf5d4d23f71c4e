"""Memory layout of the lattices of a body set, and their distribution over CPU threads (shape_matching/lattice.py)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.cpu_backend.shape_matching.lattice_rows import LINE, SLICE, WINDOW
from softlab.cpu_backend.shape_matching.motions import FRAME
from softlab.model.assets.lattice import T_INVERSE, T_MASS, VALUES
from softlab.model.base.types import Real
from softlab.model.particles.body_set import BodySet
from softlab.model.tables.method import Method

NUMBERS = 8  # of a lattice: counts along x, y, z, region, where its three tables begin, and that of a slice
PENCIL = 5  # numbers of a pencil
PARTS = 4  # minimum number of parts per thread
LONG = 128  # masses along a pencil's rows, if possible: calls cost as much as short rows
QUATERNION = 4


class LatticeArrays(NamedTuple):
    """Numbers of lattices (n, NUMBERS); slices (n, 3): lattice, first place, z; pencils (n, PENCIL): lattice, first place,
    first cluster, first y and the one behind the last; tables of axes and values of lattices, flat; sums of slices;
    quaternions, four planes; frames; scratch of all bands, and its length for one."""

    numbers: np.ndarray
    slices: np.ndarray
    pencils: np.ndarray
    tables: np.ndarray
    values: np.ndarray
    work: np.ndarray
    rotation: np.ndarray
    frames: np.ndarray
    scratch: np.ndarray
    band_scratch: int


class Lattices:
    """The kernels' arrays of a body set's lattices; `slots`: places of its particles in planes of `count`.

    `rotation`: (4, clusters) flat; `frames`: as those of other clusters.
    """

    def __init__(self, body_set: BodySet, slots: np.ndarray, count: int, bands: int, real: Real):
        self.copies, self.real = body_set.lattices, real
        loose = min((one.first_cluster for one in self.copies), default=0)
        numbers, slices, pencils, tables = [], [], [], [np.zeros(0)]
        band_scratch = begin = 0
        for n, one in enumerate(self.copies):
            nx, ny, nz = one.lattice.counts
            places = [begin]
            for axis in one.lattice.axes:
                tables.append(axis.table(real).reshape(-1))
                places.append(places[-1] + tables[-1].size)
            x, y = (axis.table(real) for axis in one.lattice.axes[:2])
            tables += [(y[row][:, None] * x[row]).reshape(-1) for row in (T_MASS, T_INVERSE)]
            numbers.append((nx, ny, nz, one.lattice.region, *places))
            begin = places[-1] + 2 * nx * ny
            width = 2 * one.lattice.region + 1
            rows = max(1, min(LONG // nx, ny * one.copies // (PARTS * bands)))
            band_scratch = max(
                band_scratch, nx * ((LINE + SLICE) * max(ny, width) + SLICE + 3),
                nx * min(rows, ny) * WINDOW * (nz + max(1, min(nz, width)) + 1),
            )  # fmt: skip
            for copy in range(one.copies):
                first = int(slots[one.first_particle + copy * one.lattice.size])
                cluster = one.first_cluster - loose + copy * one.lattice.size
                slices += [(n, first, z) for z in range(nz)]
                pencils += [(n, first, cluster, low, min(low + rows, ny)) for low in range(0, ny, rows)]
        self.clusters = sum(one.copies * one.lattice.size for one in self.copies)
        self.values: np.ndarray = np.zeros(VALUES * len(self.copies), real)
        self.rotation: np.ndarray = np.zeros(QUATERNION * self.clusters, real)
        self.view_rotation = np.zeros_like(self.rotation)
        self.frames: np.ndarray = np.zeros(FRAME * self.clusters, real)
        band_scratch = -(-band_scratch // 16) * 16
        self.arrays = LatticeArrays(
            np.array(numbers, np.int64).reshape(-1, NUMBERS), np.array(slices, np.int64).reshape(-1, 3),
            np.array(pencils, np.int64).reshape(-1, PENCIL), np.concatenate(tables).astype(real), self.values,
            aligned_zeros(SLICE * count if self.copies else 0, real), self.rotation, self.frames,
            aligned_zeros(band_scratch * bands, real), band_scratch,
        )  # fmt: skip

    def change(self, method: Method) -> None:
        """Apply a changed step length."""
        for values, one in zip(self.values.reshape(-1, VALUES), self.copies, strict=True):
            values[:] = one.values(method.dt / method.substeps, method.iterations)
