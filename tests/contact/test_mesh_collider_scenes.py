"""Colliders that are meshes in scenes: files, what cannot be one, what is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cloth_solve import cloth
from test_mesh_collider import FLOOR, TERRAIN, written

from softlab.bench.reference.contact.mesh_collider import nearest_point
from softlab.model.base.errors import InputError, SceneError
from softlab.model.contact.cloth_parameters import B_TREE, COLLIDER_FIELDS, collider_numbers, collider_rows
from softlab.model.formulas.triangle_tree import SETTLED
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.colliders.mesh_collider import MeshCollider

# ---------------------------------------------------------------------- scenes


def test_a_scene_of_it_is_written_and_read() -> None:
    scene = load_scene("soft-on-mesh")
    assert Scene(scene.as_dict(), "soft-on-mesh").canonical() == scene.canonical()
    numbers = collider_numbers(scene, np.float32)
    assert np.array_equal(numbers[COLLIDER_FIELDS:], scene.parts["hills"].numbers(np.float32))  # type: ignore[attr-defined]
    assert collider_rows(scene, np.float32)[0, B_TREE] == 0 and numbers[B_TREE] == COLLIDER_FIELDS


def test_jelly_stays_above_the_mesh() -> None:
    """All particles of soft-on-mesh at the thickness or farther after a second, within four roundings of 4 m."""
    from softlab.app.driver import open_simulation

    scene = load_scene("soft-on-mesh").replace({f"{name}.copies": [1, 1, 1] for name in ("star", "torus", "blob")})
    hills: Any = scene.parts["hills"]
    with open_simulation(scene, "cpu", threads=1) as simulation:
        simulation.advance(100)
        position = simulation.read("position").astype(float)
    ways = np.array([place - nearest_point(hills.corners, place) for place in position[::3]])
    away = np.linalg.norm(ways, axis=1)
    assert away.min() > hills.thickness * SETTLED - 16 * np.finfo(np.float32).eps
    assert (away < hills.thickness * 1.01).any()
    assert ways[:, 1].min() > 0


def test_what_cannot_be_a_collider_is_told_apart(tmp_path: Path) -> None:
    points, faces = FLOOR
    bad = {
        "empty": written(tmp_path / "empty.obj", points, []),
        "lines": written(tmp_path / "lines.obj", [[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]]),
        "nan": written(tmp_path / "nan.obj", [*points, [np.nan, 0, 0]], faces),
        "small": written(tmp_path / "small.obj", 1e-10 * np.array(points), faces),
    }
    (tmp_path / "cut.stl").write_bytes(bytes(80) + (5).to_bytes(4, "little") + bytes(60))
    bad["cut"] = str(tmp_path / "cut.stl")
    words = {"empty": "no triangle", "lines": "area", "nan": "finite", "small": "too small", "cut": "cut short"}
    for name, file in bad.items():
        scene = cloth(2, 2, mesh_collider={"file": file})
        with pytest.raises(InputError, match=words[name]):
            collider_numbers(scene, np.float32)
    for fields, field in [
        ({}, "mesh_collider.file"),
        ({"shape": TERRAIN, "file": "tunic.obj"}, "mesh_collider.file"),
        ({"shape": TERRAIN, "scale": 2.0}, "mesh_collider.scale"),
        ({"shape": TERRAIN, "thickness": 0.0}, "mesh_collider.thickness"),
        ({"shape": TERRAIN, "angle": 5.0, "axis": (0.0, 0.0, 0.0)}, "mesh_collider.axis"),
        ({"file": bad["lines"], "digest": "0" * 16}, "mesh_collider.digest"),
        ({"shape": {"name": "terrain", "resolution": 41}}, "mesh_collider"),
    ]:
        with pytest.raises(SceneError) as caught:
            cloth(2, 2, mesh_collider=fields)
        assert caught.value.field.startswith(field)
    with pytest.raises(SceneError, match="belongs to a mesh_collider"):
        Scene({"hill": {"kind": "soft_body", "shape": TERRAIN, "particle_spacing": 0.1}})
    with pytest.raises(SceneError, match="belongs to a cloth"):
        Scene({"grid": {"rows": 2, "columns": 2}, "mesh_collider": {"shape": TERRAIN}})


def test_triangles_without_an_area_are_left_out_and_told(tmp_path: Path) -> None:
    points, faces = FLOOR
    mesh = MeshCollider(file=written(tmp_path / "f.obj", [*points, [2, 0, 2]], [*faces, [0, 2, 4], [1, 1, 2]]))
    assert len(mesh.triangles) == 2 and mesh.number_count == mesh.numbers(np.float32).size
    assert mesh.lines() == ["2 triangles, 4 x 0 x 4 m", "2 triangles without area were left out"]


def test_more_triangles_than_float32_can_number() -> None:
    """204 800 triangles take 5.1 million numbers, and float32 counts to 2^24: three of them fit and four do not."""
    many = {f"hill{k}": {"kind": "mesh_collider", "shape": {"name": "terrain", "resolution": 40}} for k in range(4)}
    with pytest.raises(SceneError, match="float32 counts to 16777216") as caught:
        collider_numbers(cloth(2, 2, **many), np.float32)
    assert caught.value.field == "hill3.shape"


def test_pinned_masses_in_it_are_told() -> None:
    from softlab.model.contact.overlaps import overlap_lines

    sheet = {"pinned": "top-corners", "origin": (0.0, 0.0, 0.0)}
    near = cloth(2, 2, sheet=sheet, mesh_collider={"shape": TERRAIN, "thickness": 1.0})
    assert "begin inside a mesh_collider or nearer" in overlap_lines(near)[0]
    assert not overlap_lines(cloth(2, 2, sheet=sheet, mesh_collider={"shape": TERRAIN, "origin": (0.0, -9.0, 0.0)}))


# ---------------------------------------------------------------------- pictures


def test_what_is_drawn_is_the_mesh_smooth_but_for_its_edges(tmp_path: Path) -> None:
    from softlab.app.render.collider_shapes import collider_mesh, with_colliders

    hills = MeshCollider(shape=TERRAIN, origin=(1.0, 2.0, 3.0), spin=(0.0, 0.5, 0.0))
    drawn = collider_mesh(hills)
    assert drawn is not None and drawn.turns
    assert np.allclose(drawn.vertices[drawn.triangles], hills.position[hills.triangles] + [1, 2, 3], atol=1e-6)
    assert np.allclose(np.linalg.norm(drawn.normals, axis=1), 1, atol=1e-6) and (drawn.normals[:, 1] > 0.5).all()
    _, place = np.unique(drawn.vertices, axis=0, return_inverse=True)
    place = place.reshape(-1)
    first = drawn.normals[np.unique(place, return_index=True)[1]]
    smooth = np.abs(drawn.normals - first[place]).max(axis=1) < 1e-6  # one normal a vertex
    assert smooth.mean() > 0.9
    vertices, normals = drawn.rotated(1.0)
    turn = hills.turn_at(1.0)
    assert np.allclose(vertices, (drawn.vertices - [1, 2, 3]) @ turn.T + [1, 2, 3], atol=1e-5)
    assert np.allclose(normals, drawn.normals @ turn.T, atol=1e-6)
    box = collider_mesh(MeshCollider(shape={"name": "beam", "resolution": 8}))
    assert box is not None and not box.turns
    assert (np.abs(box.normals).max(axis=1) > 0.999).all()  # its edges are sharp: every normal is a side's
    cup = MeshCollider(shape={"name": "cup", "resolution": 8}, spin=(np.pi / 2, 0.0, 0.0))
    rounded = collider_mesh(cup)
    assert rounded is not None
    level, far = np.abs(rounded.normals[:, 1]), np.hypot(*rounded.vertices[:, ::2].T)
    side = level < 1e-6  # its sides are round up to their very edges, and its foot and rim are level
    assert (side | (level > 1 - 1e-6)).all() and side.any() and not side.all()
    outward = np.abs((rounded.normals * rounded.vertices)[:, ::2].sum(axis=1))[side] / far[side]
    assert (outward > np.cos(np.pi / 20)).all()  # half of what two of its 20 sides turn
    scene = cloth(
        3, 3, sheet={"spacing": 1.0}, cup={"kind": "mesh_collider", "shape": {"name": "cup"}, "spin": cup.spin}
    )
    lying = with_colliders(scene, (0, -2, 0, 2, 0, 0), 1.0)
    assert (lying[2], lying[5]) == pytest.approx((-0.5, 0.5))  # as long as it is high, once turned by a quarter
    scene = cloth(3, 3, sheet={"spacing": 4.0}, mesh_collider={"shape": TERRAIN, "origin": (4.0, -4.0, 0.0)})
    assert with_colliders(scene, (0, -8, 0, 8, 0, 0), 0.0)[2] == pytest.approx(-4.0)
