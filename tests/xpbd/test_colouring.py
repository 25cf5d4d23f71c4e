"""Colours for constraints: no two of one colour share a vertex, none is forgotten, few are used, and always the same ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import octahedron, sheet

from softlab.model.base.errors import SceneError
from softlab.model.core.stability.springs import spring_ends
from softlab.model.geometry.colouring import MAX_COLOURS, Colouring, colour
from softlab.model.geometry.edges import mesh_edges


def check_valid(constraints: np.ndarray, found: Colouring) -> None:
    assert sorted(found.order.tolist()) == list(range(len(constraints)))
    assert found.starts[0] == 0
    assert found.starts[-1] == len(constraints)
    sizes = np.diff(found.starts)
    assert (sizes > 0).all()
    assert (np.diff(sizes) <= 0).all()
    for start, end in zip(found.starts[:-1], found.starts[1:], strict=True):
        members = found.order[start:end]
        assert (np.diff(members) > 0).all()
        vertices = constraints[members].ravel()
        assert len(np.unique(vertices)) == len(vertices)
    assert found.least == np.bincount(constraints.ravel(), minlength=1).max(initial=0)
    assert found.colours >= found.least
    if len(constraints):
        # a constraint is kept from at most k (least - 1) colours by those that share a vertex with it
        assert found.colours <= constraints.shape[1] * (found.least - 1) + 1


@settings(deadline=None, max_examples=120)
@given(st.integers(1, 4), st.integers(4, 12), st.randoms(use_true_random=False), st.integers(0, 40))
def test_any_constraints(k, vertices, random, count):
    """Of 1 to 4 vertices each, also several on the same ones: valid, under the bound of any greedy colouring, repeatable."""
    constraints = np.array([random.sample(range(vertices), k) for _ in range(count)], dtype=np.int32).reshape(-1, k)
    found = colour(constraints, vertices)
    check_valid(constraints, found)
    again = colour(constraints, vertices)
    assert np.array_equal(found.order, again.order)
    assert np.array_equal(found.starts, again.starts)


@pytest.mark.parametrize(("kind", "least", "most"), [("structural", 4, 5), ("shear", 4, 5), ("bending", 4, 5)])
def test_a_cloths_springs(kind, least, most):
    """Four springs of a kind meet at an inner mass: 4 colours are needed and do for a grid, one more may be spent."""
    ends = spring_ends(24, 24, kind)
    found = colour(ends, 24 * 24)
    check_valid(ends, found)
    assert found.least == least
    assert found.colours <= most


def test_a_meshs_constraints():
    """Edges, triangles and winged edges of a sheet: valence 6, 6 and 12 (6 edges at a vertex, and 6 that it faces)."""
    _, triangles = sheet(30, 30)
    edges = mesh_edges(900, triangles)
    for constraints, least, most in ((edges.edges, 6, 7), (triangles, 6, 9), (edges.winged, 12, 18)):
        found = colour(constraints, 900)
        check_valid(constraints, found)
        assert found.least == least
        assert found.colours <= most  # seen: 7, 8 and 17


def test_as_many_colours_as_edges_at_a_hub():
    """A star needs a colour for each ray; beyond MAX_COLOURS that is refused, and the vertex is named."""
    for rays in (5, 100, MAX_COLOURS):
        star = np.stack([np.zeros(rays, int), np.arange(1, rays + 1)], axis=1)
        found = colour(star, rays + 1)
        check_valid(star, found)
        assert found.colours == rays
    star = np.stack([np.full(MAX_COLOURS + 1, 3), np.arange(4, MAX_COLOURS + 5)], axis=1)
    with pytest.raises(SceneError, match="meet at vertex 3"):
        colour(star, MAX_COLOURS + 5)


def test_the_seed_decides():
    _, triangles = octahedron()
    constraints = mesh_edges(6, triangles).edges
    found = {tuple(colour(constraints, 6, seed).order.tolist()) for seed in range(10)}
    assert len(found) > 1


def test_none():
    found = colour(np.zeros((0, 2), dtype=int), 5)
    assert (found.colours, found.least, found.starts.tolist()) == (0, 0, [0])
