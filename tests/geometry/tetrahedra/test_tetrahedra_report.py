"""The report of a body tells what can be computed another way."""

import numpy as np
import pytest
from closed_meshes import ball, both, box, volume_of

from softlab.model.geometry.tetrahedra.embedding import Embedding, carriers, weights_of
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh
from softlab.model.geometry.tetrahedra.report import report_of
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh


def told(mesh, voxels=5, density=500.0):
    body = voxel_mesh(mesh, voxels=voxels)
    sizes, hull = (len(body.starts) - 1, body.edges, body.doubled), body.hull
    surface = hull.position, hull.triangles
    return report_of(
        body.mesh, body.embedding, hull.volume, density, hull.notes, sizes, fractions=body.fractions, surface=surface
    )


def test_a_ball():
    report = told(ball())
    assert report.hull_volume == pytest.approx(volume_of(ball())) and report.volume_ratio == pytest.approx(1)
    assert report.mass == pytest.approx(500 * report.hull_volume) and 0 < report.cut < report.tetrahedra
    assert report.outside == 0 and report.farthest == 0 and report.points == len(ball()[0])
    first, second, quality, points, mass, moments = report.lines()
    assert (
        first == f"{report.tetrahedra} tetrahedra, {report.vertices} vertices, {report.voxels} voxels of 0.2 m, 1 piece"
    )
    assert second.endswith(
        f"m^3, that within the surface; {report.cut} tetrahedra are partly outside and count by their part inside"
    )
    assert moments.startswith("moments of inertia about x, y, z through the centre: ")
    assert quality.startswith("quality (mean ratio, 1 of a regular one) 0.8399 at worst, tetrahedron ")
    assert points == f"{len(ball()[0])} points of the surface, none outside its tetrahedron" and "at 500 kg/m^3" in mass


def test_whole_voxels_have_the_surface_s_volume_and_doubled_ones_are_told():
    assert "m^3, that within the surface" in told(box((1, 0.2, 0.2))).lines()[1]
    two = told(both(box((1, 0.03, 0.05)), box((1, 0.03, 0.05), (0, 0.06, 0))), 10)
    assert "10 voxels of 0.1 x 0.09 x 0.05 m (10 doubled for pieces that do not touch), 2 pieces" in two.lines()[0]


def test_the_regular_tetrahedron_is_the_best_of_five():
    """One in five of a voxel is regular, the others are corners of a cube: 3 (1/2)^(2/3) / (3/4 + 3/2) each."""
    report = told(box(), 4)
    corner = 12 * (3 / 6) ** (2 / 3) / 9
    assert report.worst_quality == pytest.approx(corner) and report.mean_quality == pytest.approx((1 + 4 * corner) / 5)


def test_points_outside_are_counted_with_their_distance():
    mesh = TetrahedralMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]]))
    points = np.array([[0.1, 0.1, 0.1], [0.2, 0.3, -0.25], [1, 1, 1], [0, 0, 0]])
    weights = weights_of(points, mesh.position, mesh.tetrahedra[[0, 0, 0, 0]])
    embedding = Embedding(np.zeros(4, np.int32), weights)
    assert np.abs(embedding.points(mesh.position, mesh.tetrahedra) - points).max() < 1e-15
    assert embedding.beyond(mesh.position, mesh.tetrahedra) == pytest.approx([0, 0.25, 2 / np.sqrt(3), 0])
    report = report_of(mesh, embedding, 1 / 6, 1.0)
    assert (
        report.outside == 2
        and "4 points of the surface, 2 outside the tetrahedron, the farthest by 1.15 m" in report.lines()
    )


def test_points_are_carried_by_the_tetrahedron_that_they_lie_in():
    mesh = voxel_mesh(box(), voxels=4).mesh
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (500, 3))
    found = carriers(mesh, points)
    assert np.abs(found.points(mesh.position, mesh.tetrahedra) - points).max() < 1e-15 and found.weights.min() > -1e-14
