"""A fluid's particles in the order of cells on CUDA, in plain Python: the order is NumPy's, the lists are those of
asking all, whatever the box, the room for cells, and the sides that repeat."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import cuda

from softlab.gpu_backend.fluid.cells import Cells, Particles
from softlab.gpu_backend.fluid.kernels import make_density_kernels
from softlab.gpu_backend.fluid.sort_kernels import CELLS, WRAPS
from softlab.model.fluid.parameters import FLUID_PARAMETERS

SUPPORT, NEIGHBOURS, PERIOD = 0.1, 6, 0.5
SCATTERED, CROWDED, TORN, LOST, ROUND = "scattered", "crowded", "torn", "lost", "round"


def cloud(kind: str, axes: int) -> np.ndarray:
    """(particles, 3) [m]: `crowded` into a cell or two, `torn` into two heaps far apart, some `lost` in space, or `round`
    in a box that repeats."""
    random, count = np.random.default_rng(3), 90
    place = random.uniform(-0.2, 0.3, (count, 3)) * (0.2 if kind == CROWDED else 1.0)
    place[10], place[11] = place[50], np.round(place[11] / SUPPORT) * SUPPORT
    if kind == TORN:
        place[count // 2 :, 0] += 37.0
    if kind == LOST:
        place[5], place[6, 1], place[7, 0] = np.nan, np.inf, -np.inf
    place[:, axes:] = 0
    return place


def record_for(kind: str, real: Any) -> Any:
    """What the kernels read of the constants. The first axis repeats from -0.2 m on."""
    cells = int(PERIOD / SUPPORT)
    values = dict.fromkeys(FLUID_PARAMETERS, 0.0) | {
        "support": SUPPORT, "inverse_cell": 1 / SUPPORT, "low_x": -0.2, "side_x": PERIOD, "half_x": PERIOD / 2,
        "cells_x": cells, "inverse_side_x": cells / PERIOD,
    }  # fmt: skip
    return cuda.to_device(np.array([tuple(values.values())], [(name, real) for name in values]))


def made(kind: str, axes: int, most: int, real: Any) -> SimpleNamespace:
    """Sorted, and neighbours found."""
    position = cloud(kind, axes)
    count, repeats = len(position), frozenset("x" if kind == ROUND else "")
    cells, record = Cells(real, count, NEIGHBOURS, most, repeats, 0), record_for(kind, real)
    quads = np.concatenate([position, np.arange(count)[:, None]], axis=1).astype(real)
    shuffled = np.random.default_rng(7).permutation(count).astype(np.int32)  # numbers of where particles lie
    arrays = quads, quads[:, ::-1].copy(), -quads, shuffled
    given = Particles(*(cuda.to_device(a.reshape(-1)) for a in arrays))
    into = Particles(*(cuda.to_device(np.zeros_like(a.copy_to_host())) for a in given))
    for _ in range(2):  # counters must be 0 again
        cells.bound(given.position)
        cells.sort(record, given, into)
    find = make_density_kernels(real, "exact", frozenset({"flat"} if axes == 2 else ()), repeats, NEIGHBOURS).find
    table = cells.table, cells.neighbour_counts, cells.counts
    find[-(-count // 32), 32](into.position, record, cells.sorted_keys, cells.numbers, cells.begins, *table)
    return SimpleNamespace(cells=cells, arrays=arrays, into=into, numbers=cells.numbers.copy_to_host())


def keys_of(found: SimpleNamespace, real: Any) -> np.ndarray:
    """The particles' cells by NumPy."""
    reals, (nx, ny, nz, *_) = found.cells.reals.copy_to_host(), found.numbers
    with np.errstate(invalid="ignore", over="ignore"):
        place = (found.arrays[0][:, :3] - reals[:3]) * reals[3:]
        place = np.clip(np.where(np.isnan(place), 0, place), 0, [nx - 1, ny - 1, nz - 1]).astype(np.int64)
    return (place[:, 2] * ny + place[:, 1]) * nx + place[:, 0]


@pytest.mark.parametrize(
    ("kind", "axes", "most", "real"),
    [
        (SCATTERED, 3, 4096, np.float32), (CROWDED, 2, 4096, np.float64), (TORN, 3, 600, np.float32),
        (LOST, 3, 4096, np.float64), (TORN, 2, 64, np.float64), (ROUND, 3, 4096, np.float64),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:invalid value")
def test_orders_and_lists_are_those_of_asking_all(kind: str, axes: int, most: int, real: Any) -> None:
    found = made(kind, axes, most, real)
    cells, (quads, *_, number) = found.cells, found.arrays
    assert found.numbers[CELLS] <= most
    assert (cells.reals.copy_to_host()[3] < real(1 / SUPPORT)) == (kind == TORN)  # cells are larger
    assert found.numbers[WRAPS] == (kind == ROUND)
    order = np.lexsort((number, keys_of(found, real)))
    for given, into in zip(found.arrays, found.into, strict=True):
        rows = into.copy_to_host().reshape(given.shape)
        assert np.array_equal(rows, given[order], equal_nan=given.dtype == real)

    expected = near(quads[order, :3], PERIOD if kind == ROUND else 0.0)
    kept = cells.neighbour_counts.copy_to_host()
    table = cells.table.copy_to_host().reshape(NEIGHBOURS, len(order))
    lists = [table[:n, i].tolist() for i, n in enumerate(kept)]
    assert any(len(others) > 2 for others in lists)
    assert [sorted(own) for own in lists if len(own) < NEIGHBOURS] == [
        others for others, own in zip(expected, lists, strict=True) if len(own) < NEIGHBOURS
    ]
    assert cells.lost == sum(max(0, len(others) - NEIGHBOURS) for others in expected)
    if kind != ROUND:  # runs ascend, and so do places in them
        assert lists == [others[:NEIGHBOURS] for others in expected]


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
