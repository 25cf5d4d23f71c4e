"""`softlab run --export`: skins, particles, cloths, grids and colliders in files that trimesh reads back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from bodies_scenes import PLANE, beams_and_torus
from fake_cloth import FakeCloth
from test_cli import command, refused  # noqa: F401  # a fixture

from softlab.app.command.scene_file import scene_toml
from softlab.app.output.export import Exporter, check_export, linear, write_pieces
from softlab.app.output.pieces import collider_pieces, pieces_of, skinned
from softlab.app.render import colours
from softlab.app.render.bodies.skinning import ClusterFrames
from softlab.model.base.errors import InputError
from softlab.model.core.build import rest_positions
from softlab.model.scene.scene import Scene

BALL = {"kind": "sphere", "center": [0.0, 0.2, 0.0], "radius": 0.2, "velocity": [0.5, 0.0, 0.0]}
SCENE = beams_and_torus(**PLANE, ball=BALL)
BODY_SET = SCENE.body_set
BENT = BODY_SET.position + 0.05 * np.sin(3 * BODY_SET.position[:, ::-1])  # m: no copy is rigid any more
MATRICES = ClusterFrames(SCENE).of_state(BENT)
PIECES = pieces_of(SCENE, BENT, MATRICES)
CLOTH = Scene({"cloth": {"rows": 5, "columns": 4}, "structural": {}, "ball": BALL, "method": {"dt": 0.001}}, "cloth")
GRID = Scene({"grid": {"rows": 3, "columns": 4}, "springs": {}}, "grid")
ROUNDING = 1e-6  # m: files hold float32, of a few metres


def read(path: Path) -> Any:
    return trimesh.load(path, process=False)


# ---------------------------------------------------------------------- what is shown


def test_skins_are_those_of_the_model_and_named_by_copy() -> None:
    assert [piece.name for piece in PIECES] == ["beam-1", "beam-2", "torus"]
    centre, turned = BODY_SET.clusters.centres(BENT), BODY_SET.clusters.rotations(BENT)
    for piece, copy in zip(PIECES, BODY_SET.copies, strict=True):
        own = slice(copy.first_cluster, copy.first_cluster + copy.baked.clusters.count)
        position, normal = copy.baked.skin.skinned(centre[own], turned[own] @ SCENE.bodies[copy.name].turn())
        np.testing.assert_allclose(piece.vertices, position, atol=2e-6)  # the matrices are float32
        np.testing.assert_allclose(piece.normals, normal, atol=1e-5)  # cancelled parts of means are longer than they
        assert piece.triangles is copy.baked.skin.triangles and piece.colour == colours.BODIES[copy.number]


def test_normals_that_cancel_are_zero() -> None:
    """Of two clusters that turn a normal to opposite sides, in float64 for that reason exactly."""
    turn = np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])])
    matrices = np.concatenate([turn, np.zeros((2, 3, 1))], axis=2)
    found = skinned(np.ones((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([[0, 1]]), np.full((1, 2), 0.5), matrices)
    np.testing.assert_array_equal(found, [[[1, 0, 0]], [[0, 0, 0]]])


def test_a_body_without_a_skin_is_its_particles(tmp_path: Path) -> None:
    body_set = BODY_SET
    bare = replace(
        body_set.copies[0].baked, skin=replace(body_set.copies[0].baked.skin, triangles=np.zeros((0, 3), np.int32))
    )
    copies = (*(replace(copy, baked=bare) if copy.name == "beam" else copy for copy in body_set.copies),)
    scene = beams_and_torus()
    scene.__dict__["body_set"] = replace(body_set, copies=copies)
    pieces = pieces_of(scene, BENT, MATRICES)
    for number in (0, 1):
        assert pieces[number].triangles is None
        np.testing.assert_array_equal(pieces[number].vertices, BENT[body_set.body == number])
    loose = read(write_pieces(tmp_path / "mixed.ply", pieces))
    assert len(loose.vertices) == sum(len(piece.vertices) for piece in pieces)
    assert len(loose.faces) == len(pieces[2].triangles) and loose.faces.min() == 2 * len(bare.position)
    found = read(write_pieces(tmp_path / "mixed.glb", pieces)).geometry
    np.testing.assert_allclose(found["beam-2"].vertices, BENT[body_set.body == 1], atol=ROUNDING)
    assert isinstance(found["beam-1"], trimesh.PointCloud) and isinstance(found["torus"], trimesh.Trimesh)


def test_colliders_are_where_they_are_then_and_planes_under_everything() -> None:
    found = {piece.name: piece for piece in collider_pieces(SCENE, BENT, 2.0)}
    assert set(found) == {"ball", "plane"}
    away = found["ball"].vertices - [1.0, 0.2, 0.0]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.2, rtol=1e-6)
    plane = found["plane"]
    np.testing.assert_allclose(plane.vertices[:, 1], 0, atol=1e-12)
    low, high = plane.vertices.min(axis=0), plane.vertices.max(axis=0)
    assert (low[[0, 2]] < BENT.min(axis=0)[[0, 2]]).all() and (high[[0, 2]] > BENT.max(axis=0)[[0, 2]]).all()
    a, b, c = plane.vertices[plane.triangles[0]]
    assert np.cross(b - a, c - a) @ plane.normals[0] > 0


def test_a_mesh_that_turns_is_exported_turned() -> None:
    """Half a turn about the vertical through its origin, which has moved a metre by then."""
    mesh = {"kind": "mesh_collider", "shape": {"name": "beam", "resolution": 4}, "origin": [2.0, 0.0, 0.0]}
    scene = beams_and_torus(wheel=mesh | {"velocity": [0.5, 0.0, 0.0], "spin": [0.0, np.pi / 2, 0.0]})
    (start,), (turned,) = (list(collider_pieces(scene, BENT, time)) for time in (0.0, 2.0))
    assert start.name == "wheel" and start.normals is not None
    expected = (start.vertices - [2.0, 0.0, 0.0]) * [-1, 1, -1] + [3.0, 0.0, 0.0]
    np.testing.assert_allclose(turned.vertices, expected, atol=ROUNDING)
    np.testing.assert_allclose(turned.normals, start.normals * [-1, 1, -1], atol=ROUNDING)


# ---------------------------------------------------------------------- files


def test_a_ply_is_one_mesh_with_normals_and_colours(tmp_path: Path) -> None:
    path = write_pieces(tmp_path / "all.ply", PIECES)
    mesh, first = read(path), 0
    for piece in PIECES:
        own = slice(first, first + len(piece.vertices))
        np.testing.assert_allclose(mesh.vertices[own], piece.vertices, atol=ROUNDING)
        np.testing.assert_allclose(mesh.vertex_normals[own], piece.normals, atol=ROUNDING)
        expected = np.round(255 * np.array(piece.colour))
        assert (mesh.visual.vertex_colors[own, :3] == expected).all()
        first += len(piece.vertices)
    assert first == len(mesh.vertices)
    counts = np.cumsum([0, *(len(piece.vertices) for piece in PIECES)])
    np.testing.assert_array_equal(
        mesh.faces, np.concatenate([piece.triangles + start for piece, start in zip(PIECES, counts, strict=False)])
    )
    assert [file.name for file in tmp_path.iterdir()] == ["all.ply"]  # no half-written one


def test_a_glb_has_everything_by_name_in_linear_colours(tmp_path: Path) -> None:
    pieces = [*PIECES, *collider_pieces(SCENE, BENT, 0.0)]
    found = read(write_pieces(tmp_path / "all.glb", pieces))
    assert set(found.geometry) == {"beam-1", "beam-2", "torus", "ball", "plane"}
    for piece in pieces:
        geometry = found.geometry[piece.name]
        np.testing.assert_allclose(geometry.vertices, piece.vertices, atol=2e-6)
        np.testing.assert_allclose(geometry.vertex_normals, piece.normals, atol=ROUNDING)
        np.testing.assert_array_equal(geometry.faces, piece.triangles)
        material = geometry.visual.material
        assert material.baseColorFactor[:3].tolist() == [round(255 * linear(part)) for part in piece.colour]
        assert material.doubleSided and material.metallicFactor == 0
    assert linear(0.0) == 0 and linear(1.0) == 1 and linear(0.5) == pytest.approx(0.2140, abs=1e-4)


def test_a_cloth_is_its_triangles(tmp_path: Path) -> None:
    position = rest_positions(CLOTH.grid) + np.random.default_rng(1).normal(0, 0.05, (20, 3))
    mesh = read(write_pieces(tmp_path / "cloth.ply", pieces_of(CLOTH, position)))
    assert len(mesh.faces) == 2 * 4 * 3
    np.testing.assert_allclose(mesh.vertices, position, atol=ROUNDING)
    np.testing.assert_allclose(mesh.vertex_normals, CLOTH.grid.normals(position), atol=ROUNDING)


def test_a_grid_is_lines_in_a_glb_and_points_in_a_ply(tmp_path: Path) -> None:
    position = rest_positions(GRID.grid)
    pieces = pieces_of(GRID, position)
    flat = np.pad(position, ((0, 0), (0, 1)))
    np.testing.assert_allclose(read(write_pieces(tmp_path / "grid.ply", pieces)).vertices, flat, atol=ROUNDING)
    data = (tmp_path / "grid.glb", write_pieces(tmp_path / "grid.glb", pieces))[0].read_bytes()
    length = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + length])
    (primitive,) = tree["meshes"][0]["primitives"]
    assert primitive["mode"] == 1  # GL_LINES
    assert tree["accessors"][primitive["attributes"]["POSITION"]]["count"] == 2 * GRID.grid.spring_count
    masses = pieces_of(Scene({"grid": {"rows": 3, "columns": 4}}), position)
    assert not masses[0].lines and len(masses[0].vertices) == 12


# ---------------------------------------------------------------------- frames and the command line


def test_a_pattern_writes_a_file_a_frame_at_its_time(tmp_path: Path) -> None:
    with FakeCloth(SCENE) as simulation:
        notes: list[str] = []
        target = check_export(str(tmp_path / "f-{frame:03d}.ply"), None, SCENE.method.dt, notes)
        assert target.every == 3  # of 0.005 s, nearest to 1/60 s
        exporter, heights = Exporter(simulation, target), []
        for _ in range(2):
            simulation.advance(exporter.every)
            exporter.observe(simulation)
            heights.append(simulation.read("position")[:, 1].mean())
        files = f"{tmp_path / 'f-000.ply'} to {tmp_path / 'f-002.ply'}"
        assert exporter.stopped == f"stopped; 3 whole files were written, {files}"
        assert exporter.finish(simulation, notes) == [] and "3 frames" in notes[0] and "0.015 s" in notes[0]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["f-000.ply", "f-001.ply", "f-002.ply"]
    lowest = [read(tmp_path / f"f-00{frame}.ply").vertices[:, 1].mean() for frame in range(3)]
    fallen = np.diff([BODY_SET.position[:, 1].mean(), *heights])  # all particles fall alike, and the skins with them
    np.testing.assert_allclose(np.diff(lowest), fallen, atol=2e-6)


@pytest.mark.parametrize(("name", "seconds", "every"), [("a{frame}.glb", 0.02, 4), ("{frame:02d}b.ply", 0.001, 1)])
def test_times_are_rounded_aloud(tmp_path: Path, name: str, seconds: float, every: int) -> None:
    notes: list[str] = []
    assert check_export(str(tmp_path / name), seconds, 0.005, notes).every == every
    assert bool(notes) == (every * 0.005 != seconds)


@pytest.mark.parametrize(
    "name", ["a{n}.ply", "a{frame", "{frame}{frame}.ply", "a{frame:x}.ply", "{frame}/a.ply", "a{frame:c}.glb", "{}.ply"]
)
def test_patterns_that_name_no_frame_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"body-\{frame:04d\}\.ply"):
        check_export(str(tmp_path / name), None, 0.01, [])


@pytest.fixture
def bodies_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("softlab.app.command.run.open_simulation", lambda scene, backend, **options: FakeCloth(scene))
    path = tmp_path / "bodies.toml"
    path.write_text(scene_toml(SCENE), encoding="utf-8")
    return str(path)


def test_the_command_line_writes_the_end_and_replaces_what_was_there(
    command: Any,  # noqa: F811
    bodies_file: str,
    tmp_path: Path,
) -> None:
    (tmp_path / "end.glb").write_text("old")
    done = command(f"run {bodies_file} --steps 4 --export end.glb")
    assert done.status == 0 and "wrote end.glb" in done.out, done.err
    assert "torus" in read(tmp_path / "end.glb").geometry
    done = command(f"run {bodies_file} --steps 4 --export body-{{frame:04d}}.ply --export-every 0.01")
    assert done.status == 0 and "3 frames, body-0000.ply to body-0002.ply, 2 steps" in done.err
    assert sorted(file.name for file in tmp_path.glob("body*")) == [f"body-000{frame}.ply" for frame in range(3)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--export end.obj", [".ply", ".glb"]),
        ("--export nowhere/end.ply", ["does not exist", "make it first"]),
        ("--export end.ply --export-every 0.1", ["--export-every", "{frame:04d}"]),
        ("--export f{frame}.ply --export-every -1", ["--export-every", "greater than 0"]),
        ("--export f{frame}.ply --export-every nan", ["--export-every", "finite"]),
        ("--export f{number}.ply", ["{frame}"]),
        ("--export-every 0.1", ["--export body-{frame:04d}.ply"]),
    ],
)
def test_mistakes_are_told_before_the_run(command: Any, options: str, words: list[str], tmp_path: Path) -> None:  # noqa: F811
    refused(command(f"run lab-grid {options}"), 2, *words)
    assert not list(tmp_path.iterdir())


def test_a_look_is_of_a_picture(command: Any) -> None:  # noqa: F811
    refused(command("run dam-break --steps 1 --look foam"), 2, "--look foam", "--render")
