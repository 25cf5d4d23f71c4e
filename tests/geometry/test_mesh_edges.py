"""What lies beside what in a mesh: counts in closed form, and every list against a slow search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import octahedron, sheet, strip

from softlab.model.base.errors import InputError
from softlab.model.core.stability.springs import spring_ends
from softlab.model.geometry.edges import components, mesh_edges
from softlab.model.geometry.lists import grouped


@pytest.mark.parametrize(("rows", "columns"), [(2, 2), (2, 7), (5, 3), (6, 6)])
def test_a_sheets_counts_are_the_cloths(rows, columns):
    """Edges: the cloth's structural springs and one diagonal a cell. Rim: 2 (rows + columns - 2). V - E + F = 1: a disc."""
    _, triangles = sheet(rows, columns)
    found = mesh_edges(rows * columns, triangles)
    cells = (rows - 1) * (columns - 1)
    assert len(triangles) == 2 * cells
    assert len(found.edges) == rows * (columns - 1) + columns * (rows - 1) + cells
    assert rows * columns - len(found.edges) + len(triangles) == 1
    assert found.boundary.sum() == 2 * (rows + columns - 2)
    assert len(found.winged) == len(found.inner) == len(found.edges) - found.boundary.sum()
    assert (found.boundary_loops(), found.parts()) == (1, 1)
    structural = {tuple(sorted(ends)) for ends in spring_ends(rows, columns, "structural").tolist()}
    index = np.arange(rows * columns).reshape(rows, columns)
    diagonal = set(zip(index[:-1, :-1].ravel().tolist(), index[1:, 1:].ravel().tolist(), strict=True))
    assert {tuple(ends) for ends in found.edges.tolist()} == structural | diagonal


def test_closed_and_open_surfaces():
    """V - E + F: 2 of a sphere, 0 of a ring, which has two rims."""
    _, triangles = octahedron()
    ball = mesh_edges(6, triangles)
    assert 6 - len(ball.edges) + len(triangles) == 2
    assert (ball.boundary_loops(), ball.parts(), ball.boundary.sum()) == (0, 1, 0)
    _, triangles = strip(8, 0)
    ring = mesh_edges(16, triangles)
    assert 16 - len(ring.edges) + len(triangles) == 0
    assert ring.boundary_loops() == 2


def check_lists(count: int, triangles: np.ndarray) -> None:
    found = mesh_edges(count, triangles)
    beside: dict[tuple[int, int], list[int]] = {}
    for number, triangle in enumerate(triangles.tolist()):
        for k in range(3):
            beside.setdefault(tuple(sorted((triangle[k], triangle[(k + 1) % 3]))), []).append(number)
            assert sorted((triangle[k], triangle[(k + 1) % 3])) == found.edges[found.sides[number, k]].tolist()
    assert [tuple(ends) for ends in found.edges.tolist()] == sorted(beside)
    assert [[t for t in two if t >= 0] for two in found.triangles.tolist()] == [beside[key] for key in sorted(beside)]
    for vertex in range(count):
        at = [number for number, triangle in enumerate(triangles.tolist()) if vertex in triangle]
        assert found.vertex_triangles[vertex].tolist() == at
        others = sorted({a + b - vertex for a, b in beside if vertex in (a, b)})
        assert found.neighbours[vertex].tolist() == others
    for (a, b, c, d), edge, alike in zip(found.winged.tolist(), found.inner, found.alike, strict=True):
        one, two = triangles[found.triangles[edge]].tolist()
        assert (a, b, c) in [tuple(np.roll(one, k).tolist()) for k in range(3)]
        passed = (a, b, d) if alike else (b, a, d)
        assert passed in [tuple(np.roll(two, k).tolist()) for k in range(3)]


@settings(deadline=None, max_examples=80)
@given(st.integers(2, 5), st.integers(2, 5), st.randoms(use_true_random=False))
def test_lists_against_a_search(rows, columns, random):
    """Of sheets with triangles left out, turned over and shuffled, vertices renumbered."""
    _, triangles = sheet(rows, columns)
    chosen = [list(t) for t in triangles.tolist() if random.random() < 0.8]
    random.shuffle(chosen)
    number = random.sample(range(rows * columns), rows * columns)
    turned = [[number[k] for k in (t if random.random() < 0.5 else t[::-1])] for t in chosen]
    check_lists(rows * columns, np.array(turned, dtype=int).reshape(-1, 3))


def test_fins_are_refused():
    with pytest.raises(InputError, match=r"1 edge has .* between vertices 0 and 1 with 3; .*split"):
        mesh_edges(5, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    with pytest.raises(InputError, match="2 edges have"):
        mesh_edges(8, np.array([[4, 5, 6], [5, 4, 7], [4, 5, 0], [4, 6, 1], [4, 6, 2]]))


def test_grouped_keeps_the_order():
    lists = grouped(np.array([2, 0, 2, 2]), np.array([9, 8, 7, 6]), 4)
    assert [lists[k].tolist() for k in range(4)] == [[8], [], [9, 7, 6], []]
    assert lists.lengths.tolist() == [1, 0, 3, 0]


@settings(deadline=None, max_examples=200)
@given(st.integers(1, 40).flatmap(lambda n: st.tuples(st.just(n), st.lists(st.tuples(*[st.integers(0, n - 1)] * 2)))))
def test_components_against_relabelling(case):
    count, ends = case
    label = list(range(count))
    for a, b in ends:
        low, high = sorted((label[a], label[b]))
        label = [low if x == high else x for x in label]
    assert components(count, np.array(ends).reshape(-1, 2)).tolist() == label


def test_components_of_a_path_of_any_numbering():
    """The longest chain there is: 100 000 nodes, each hung under the next lower one or at random."""
    for order in (np.arange(10**5), np.random.default_rng(0).permutation(10**5)):
        assert not components(10**5, np.stack([order[:-1], order[1:]], 1)).any()
