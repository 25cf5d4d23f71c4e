"""A fluid's particles in the order of cells on CUDA, in plain Python: the order is NumPy's, the lists are those of
asking all, whatever the box, the room for cells, and the sides that repeat."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import cuda

from gpu_backend.fluid.cells import Cells
from gpu_backend.fluid.sort_kernels import CELLS, WRAPS

SUPPORT, NEIGHBOURS, FAR = 0.1, 6, 1e6
SCATTERED, CROWDED, TORN, LOST = "scattered", "crowded", "torn", "lost"


def cloud(kind: str, axes: int) -> np.ndarray:
    """(particles, 3) [m]: `crowded` into a cell or two, `torn` into two heaps far apart, or some `lost` in space."""
    random, count = np.random.default_rng(3), 90
    place = random.uniform(-0.2, 0.3, (count, 3)) * (0.2 if kind == CROWDED else 1.0)
    place[10], place[11] = place[50], np.round(place[11] / SUPPORT) * SUPPORT
    if kind == TORN:
        place[count // 2 :, 0] += 37.0
    if kind == LOST:
        place[5], place[6, 1], place[7, 0], place[8, 0] = np.nan, np.inf, 1e30, -2e6
    place[:, axes:] = 0
    return place


def made(axes: int, most: int, position: np.ndarray, real: Any, period: float = 0.0) -> SimpleNamespace:
    """Sorted once, and neighbours found. `period` [m]: of the first axis."""
    count = len(position)
    along = int(period / SUPPORT)
    inverse = (along / period if along else 1 / SUPPORT), 1 / SUPPORT, 1 / SUPPORT
    sides, fixed = [(-0.2 if along else 0.0, inverse[0]), (0.0, inverse[1]), (0.0, inverse[2])], (along, 0, 0)
    cells = Cells(real, axes, count, NEIGHBOURS, most, FAR, sides, fixed, 0)
    quads = np.concatenate([position, np.arange(count)[:, None]], axis=1).astype(real)
    shuffled = np.random.default_rng(7).permutation(count).astype(np.int32)  # numbers of where particles lie
    arrays = quads, quads[:, ::-1].copy(), -quads, shuffled
    given = [cuda.to_device(a.reshape(-1)) for a in arrays]
    into = [cuda.to_device(np.zeros_like(a.copy_to_host())) for a in given]
    record = cuda.to_device(np.array([(SUPPORT,)], [("support", real)]))
    for _ in range(2):  # counters must be 0 again
        cells.bound(given[0])
        cells.sort(given, into)
    cells.find(into[0], record)
    return SimpleNamespace(cells=cells, arrays=arrays, into=into, numbers=cells.numbers.copy_to_host())


def keys_of(found: SimpleNamespace, position: np.ndarray, real: Any) -> np.ndarray:
    """The particles' cells by NumPy."""
    reals, (nx, ny, nz, *wraps, _) = found.cells.reals.copy_to_host(), found.numbers
    with np.errstate(invalid="ignore", over="ignore"):
        place = np.floor((position.astype(real) - reals[:3]) * reals[3:])
    place = np.where(np.abs(place) <= 2**30, place, 0).astype(np.int64)
    for axis, count in enumerate((nx, ny, nz)):
        place[:, axis] = place[:, axis] % count if wraps[axis] else np.clip(place[:, axis], 0, count - 1)
    return (place[:, 2] * ny + place[:, 1]) * nx + place[:, 0]


@pytest.mark.parametrize(
    ("kind", "axes", "most", "real"),
    [
        (SCATTERED, 3, 4096, np.float32), (CROWDED, 2, 4096, np.float64), (TORN, 3, 600, np.float32),
        (LOST, 3, 4096, np.float64), (TORN, 2, 64, np.float64),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:invalid value")
def test_orders_and_lists_are_those_of_asking_all(kind: str, axes: int, most: int, real: Any) -> None:
    position = cloud(kind, axes)
    found = made(axes, most, position, real)
    cells, (quads, *_, number) = found.cells, found.arrays
    assert found.numbers[CELLS] <= most
    assert any(found.numbers[WRAPS : WRAPS + 3]) == (kind == TORN)  # what is lost widens no grid
    order = np.lexsort((number, keys_of(found, position, real)))
    for given, into in zip(found.arrays, found.into, strict=True):
        rows = into.copy_to_host().reshape(given.shape)
        assert np.array_equal(rows, given[order], equal_nan=given.dtype == real)

    expected = near(quads[order, :3], 0.0)
    kept = cells.found.copy_to_host()
    table = cells.table.copy_to_host().reshape(NEIGHBOURS, len(position))
    assert [sorted(table[:n, i]) for i, n in enumerate(kept) if n < NEIGHBOURS] == [
        others for others, n in zip(expected, kept, strict=True) if n < NEIGHBOURS
    ]
    assert cells.lost == sum(max(0, len(others) - NEIGHBOURS) for others in expected)
    if not any(found.numbers[WRAPS : WRAPS + 3]):  # runs ascend, and so do places in them
        assert [table[:n, i].tolist() for i, n in enumerate(kept)] == [others[:NEIGHBOURS] for others in expected]


def near(position: np.ndarray, period: float) -> list[list[int]]:
    """Of each particle all that are within the support, in ascending order, by asking all."""
    way = position[:, None] - position
    if period:
        way[..., 0] -= period * np.round(way[..., 0] / period)
    with np.errstate(invalid="ignore", over="ignore"):
        squared = (way[..., 0] ** 2 + way[..., 1] ** 2) + way[..., 2] ** 2
        there = squared < position.dtype.type(SUPPORT) ** 2
    np.fill_diagonal(there, False)
    return [np.flatnonzero(row).tolist() for row in there]
