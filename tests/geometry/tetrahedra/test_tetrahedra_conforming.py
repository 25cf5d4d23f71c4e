"""Tetrahedra that follow a surface: its volume, what carries it, open and crossing surfaces; and where it is missing.

Those that need wildmeshing (pip install -e ".[tets]") are skipped without it.
"""

import importlib.util

import numpy as np
import pytest
from closed_meshes import ball, both, box, without_some

from softlab.model.assets.cooked import cooked
from softlab.model.base.errors import BackendUnavailable, InputError, SceneError
from softlab.model.geometry.tetrahedra.conforming import conforming_mesh
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh

wild = pytest.mark.skipif(importlib.util.find_spec("wildmeshing") is None, reason='needs pip install -e ".[tets]"')


def test_without_wildmeshing_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(BackendUnavailable, match=r"wildmeshing is not installed; pip install -e \"\.\[tets\]\""):
        conforming_mesh(*ball(), 0.2)


@wild
@pytest.mark.parametrize("shift", [0.0, 1000.0])
def test_a_bar_keeps_its_volume(shift):
    position, triangles = box((1, 0.2, 0.2), (shift, 0, 0))
    one, carried = conforming_mesh(position, triangles, 0.1)
    assert one.volumes.sum() == pytest.approx(0.04, rel=5e-3)
    assert np.abs(carried.points(one.position, one.tetrahedra) - position).max() < 1e-9
    assert carried.beyond(one.position, one.tetrahedra).max() < 2e-3 and set(one.face_counts) == {1, 2}


@wild
def test_open_and_crossing_surfaces_are_filled(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    body = cooked(without_some(ball(0.5, 2), 3, 4), edge=0.3, per_voxel="conforming", folder=tmp_path)
    assert (
        body.report.volume == pytest.approx(voxel_mesh(ball(0.5, 2)).hull.volume, rel=0.03) and body.report.voxels == 0
    )
    assert "its surface has no volume of its own: the mesh is not closed" in body.report.told[0]
    again = cooked(without_some(ball(0.5, 2), 3, 4), edge=0.3, per_voxel="conforming", folder=tmp_path)
    assert np.array_equal(again.mesh.position, body.mesh.position)
    one, other = ball(0.5, 1), ball(0.4, 1)
    crossing = conforming_mesh(*both(one, (other[0] + [0.5, 0.1, 0], other[1])), 0.3)[0]
    assert not list((tmp_path / "here").iterdir())  # where the library would leave a file
    assert crossing.pieces() == 1 and crossing.volumes.min() > 0


@wild
def test_what_is_refused():
    with pytest.raises(
        SceneError, match=r"edge = 1e-05: conforming tetrahedra of this mesh take 0\.0017\d* to 1\.7\d* m"
    ):
        conforming_mesh(*ball(), 1e-5)
    position, triangles = box()
    with pytest.raises(InputError, match="finds nothing to fill"):
        conforming_mesh(position * [1, 1, 0], triangles, 0.3)
