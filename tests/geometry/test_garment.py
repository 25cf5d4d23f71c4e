"""The lab's own garment: the file is what the code makes, and it is a tunic."""

from importlib import resources

import numpy as np
from garment import Tunic, make_tunic, obj_text

from softlab.model.geometry.mesh import read_mesh, triangle_mesh

FILE = resources.files("softlab.model") / "catalogue" / "meshes" / "garment.obj"


def test_the_file_is_what_the_code_makes():
    position, triangles = make_tunic()
    text = FILE.read_text(encoding="utf-8")
    assert text == obj_text(position, triangles, "A tunic")
    assert len(text) < 300_000


def test_it_is_a_clean_mesh():
    """Nothing to mend; one piece; rims at the neck, two cuffs and the hem: a sphere with four holes, V - E + F = 2 - 4.

    Its sides are 0.9 to 2.7 cells long and no triangle is a sliver: 4 sqrt(3) area / (sum of squared sides), 1 for an
    equilateral one, is over 0.5."""
    with resources.as_file(FILE) as path:
        mesh = read_mesh(path)
    position, triangles = make_tunic()
    assert mesh.repairs == ()
    assert np.array_equal(mesh.position, position)
    assert np.array_equal(mesh.triangles, triangles)
    assert 2000 <= len(position) <= 4000
    assert (mesh.pieces, mesh.boundary_loops) == (1, 4)
    assert len(position) - len(mesh.edges.edges) + len(triangles) == -2
    sides = np.diff(position[triangles[:, [0, 1, 2, 0]]], axis=1)
    squares = (sides**2).sum(axis=2)
    cell = Tunic().cell
    assert (0.9 * cell) ** 2 < squares.min()
    assert squares.max() < (2.7 * cell) ** 2
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    assert (4 * np.sqrt(3) * area / squares.sum(axis=1)).min() > 0.5


def test_it_faces_outwards_and_is_symmetric():
    position, triangles = make_tunic()
    a, b, c = (position[corner] for corner in triangles.T)
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
    assert (normal[:, 2] * middle[:, 2] > 0).all()
    places = {tuple(point) for point in position.tolist()}
    for mirror in ((-1, 1, 1), (1, 1, -1)):
        assert {tuple(point) for point in (position * mirror + 0.0).tolist()} == places


def test_other_cuts():
    for tunic in (Tunic(sleeve=1), Tunic(width=8, height=9, sleeve=3, cuff=4, neck=4, flare=0.0, slope=0.0)):
        mesh = triangle_mesh(*make_tunic(tunic))
        assert (mesh.repairs, mesh.pieces, mesh.boundary_loops) == ((), 1, 4)
