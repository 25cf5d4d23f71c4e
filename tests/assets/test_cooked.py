"""Cooked bodies: the same bits from the cache, from a file and anew; what is refused; and the command."""

import sys
from pathlib import Path

import numpy as np
import pytest
from closed_meshes import ball, without_some
from test_mesh import obj, write

from softlab import cli
from softlab.model.assets import cooked as room
from softlab.model.assets import tetrahedral_body
from softlab.model.assets.cooked import cooked, load, save
from softlab.model.assets.tetrahedral_body import CookedBody
from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.waiting import waiting_watched
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.tetrahedra.files import write_arrays
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh


def same(one: CookedBody, other: CookedBody) -> bool:
    a, b = room._packed(one), room._packed(other)
    return all(np.array_equal(a[name], b[name]) and a[name].dtype == b[name].dtype for name in a)


def carried(body):
    return body.embedding.points(body.mesh.position, body.mesh.tetrahedra)


SOURCES = {"name": "torus", "shape": Shape(name="box", sides=(1, 0.5, 0.25)), "arrays": ball()}


@pytest.mark.parametrize("source", SOURCES.values(), ids=SOURCES)
def test_a_body_is_made_once_and_loaded_with_the_same_bits(tmp_path, monkeypatch, source):
    told: list[str] = []
    with waiting_watched(lambda label, fraction: told.append(label) if fraction is None else None):
        body = cooked(source, voxels=6, folder=tmp_path)
    assert "cutting the body into voxels" in told and len(list(tmp_path.iterdir())) == 1
    monkeypatch.setattr(tetrahedral_body, "voxel_mesh", None)  # nothing is made again
    again = cooked(source, voxels=6, folder=tmp_path, density=7.0)
    assert same(body.with_density(7.0), again)
    assert again.report.mass == pytest.approx(7 * body.report.volume)
    assert np.abs(carried(body) - body.hull_position).max() < 1e-14
    save(tmp_path / "body.npz", body)
    assert same(load(tmp_path / "body.npz"), body)


def test_another_parameter_is_another_body(tmp_path):
    cooked("beam", folder=tmp_path)
    for more in ({"voxels": 4}, {"edge": 0.25}, {"per_voxel": 6}, {"scale": 2.0}):
        before = len(list(tmp_path.iterdir()))
        cooked("beam", folder=tmp_path, **more)
        assert len(list(tmp_path.iterdir())) == before + 1
    assert cooked("beam", folder=tmp_path, scale=2.0).report.hull_volume == pytest.approx(8 / 16)


def test_what_is_damaged_in_the_cache_is_made_again(tmp_path):
    body = cooked(ball(), voxels=4, folder=tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    arrays = dict(np.load(file))
    for name, value in (
        ("embedding_tetrahedron", arrays["embedding_tetrahedron"] + 10**6),
        ("tetrahedra", arrays["tetrahedra"][:, [1, 0, 2, 3]]),
        ("voxel", arrays["voxel"][1:]),
        ("starts", arrays["starts"][::-1]),
        ("report", np.array("{}")),
        ("version", np.array(0)),
        ("hull_triangles", arrays["hull_triangles"][:, 0]),
        ("key", np.array("another")),
    ):
        write_arrays(file, {**arrays, name: value})
        assert same(cooked(ball(), voxels=4, folder=tmp_path), body)
        assert file.read_bytes() == whole
    for data in (b"", whole[:1000], b"x" * 100):
        file.write_bytes(data)
        assert same(cooked(ball(), voxels=4, folder=tmp_path), body)


def test_a_file_of_triangles_and_one_of_tetrahedra(tmp_path):
    mesh = write(tmp_path, "ball.obj", obj(*ball()))
    body = cooked(mesh, voxels=4, scale=2.0, folder=tmp_path)
    assert same(body, cooked((ball()[0] * 2, ball()[1]), voxels=4, use_cache=False))
    write_arrays(tmp_path / "bare.npz", {"position": body.mesh.position, "tetrahedra": body.mesh.tetrahedra})
    bare = cooked(tmp_path / "bare.npz", folder=tmp_path)
    assert np.array_equal(bare.mesh.tetrahedra, body.mesh.tetrahedra) and bare.report.voxels == 0 == len(bare.voxel)
    assert bare.report.volume_ratio == pytest.approx(1, abs=1e-12)  # it carries its own surface
    assert np.array_equal(carried(bare), bare.hull_position) and len(bare.hull_triangles) == len(body.mesh.surface)
    save(tmp_path / "body.npz", body)
    assert same(cooked(tmp_path / "body.npz", folder=tmp_path), body)
    half = cooked(tmp_path / "body.npz", scale=0.5, use_cache=False)
    assert half.report.volume == pytest.approx(body.report.volume / 8) and half.report.edge == body.report.edge / 2
    assert np.abs(carried(half) - half.hull_position).max() < 1e-15
    with pytest.raises(SceneError, match="voxels = 3: a file of tetrahedra is used unchanged"):
        cooked(tmp_path / "body.npz", voxels=3)
    write_arrays(tmp_path / "body.npz", {**dict(np.load(tmp_path / "body.npz")), "voxel": np.zeros(3)})
    with pytest.raises(InputError, match=r"incomplete.*cook it again"):
        load(tmp_path / "body.npz")


def test_an_edge_may_be_inside_a_body_of_one_tetrahedron():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = TetrahedralMesh(corner, np.array([[0, 1, 2, 3]]))
    body = cooked((mesh.position, mesh.surface), voxels=1, use_cache=False)
    assert body.report.voxels == 1 and body.mesh.volumes.sum() == pytest.approx(1)


def test_what_is_refused(tmp_path):
    for source, words in (
        ("blobb", "blobb: no such shape; a body comes from .* star, torus"),
        ("", "a body comes from"),
        ("letters", "letters: no such shape"),
        ("x.png", "x.png: a body comes from"),
        ("none.obj", "none.obj: no such file"),
        (str(tmp_path) + "/.obj", "a body comes from|no such file"),
        (tmp_path, "a body comes from"),
        (without_some(ball(), 3), r"the mesh is not closed \(a hole, "),
    ):
        with pytest.raises(InputError, match=words):
            cooked(source, folder=tmp_path)
    for parameters, words in (
        ({"scale": 0.0}, "scale = 0.0"),
        ({"scale": float("inf")}, "scale = inf"),
        ({"density": 0.0}, r"density = 0.0: .*kg/m\^3"),
        ({"voxels": -1}, "voxels = -1"),
        ({"per_voxel": 7}, "5 or 6"),
    ):
        with pytest.raises(SceneError, match=words):
            cooked("blob", folder=tmp_path, **parameters)
    assert not list(tmp_path.iterdir())


@pytest.fixture
def command(capsys, monkeypatch, tmp_path):
    """command("cook ...") runs the command line in an empty folder: (status, out, err)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(room, "cache_folder", lambda name: tmp_path / "cache")

    def run(line):
        monkeypatch.setattr(sys, "argv", ["softlab", *line.split()])
        status = 0
        try:
            cli.main()
        except SystemExit as error:
            status = int(error.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_the_command_prints_its_report_and_writes_the_body(command):
    status, out, err = command("cook torus body.npz --voxels 12 --tetrahedra 6 --density 2000 --scale 0.5")
    assert status == 0 and err == ""
    body = load("body.npz")
    assert out.splitlines() == [*body.with_density(2000.0).report.lines(), "wrote body.npz"]
    assert same(body, cooked("torus", voxels=12, per_voxel=6, scale=0.5, density=2000.0, use_cache=False))
    assert command("cook body.npz again.npz")[0] == 0 and same(load("again.npz"), body.with_density(1000.0))
    assert "softlab cook blob" in command("cook --help")[1]


def test_the_command_refuses_in_a_line_and_writes_nothing(command, tmp_path):
    write(tmp_path, "open.obj", obj(*without_some(ball(), 3)))
    (tmp_path / "text.msh").write_text("hello")
    files = {path.name for path in tmp_path.iterdir()}
    for line, words in (
        ("cook blob body.obj", "must end in .npz"),
        ("cook blob none/body.npz", "does not exist"),
        ("cook open.obj body.npz", "open.obj: the mesh is not closed (a hole, "),
        ("cook text.msh body.npz", "text.msh: it has no $MeshFormat"),
        ("cook missing.obj body.npz", "missing.obj: no such file"),
        ("cook blob body.npz --tetrahedra 4", "--tetrahedra = '4': must be 5 or 6"),
        ("cook blob body.npz --edge nan", "edge = nan: must be"),
        ("cook blob body.npz --edge 0.1 --voxels 3", "give voxels or edge"),
        ("cook blob body.npz --voxels 900000", "of memory"),
        ("cook blob body.npz --density -3", "density = -3.0"),
        ("cook blob body.npz --scale x", "must be a number"),
        ("cook blob", "missing argument: 'BODY.npz'"),
    ):
        status, out, err = command(line)
        assert status == 2 and out == "" and words in err and len(err.splitlines()) == 1, (line, err)
    assert {path.name for path in tmp_path.iterdir()} - {"cache"} == files
    assert not list(Path("cache").glob("*.npz"))
