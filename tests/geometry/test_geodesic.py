"""Nearest anchors and distances to them: against all distances on a sheet, against Dijkstra's algorithm on a mesh."""

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import sheet

from softlab.model.core.build import pinned_indices, rest_positions
from softlab.model.geometry.edges import mesh_edges
from softlab.model.geometry.geodesic import KEY_BITS, mesh_attachments, sheet_attachments
from softlab.model.tables.cloth import Cloth


def check_sheet(rest: np.ndarray, pinned: np.ndarray, count: int) -> None:
    """Every distance is that to its anchor, they ascend, and none is left out that is nearer. Equally near (to 1 part in
    2^31 of the sheet's size): the lower index first."""
    anchor, distance = sheet_attachments(rest, pinned, count)
    pinned = np.unique(pinned)
    taken = min(count, len(pinned))
    assert anchor.shape == distance.shape == (len(rest), count)
    assert (anchor.dtype, distance.dtype) == (np.int32, np.float64)
    assert (anchor[:, taken:] == -1).all()
    assert np.isinf(distance[:, taken:]).all()
    every = np.sqrt(((rest[:, None] - rest[None, pinned]) ** 2).sum(axis=2))
    same = np.linalg.norm(np.ptp(rest, axis=0)) * 2.0**-KEY_BITS
    assert np.allclose(distance[:, :taken], np.sort(every, axis=1)[:, :taken], rtol=0, atol=same)
    chosen = np.searchsorted(pinned, anchor[:, :taken])
    assert np.array_equal(pinned[chosen], anchor[:, :taken])
    assert np.array_equal(np.take_along_axis(every, chosen, axis=1), distance[:, :taken])
    for row, numbers in enumerate(anchor[:, :taken].tolist()):
        assert len(set(numbers)) == taken
        for k in range(taken - 1):
            assert distance[row, k] <= distance[row, k + 1] + same
            if abs(distance[row, k] - distance[row, k + 1]) < same / 8:
                assert numbers[k] < numbers[k + 1]


WORDS = ["none", "top", "top-corners", "left", "edges", "every:3", [[2, 1], [0, 0], [7, 11], [7, 10], [3, 4]]]


@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("pinned", WORDS, ids=str)
@pytest.mark.parametrize("placement", ["hanging", "flat"])
def test_sheets(pinned, placement, count):
    cloth = Cloth(rows=17, columns=23, spacing=0.1, pinned=pinned, placement=placement, origin=(0.3, -1.0, 2.0))
    check_sheet(rest_positions(cloth), pinned_indices(cloth), count)


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 12), st.integers(1, 12), st.integers(1, 5), st.randoms(use_true_random=False))
def test_any_pins(rows, columns, count, random):
    rest, _ = sheet(rows, columns, 0.07)
    pinned = random.sample(range(rows * columns), random.randint(0, rows * columns))
    check_sheet(rest, np.array(pinned, dtype=int), count)


def test_in_blocks():
    """A sheet of more masses than one block, with a row of pins, a column and scattered ones."""
    rest, _ = sheet(70, 80, 0.013)
    scattered = np.random.default_rng(2).choice(5600, 90, replace=False)
    pinned = np.concatenate([np.arange(80), 79 + 80 * np.arange(70), scattered])
    check_sheet(rest, pinned, 2)


def test_in_closed_form():
    """Hung by its top row, the nearest anchor of a mass is the one above, and the next one or two beside that."""
    rows, columns, spacing = 9, 40, 0.25
    rest, _ = sheet(rows, columns, spacing)
    anchor, distance = sheet_attachments(rest, np.arange(columns), 2)
    row, column = np.divmod(np.arange(rows * columns), columns)
    assert np.array_equal(anchor[:, 0], column)
    assert np.array_equal(anchor[:, 1], np.where(column > 0, column - 1, 1))
    assert np.array_equal(distance[:, 0], row * spacing)
    assert np.array_equal(distance[:, 1], np.sqrt((row * spacing) ** 2 + spacing**2))


def dijkstra(position: np.ndarray, edges, source: int) -> np.ndarray:
    far = np.full(len(position), np.inf)
    far[source] = 0.0
    heap = [(0.0, source)]
    lists = edges.neighbours
    while heap:
        here, vertex = heapq.heappop(heap)
        if here > far[vertex]:
            continue
        for other in lists[vertex].tolist():
            there = here + np.linalg.norm(position[vertex] - position[other])
            if there < far[other]:
                far[other] = there
                heapq.heappush(heap, (there, other))
    return far


@settings(deadline=None, max_examples=60)
@given(st.integers(2, 9), st.integers(2, 9), st.integers(1, 5), st.randoms(use_true_random=False))
def test_meshes_against_dijkstra(rows, columns, count, random):
    """Crumpled sheets with triangles left out, so that there are holes, pieces and vertices out of reach.

    Tolerance: both add up to 81 lengths along a way, each sum rounded to half a unit in the last place of it."""
    position, triangles = sheet(rows, columns)
    position = position + np.array([[random.uniform(-0.3, 0.3) for _ in range(3)] for _ in position])
    triangles = triangles[[random.random() < 0.8 for _ in triangles]]
    edges = mesh_edges(len(position), triangles)
    anchors = sorted(random.sample(range(len(position)), random.randint(0, min(7, len(position)))))
    anchor, distance = mesh_attachments(position, edges, np.array(anchors, dtype=int), count)
    every = np.array([dijkstra(position, edges, source) for source in anchors]).reshape(len(anchors), len(position))
    padded = np.concatenate([every, np.full((count, len(position)), np.inf)])
    expected = np.sort(padded, axis=0)[:count].T
    reached = np.isfinite(expected)
    assert np.array_equal(np.isfinite(distance), reached)
    assert np.array_equal(anchor >= 0, reached)
    assert np.allclose(distance[reached], expected[reached], rtol=81 * 2.0**-52, atol=0)
    vertex, place = np.nonzero(reached)
    found = every[np.searchsorted(anchors, anchor[reached]), vertex] if len(vertex) else np.zeros(0)
    assert np.allclose(found, distance[vertex, place], rtol=81 * 2.0**-52, atol=0)
    for numbers in anchor.tolist():
        assert len({k for k in numbers if k >= 0}) == sum(k >= 0 for k in numbers)


def test_on_a_mesh_in_closed_form():
    """Along rows and columns and the one diagonal of its cells: to the upper left corner max(i, j) - m straight steps and
    m = min(i, j) diagonal ones; to the upper right one i + j, for no edge runs that way. Never under the straight line."""
    rows, columns = 12, 15
    position, triangles = sheet(rows, columns)
    edges = mesh_edges(len(position), triangles)
    anchor, distance = mesh_attachments(position, edges, np.array([columns - 1, 0]), 2)
    i, j = np.divmod(np.arange(rows * columns), columns)
    left = np.maximum(i, j) - np.minimum(i, j) + np.sqrt(2) * np.minimum(i, j)
    right = i + (columns - 1 - j)
    to = {number: np.where(anchor[:, 0] == number, distance[:, 0], distance[:, 1]) for number in (0, columns - 1)}
    assert np.allclose(to[0], left, rtol=1e-14)
    assert np.allclose(to[columns - 1], right, rtol=1e-14)
    assert (np.sort(anchor, axis=1) == [0, columns - 1]).all()
    straight = sheet_attachments(position, np.array([0]), 1)[1][:, 0]
    assert (to[0] >= straight * (1 - 1e-14)).all()


def test_of_equally_far_anchors_the_lower_comes_first():
    position, triangles = sheet(2, 5)
    edges = mesh_edges(10, triangles)
    anchor, _ = mesh_attachments(position, edges, np.array([4, 0]), 2)
    assert anchor[2].tolist() == [0, 4]
