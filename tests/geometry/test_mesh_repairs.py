"""Meshes that are mended, and told so: copies of vertices, pieces, windings, holes; any soup of triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import octahedron, sheet, strip
from test_mesh import INF, NAN, check_sound, refused

from softlab.model.base.errors import InputError
from softlab.model.geometry.formats.polygons import FLAT
from softlab.model.geometry.mending.welding import NEAR
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh

# ---------------------------------------------------------------------- repairs


def test_repairs_are_told_with_their_numbers():
    """A square with every fault that is mended; the numbering says what became of the file's vertices."""
    position = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0], [1, 1, 0], [-0.0, 0, 0]]
    triangles = [(1, 2, 3), (7, 6, 4), (3, 2, 1), (1, 2, 5), (1, 7, 2), (2, 3, 7)]
    mesh = triangle_mesh(position, triangles)
    check_sound(mesh)
    assert mesh.repairs == (
        "2 vertices at the place of another were merged",
        "2 triangles without area were left out",
        "2 duplicate triangles were left out",
        "2 vertices that no triangle uses were left out",
    )
    assert mesh.numbering.tolist() == [-1, 0, 1, 2, 3, -1, 2, 0]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.lines()[1:] == list(mesh.repairs)


def test_the_lesser_part_is_turned_over():
    position, triangles = octahedron()
    triangles[[2, 5]] = triangles[[2, 5]][:, ::-1]
    mesh = triangle_mesh(position, triangles)
    check_sound(mesh)
    assert mesh.repairs == ("2 triangles were turned over to agree with their neighbours",)
    a, b, c = (mesh.position[corner] for corner in mesh.triangles.T)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()  # outer sides outwards, as most were
    assert (mesh.pieces, mesh.boundary_loops) == (1, 0)


def test_of_equal_parts_the_first_triangle_stays():
    mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [(2, 1, 0), (0, 2, 3)])
    assert mesh.repairs == ("1 triangle was turned over to agree with its neighbours",)
    assert mesh.triangles.tolist() == [[2, 1, 0], [0, 3, 2]]


def test_each_piece_is_turned_on_its_own():
    """Two sheets, one of them with all triangles turned over: they are not neighbours."""
    position, triangles = sheet(3, 3)
    both = np.concatenate([triangles, triangles[:, ::-1] + 9])
    mesh = triangle_mesh(np.concatenate([position, np.add(position, [0, 0, 1])]), both)
    assert mesh.repairs == ()
    assert np.array_equal(mesh.triangles, both)
    assert (mesh.pieces, mesh.boundary_loops) == (2, 2)


@pytest.mark.parametrize("half_turns", [0, 1, 2, 3])
def test_a_moebius_strip_is_refused(half_turns):
    """A strip with an odd number of half turns has one side (and one rim); with an even number two."""
    position, triangles = strip(30, half_turns)
    turn = np.random.default_rng(1).random(len(triangles)) < 0.5
    triangles[turn] = triangles[turn][:, ::-1]
    if half_turns % 2:
        assert "Moebius" in refused(lambda: triangle_mesh(position, triangles))
    else:
        mesh = triangle_mesh(position, triangles)
        check_sound(mesh)
        assert mesh.boundary_loops == 2


def test_holes_are_a_cloths_right():
    position, triangles = sheet(7, 7)
    middle = position[triangles].mean(axis=1)
    inside = (np.abs(middle[:, 0] - 3) < 1) & (np.abs(middle[:, 1] + 3) < 1)
    mesh = triangle_mesh(position, triangles[~inside])
    check_sound(mesh)
    assert (mesh.pieces, mesh.boundary_loops) == (1, 2)
    assert mesh.repairs == ("1 vertex that no triangle uses was left out",)  # the one in the middle of the hole
    assert "Euler characteristic 0" in mesh.lines()[0]


def test_a_vertex_between_two_fans_is_no_fault():
    """Two triangles that share one vertex: one piece, and one rim through it."""
    mesh = triangle_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [(0, 1, 2), (0, 3, 4)])
    assert (mesh.pieces, mesh.boundary_loops, mesh.repairs) == (1, 1, ())


def test_flatness_is_relative():
    """A triangle as flat as FLAT is left out at any size; one twice as high stays."""
    for size in (1e-6, 1.0, 1e6):
        for height, kept in ((FLAT / 2, 1), (FLAT * 2, 2)):
            position = size * np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0], [0.5, -1, 0]])
            assert len(triangle_mesh(position, [(0, 1, 2), (1, 0, 3)]).triangles) == kept


# ---------------------------------------------------------------------- anything at all

COORDINATES = st.sampled_from([0.0, -0.0, 1.0, 0.5, -1.0, 2.0, 1e-300, 1e-9]) | st.floats(-2, 2, width=32)
ODD = COORDINATES | st.sampled_from([NAN, INF, -INF, 1e300, 1e10])


def soups(coordinates):
    return st.integers(3, 9).flatmap(
        lambda n: st.tuples(
            st.lists(st.tuples(*[coordinates] * 3), min_size=n, max_size=n),
            st.lists(st.tuples(*[st.integers(0, n - 1)] * 3), min_size=1, max_size=12),
        )
    )


def told_count(mesh: TriangleMesh, words: str) -> int:
    return sum(int(line.split()[0]) for line in mesh.repairs if words in line)


@settings(deadline=None, max_examples=400)
@given(soups(COORDINATES) | soups(ODD))
def test_any_soup(soup):
    """A sound mesh, whose repairs account for everything that is missing, or one clear line."""
    position, triangles = soup
    try:
        mesh = triangle_mesh(position, triangles)
    except InputError as error:
        assert len(str(error)) < 400
        return
    check_sound(mesh)
    lost = told_count(mesh, "without area") + told_count(mesh, "duplicate")
    assert len(mesh.triangles) + lost == len(triangles)
    assert len(mesh.position) + told_count(mesh, "merged") + told_count(mesh, "no triangle uses") == len(position)
    kept = mesh.numbering >= 0
    moved = np.abs(mesh.position[mesh.numbering[kept]] - np.array(position)[kept])
    seam = any("closed seams" in line for line in mesh.repairs)
    assert moved.max() <= (2 * len(position) * NEAR * np.linalg.norm(np.ptp(position, axis=0)) if seam else 0)


@settings(deadline=None, max_examples=200)
@given(st.integers(3, 6), st.integers(3, 6), st.randoms(use_true_random=False))
def test_any_winding_is_mended(rows, columns, random):
    """A sheet with some triangles turned over comes back with as few turned as can be."""
    position, triangles = sheet(rows, columns)
    turn = np.array([random.random() < 0.3 for _ in triangles])
    mixed = np.where(turn[:, None], triangles[:, ::-1], triangles)
    mesh = triangle_mesh(position, mixed)
    check_sound(mesh)
    assert told_count(mesh, "turned over") == min(turn.sum(), (~turn).sum())
