"""Meshes as bodies: what is made good and said, what is refused with what would do."""

import re

import numpy as np
import pytest
from closed_meshes import ball, both, box, soft, turned_over, volume_of
from meshes import sheet, strip
from test_mesh import binary_stl, obj, write

from softlab.model.assets.soft_body import RigidBody, SoftBody
from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.mesh import read_mesh, triangle_mesh
from softlab.model.geometry.solid import solid


def without(mesh, *triangles):
    return mesh[0], np.delete(mesh[1], triangles, axis=0)


def test_wide_holes_are_refused_and_small_ones_filled():
    """An octahedron's eighth is 0.17 m wide at three halvings, and away."""
    mesh = without(ball(halvings=3), 5)
    corners = ball(halvings=3)[0][ball(halvings=3)[1][5]]
    across = np.linalg.norm(np.ptp(corners, axis=0))
    with pytest.raises(InputError, match=rf"not closed \(a hole, {across:.3g} m across, with 3 edges, at .*close it"):
        solid(triangle_mesh(*mesh), 0.99 * across)
    body = solid(triangle_mesh(*mesh), across)
    assert body.notes == (f"1 hole, up to {across:.3g} m across, was filled with 1 triangle",)
    assert np.isclose(body.volume, volume_of(ball(halvings=3)), rtol=1e-12)
    two = solid(triangle_mesh(*without(mesh, 100, 101)), 0.5)
    assert re.match(r"\d holes, up to .* were filled with \d triangles", two.notes[0])
    assert abs(two.volume / volume_of(mesh) - 1) < 0.05
    assert soft(mesh, particle_spacing=0.2).report.notes[0].startswith("1 hole")


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_hole_of_many_edges(size):
    """A box without its lid: filled where a particle would not fall through, refused else."""
    position, triangles = box((0.3, 0.3, 0.3))
    lid = np.flatnonzero((position[triangles][:, :, 2] > 0).all(axis=1))
    open_box = position * size, np.delete(triangles, lid, axis=0)
    with pytest.raises(InputError, match="a hole"):
        RigidBody.from_mesh(open_box, particle_spacing=0.1 * size)
    assert solid(triangle_mesh(*open_box), 0.5 * size).volume == pytest.approx(0.3**3 * size**3)


def test_sheets_strips_and_flat_bodies_have_no_inside():
    with pytest.raises(InputError, match=r"not closed .*kind = \"soft_sheet\""):
        soft(sheet(4, 4))
    with pytest.raises(InputError, match=r"not closed \(2 holes, the widest"):
        soft(strip(12, 0))
    with pytest.raises(InputError, match="one side only"):
        soft(strip(12, 1))
    position, triangles = box()
    with pytest.raises(InputError, match="not closed"):  # top and bottom are one
        soft((position * [1, 1, 0], triangles))
    with pytest.raises(InputError, match="no volume"):  # a lone triangle, its rim filled with another
        solid(triangle_mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]), np.array([[0, 1, 2]])), 5.0)
    with pytest.raises(InputError, match="0 triangles"):
        soft((np.zeros((0, 3)), np.zeros((0, 3), int)))


def test_inside_out_is_turned_over():
    plain, over = (soft(mesh, surface_sampling=0.0) for mesh in (ball(), turned_over(ball())))
    assert over.report.notes == ("the mesh was inside out, and turned over",)
    assert plain.report.notes == ()
    assert np.array_equal(plain.position, over.position)
    assert np.allclose(plain.skin.normal, over.skin.normal, rtol=0, atol=1e-12)
    assert (np.einsum("ij,ij->i", over.skin.normal, over.skin.position) > 0).all()


def test_pieces_inside_out_and_cavities():
    """A ball beside a box, one of them inside out; a hollow box, whose inner side rightly looks inwards; all inside out."""
    ball_aside = ball()[0] + [2.0, 0, 0], ball()[1]
    one = solid(triangle_mesh(*both(box(), turned_over(ball_aside))), 0.1)
    assert one.notes == ("1 of 2 pieces was inside out, and turned over",)
    assert (one.pieces, one.volume) == (2, pytest.approx(1 + volume_of(ball())))
    hollow = both(box(), turned_over(box((0.6, 0.6, 0.6))))
    for mesh, told in ((hollow, ()), (turned_over(hollow), ("the mesh was inside out, and turned over",))):
        body = solid(triangle_mesh(*mesh), 0.1)
        assert (body.notes, body.pieces, body.volume) == (told, 1, pytest.approx(1 - 0.6**3))
        found = RigidBody.from_mesh(mesh, particle_spacing=0.1, volume_sampling=1.0, surface_sampling=0.0)
        assert len(found.position) == 1000 - 216
        assert np.abs(found.position).max(axis=1).min() > 0.3


def test_parts_that_overlap_count_once():
    mesh = both(box(), box(middle=(0.5, 0.0, 0.0)))
    found = soft(mesh, density=1000.0)
    assert any("overlap one another" in line for line in found.report.lines())
    assert found.report.pieces == 2
    assert found.report.parts == 1
    assert np.isclose(found.mass.sum(), 1500.0, rtol=1e-9)  # of whole spacings: every cell of the lattice counts right
    assert np.abs(found.position).max() <= 1.0


def test_files(tmp_path):
    whole = write(tmp_path, "ball.stl", binary_stl(*ball()))
    found = soft(read_mesh(whole))
    assert len(found.skin.position) == len(ball()[0])
    cut = write(tmp_path, "cut.stl", binary_stl(*ball())[:-70])
    with pytest.raises(InputError, match=r"cut\.stl.* triangles promised, which take .*cut short; export it again"):
        soft(read_mesh(cut))
    empty = write(tmp_path, "empty.obj", obj(ball()[0], []))
    with pytest.raises(InputError, match="no triangle"):
        soft(read_mesh(empty))


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_tiny_and_huge_bodies_are_alike(scale):
    """To the last bit: a power of two rounds nothing."""
    plain = RigidBody.from_mesh(ball(), particle_spacing=0.1)
    found = RigidBody.from_mesh((ball()[0] * scale, ball()[1]), particle_spacing=0.1 * scale)
    assert np.array_equal(found.position, plain.position * scale)
    assert np.array_equal(found.mass, plain.mass * scale**3)


def test_sizes_are_refused_with_what_would_do():
    for mesh, words in (
        ((ball()[0] * 1e-3, ball()[1]), "larger than the mesh"),
        ((ball()[0] * 1e3, ball()[1]), "at most"),
    ):
        with pytest.raises(SceneError, match=words) as refused:
            SoftBody.from_mesh(mesh, particle_spacing=0.1 if "larger" in words else 1.0)
        assert refused.value.field == "particle_spacing"
    with pytest.raises(InputError, match="at most 1e"):
        soft((ball()[0] * 1e10, ball()[1]))
