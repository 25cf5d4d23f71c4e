"""Cut voxels weigh and stiffen by their part inside the mesh: volumes, centres and second moments, and a bent beam."""

import numpy as np
import pytest
from closed_meshes import blocks, both, box
from voxel_accuracy import (
    DENSITY,
    SHAPES,
    SIDE,
    beam,
    exact_sag,
    masses,
    mesh_sag,
    moments_off,
    order_of,
    static_sag,
    weights,
)  # fmt: skip

from softlab.model.geometry.edges import components
from softlab.model.geometry.moments import tetrahedra_moments
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("per_voxel", [5, 6])
def test_volumes_are_exact_and_moments_converge_with_the_second_power(name, per_voxel):
    """Second moments of what is lumped at vertices or spread over a tetrahedron are off by parts of an edge squared."""
    off = [moments_off(voxel_mesh(SHAPES[name], voxels=voxels, per_voxel=per_voxel)) for voxels in (5, 10, 20)]
    heavy, far, spread, lumped = zip(*off, strict=True)
    assert max(heavy) < 1e-12 and max(far) < 2e-3
    assert order_of(spread) > 1.6 and order_of(lumped) > 1.6 and spread[-1] < 0.02 and lumped[-1] < 0.03, off


@pytest.mark.parametrize("sides", [(1, 0.25, 0.25), (1, 0.23, 0.37), (0.02, 0.5, 0.011)])
@pytest.mark.parametrize("size", [{"voxels": 10}, {"edge": 0.1}])
def test_boxes_are_met_exactly(sides, size):
    body = voxel_mesh(box(sides, (0.1, 0.2, 0.3)), **size)
    assert np.ptp(body.mesh.position, axis=0) == pytest.approx(sides, rel=1e-12) and (body.fractions == 1).all()
    volume, _, second = tetrahedra_moments(body.mesh.position[body.mesh.tetrahedra], body.mesh.volumes)
    x, y, z = np.square(sides) * (volume / 12)
    assert second == pytest.approx([y + z, z + x, x + y], rel=1e-10)
    assert body.edge <= size.get("edge", max(sides) / 10) * (1 + 1e-12)


@pytest.mark.parametrize("where", [0.13, 0.5, 0.77])
def test_a_face_along_the_axes_is_exact_wherever_it_lies_in_a_voxel(where):
    """An L of three blocks, one of whose inner faces is on no lattice: the lines along the axis of its normal are exact, up
    to the number by which all cut voxels are scaled."""
    position, triangles = blocks([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 1.0)
    inner = np.isclose(position, 1.0)
    position = np.where(inner & (np.arange(3) == 1), where + 0.9, position)
    body = voxel_mesh((position, triangles), edge=0.25)
    column = (body.voxel[:, 0] == 6) & (body.voxel[:, 2] == 1)  # crossed by no face but the one of normal y
    held = weights(body)[column].sum()
    assert held == pytest.approx((where + 0.9) * np.prod(body.edges[[0, 2]]), rel=0.01)


def test_parts_of_a_doubled_voxel_weigh_what_is_theirs():
    thin, thick = box((1, 0.02, 0.1)), box((1, 0.06, 0.1), (0, 0.05, 0))
    body = voxel_mesh(both(thin, thick), edge=0.1)
    ends = [body.mesh.tetrahedra[:, [0, k]] for k in (1, 2, 3)]
    label = components(len(body.mesh.position), np.concatenate(ends))[body.mesh.tetrahedra[:, 0]]
    upper = label == label[body.embedding.tetrahedron[-1]]
    assert body.doubled == 10 and upper.sum() == 50
    assert weights(body)[upper].sum() == pytest.approx(0.006, rel=0.02)
    assert weights(body)[~upper].sum() == pytest.approx(0.002, rel=0.06)


def test_what_overlaps_counts_once():
    """Two blocks that share half of each: the hull's volume counts that half twice."""
    body = voxel_mesh(both(box((1, 0.4, 0.4)), box((1, 0.4, 0.4), (0.5, 0, 0))), edge=0.05)
    assert weights(body).sum() == pytest.approx(1.5 * 0.16, rel=1e-9) and body.hull.volume == pytest.approx(0.32)


def test_no_vertex_is_without_mass():
    for mesh in SHAPES.values():
        body = voxel_mesh(mesh, voxels=9)
        assert masses(body).min() > 0 and body.fractions.min() > 1e-5 and body.fractions.max() < 4.5


@pytest.mark.parametrize("degrees", [30.0, 45.0])
def test_a_beam_whose_section_does_not_fit_bends_as_one_that_does(degrees):
    """A square turned about its length bends as it does unturned, by Timoshenko, less what linear tetrahedra lock, which the
    fitting mesh of as many voxels across tells; and both converge. Whole voxels in place of fractions are far stiffer."""
    exact = exact_sag()
    for across, near in ((2, 0.08), (4, 0.04), (6, 0.045)):
        assert mesh_sag(degrees, across) / exact == pytest.approx(mesh_sag(0.0, across) / exact, abs=near)
    assert 0.87 < mesh_sag(degrees, 6) / exact < 1
    turned = voxel_mesh(beam(degrees), edge=SIDE / 4)
    ones = np.ones(len(turned.mesh.tetrahedra))
    whole = np.bincount(turned.mesh.tetrahedra.ravel(), np.repeat(DENSITY / 4 * turned.mesh.volumes, 4))
    assert static_sag(turned.mesh.position, turned.mesh.tetrahedra, ones, whole) / exact < 0.8
