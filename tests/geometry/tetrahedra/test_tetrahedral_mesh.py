"""Laws of tetrahedra: volumes, quality, masses, the surface, the inverse of the rest state; and what is refused."""

import numpy as np
import pytest
from closed_meshes import ball, box, rotation, volume_of

from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh, rest_inverse, signed_volumes
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh

CORNER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
REGULAR = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])


def test_one_tetrahedron():
    mesh = TetrahedralMesh(CORNER, np.array([[0, 1, 2, 3]]))
    assert mesh.volumes == pytest.approx(1 / 6, rel=1e-15) and mesh.tetrahedra.dtype == np.int32
    assert len(mesh.surface) == 4 and mesh.pieces() == 1
    assert volume_of((mesh.position, mesh.surface)) == pytest.approx(1 / 6, rel=1e-15)  # outer sides outwards
    assert mesh.masses(600.0) == pytest.approx(np.full(4, 25.0))


def test_quality_is_1_of_a_regular_tetrahedron_whatever_its_size_and_0_of_a_flat_one():
    for scale in (1e-12, 1.0, 1e8):
        turned = REGULAR @ rotation((0.3, -1.0, 2.0)).T * scale
        tetrahedra = (
            np.array([[0, 1, 2, 3]]) if signed_volumes(turned, np.array([[0, 1, 2, 3]])) > 0 else [[0, 1, 3, 2]]
        )
        assert TetrahedralMesh(turned, tetrahedra).quality == pytest.approx(1, rel=1e-14)
    flat = CORNER * [1, 1, 1e-6]
    assert 0 < TetrahedralMesh(flat, np.array([[0, 1, 2, 3]])).quality[0] < 1e-3


def test_masses_add_up_to_density_times_volume():
    mesh = voxel_mesh(ball(), voxels=6).mesh
    assert mesh.masses(1234.5).sum() == pytest.approx(1234.5 * mesh.volumes.sum(), rel=1e-13)
    with pytest.raises(SceneError, match=r"density = 0.*greater than 0"):
        mesh.masses(0.0)


def test_the_rest_inverse_takes_edges_to_the_identity_and_a_deformed_state_to_its_gradient():
    mesh = voxel_mesh(ball(), voxels=5).mesh
    inverse = rest_inverse(mesh.position, mesh.tetrahedra)
    gradient = np.array([[1.1, 0.2, 0], [-0.3, 0.9, 0.4], [0, 0.1, 1.5]])
    corners = (mesh.position @ gradient.T + [1, 2, 3])[mesh.tetrahedra]
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    assert np.abs(edges @ inverse - gradient).max() < 1e-13


def test_the_surface_holds_the_volume():
    """The divergence theorem: what the outer faces enclose is the sum of the tetrahedra."""
    for per_voxel in (5, 6):
        mesh = voxel_mesh(ball(), voxels=7, per_voxel=per_voxel).mesh
        assert volume_of((mesh.position, mesh.surface)) == pytest.approx(mesh.volumes.sum(), rel=1e-12)
        assert set(np.unique(mesh.face_counts)) == {1, 2}


@pytest.mark.parametrize("many", [1, 3])
def test_inverted_tetrahedra_are_refused_by_number_place_and_remedy(many):
    mesh = voxel_mesh(box(), voxels=2).mesh
    wrong = mesh.tetrahedra.copy()
    wrong[7 : 7 + many] = wrong[7 : 7 + many, [0, 1, 3, 2]]
    x, y, z = mesh.position[wrong[7]].mean(axis=0)
    place = rf"first tetrahedron 7 \(counted from 0\) at \({x:.4g}, {y:.4g}, {z:.4g}\), inside out, volume -"
    with pytest.raises(InputError, match=rf"{many} of 40 tetrahedra .*{place}.*swap two corners"):
        TetrahedralMesh(mesh.position, wrong)


def test_what_is_refused():
    one = np.array([[0, 1, 2, 3]])
    for position, tetrahedra, words in (
        (CORNER, one[:, [0, 2, 1, 3]], "all are inside out: swap two corners of each"),
        (CORNER * [1, 1, 0], one, "flat, volume 0 m.*mesh the body again"),
        (CORNER * [1, 1, 1e-17] + [0, 0, 1], one, "flat"),
        (CORNER * 1e-3 + 1e14, one, "give a scale"),
        (CORNER * 1e-9 + 1e8, one, "nearer to the origin"),
        (CORNER * 1e-120, one, "flat"),  # its volume is no number of float64
        (CORNER * np.nan, one, "4 of 4 vertices have no finite coordinates"),
        (CORNER, np.array([[0, 1, 2, 4]]), "tetrahedron 0 .*names vertex 4, and there are 4"),
        (CORNER, np.array([[0, 1, 2, -1]]), "names vertex -1"),
        (CORNER, np.zeros((0, 4), int), "there is no tetrahedron"),
        (np.zeros((0, 3)), one, "names vertex 0, and there are 0|names vertex 3"),
    ):
        with pytest.raises(InputError, match=words):
            TetrahedralMesh(position, tetrahedra)
