"""Meshes as parts of a scene: what they may be, what follows, what is refused and in which words, topology, energies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_scenes import PARTS, SHEET, mesh_scene

from softlab.app.render.drawn_springs import drawn_lines
from softlab.bench.reference import xpbd as sheets
from softlab.bench.reference import xpbd_mesh as reference
from softlab.model.base.errors import InputError, SceneError
from softlab.model.core.build import build, masses, pinned_indices, rest_positions
from softlab.model.core.energy import energies, spring_strain
from softlab.model.core.families import scene_plan
from softlab.model.geometry.normals import vertex_normals
from softlab.model.geometry.topology import mesh_of
from softlab.model.position_based.mesh_constraints import constraint_sets
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.scene.sheets import mesh_lines

GARMENT = {"mesh": {"file": "garment.obj", "pinned": "top"}, "structural": {}, "method": {"solver": "xpbd"}}


def obj(folder: Path, text: str) -> dict[str, Any]:
    file = folder / "some.obj"
    file.write_text(text)
    return {"mesh": {"file": str(file)}, "structural": {}, "gravity": {}, "method": {"solver": "xpbd"}}


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_a_scene_that_is_written_can_be_read() -> None:
    for tables in (GARMENT, *PARTS.values()):
        scene = Scene(tables)
        again = Scene(scene.as_dict())
        assert again.canonical() == scene.canonical()
        assert np.array_equal(build(again).position, build(scene).position)
    assert "model" not in load_scene("cloth-hanging").as_dict().get("bending", {})  # old scenes keep their text
    assert set(Scene(GARMENT).as_dict()["mesh"]) == {"mass", "pinned", "origin", "file", "digest", "scale"}


def test_a_file_by_its_name_or_path_and_what_follows_of_it(tmp_path: Path) -> None:
    scene = Scene(obj(tmp_path, TETRAHEDRON)).replace(
        {"mesh.scale": 0.5, "mesh.density": 3.0, "mesh.origin": [1.0, 2.0, 3.0]}
    )
    assert scene.mesh is not None
    assert (scene.grid.rows, scene.grid.columns, scene.dimensions) == (1, 4, 3)
    np.testing.assert_allclose(scene.grid.spacing, 0.5 * (3 + 3 * np.sqrt(2)) / 6)
    np.testing.assert_allclose(build(scene).position[1], [1.5, 2.0, 3.0])
    area = 0.25 * (3 / 2 + np.sqrt(3) / 2)
    np.testing.assert_allclose(np.sum(masses(scene)), 3.0 * area)
    np.testing.assert_allclose(scene.grid.mass, 3.0 * area / 4)
    np.testing.assert_allclose(build(scene).inverse_mass, 1 / masses(scene)[:, 0])


def test_a_file_that_changed_is_told(tmp_path: Path) -> None:
    scene = Scene(obj(tmp_path, TETRAHEDRON))
    (tmp_path / "some.obj").write_text(TETRAHEDRON.replace("v 1 0 0", "v 2 0 0"))
    with pytest.raises(SceneError, match="another file by now"):
        Scene(scene.as_dict())


def test_repairs_are_told_in_a_line_each(tmp_path: Path) -> None:
    text = TETRAHEDRON + "v 5 5 5\nv 0 0 0\nf 1 3 2\nf 6 2 4\nf 1 1 2\n"
    lines = mesh_lines(Scene(obj(tmp_path, text)))
    assert any("merged" in line for line in lines) and any("duplicate" in line for line in lines)
    assert any("no triangle uses" in line for line in lines) and all("\n" not in line for line in lines)
    assert mesh_lines(Scene(SHEET)) == []


@pytest.mark.parametrize(
    "mesh,words",
    [
        ({}, "either a file or shape"),
        ({"file": "garment.obj", "shape": "sheet"}, "either a file or shape"),
        ({"file": "garment.obj", "rows": 3}, "belongs to a sheet"),
        ({"shape": "sheet", "rows": 3, "columns": 3, "scale": 2.0}, "belongs to a file"),
        ({"shape": "sheet", "rows": 1, "columns": 3}, "at least 2 x 2"),
        ({"shape": "sheet", "rows": 3, "columns": 3, "pinned": [4]}, r"\[\[row, column\]"),
        ({"shape": "sheet", "rows": 3, "columns": 3, "pinned": [[3, 0]]}, "outside"),
        ({"shape": "sheet", "rows": 3, "columns": 3, "diagonals": "none"}, "one or alternating"),
        ({"file": "garment.obj", "mass": 0.1, "density": 0.1}, "density or mass"),
        ({"file": "garment.obj", "density": -0.1}, "greater than 0"),
        ({"file": "garment.obj", "scale": 0.0}, "greater than 0"),
        ({"file": "garment.obj", "pinned": [99999]}, "vertices 0 to 2821"),
        ({"file": "garment.obj", "pinned": "left"}, "highest vertices"),
        ({"file": "garment.obj", "pinned": [[0, 1]]}, "list of vertices"),
    ],
)
def test_what_a_mesh_cannot_be(mesh: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words) as found:
        Scene({"mesh": mesh, "structural": {}, "method": {"solver": "xpbd"}})
    assert found.value.field.startswith("mesh.")


@pytest.mark.parametrize(
    "text,words",
    [
        (None, "no such file"),
        ("", "no vertices|no triangle|faces"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "has an area"),
        ("v 0 0 0\nv 1 0 0\nv nan 0 0\nf 1 2 3\n", "finite"),
        (TETRAHEDRON + "v 1 1 1\nf 1 2 5\n", "more than two triangles"),
    ],
)
def test_files_that_are_no_mesh(tmp_path: Path, text: str | None, words: str) -> None:
    tables = obj(tmp_path, text or "")
    if text is None:
        tables["mesh"]["file"] = "nowhere.obj"
    with pytest.raises(InputError, match=words):
        Scene(tables)


def test_top_is_the_highest_vertices() -> None:
    scene = Scene(GARMENT)
    pinned = pinned_indices(scene.grid)
    height = rest_positions(scene.grid)[:, 1]
    assert 0 < len(pinned) < 30 and height[pinned].min() > np.delete(height, pinned).max()


def test_one_diagonal_is_the_clothes_surface() -> None:
    """Triangles, edges, lengths and normals of a sheet with one diagonal are those that a cloth has in closed form."""
    mesh = mesh_scene("isometric")
    shape = {"rows": 5, "columns": 4, "spacing": 0.1}
    cloth = Scene({"cloth": shape, "structural": {"stiffness": 100.0}, "shear": {"stiffness": 100.0}})
    assert np.array_equal(rest_positions(mesh.grid), rest_positions(cloth.grid))
    assert {tuple(t) for t in np.sort(mesh.grid.triangles())} == {tuple(t) for t in np.sort(cloth.grid.triangles())}
    position = build(mesh).position
    np.testing.assert_allclose(mesh.grid.normals(position), vertex_normals(position, 5, 4), atol=1e-14)
    way = sheets.Direction
    closed = sheets.sheet(5, 4, {(1, 0): way(0.1, 0.01), (0, 1): way(0.1, 0.01), (1, 1): way(0.1 * np.sqrt(2), 0.01)})
    wanted = {(int(a), int(b)): r for a, b, r in zip(closed.first, closed.second, closed.rest_length, strict=True)}
    (edges,) = (one for one in constraint_sets(mesh) if one.kind == "structural")
    found = {(int(a), int(b)): r for (a, b), r in zip(edges.corners, edges.values[:, 0], strict=True)}
    assert found.keys() == wanted.keys()
    np.testing.assert_allclose([found[key] for key in wanted], list(wanted.values()), rtol=1e-12)
    items = [item for item in reference.items_of(mesh) if len(item.corners) == 2]
    assert all(item.compliance == 0.01 for item in items) and len(items) == len(wanted)


@pytest.mark.parametrize("name", PARTS)
def test_no_two_constraints_of_a_colour_share_a_vertex(name: str) -> None:
    for family in constraint_sets(mesh_scene(name)):
        for colour in range(family.colours):
            corners = family.corners[family.starts[colour] : family.starts[colour + 1]]
            assert len(np.unique(corners)) == corners.size > 0
        assert family.starts[-1] == len(family.corners) == len(family.values)


def test_alternating_diagonals_alternate() -> None:
    scene = mesh_scene("dihedral")
    assert scene.mesh is not None
    edges = {tuple(edge) for edge in mesh_of(scene.mesh).edges.edges.tolist()}
    for i in range(4):
        for j in range(3):
            k = 4 * i + j
            falling, rising = (k, k + 5) in edges, (k + 1, k + 4) in edges
            assert (falling, rising) == ((i + j) % 2 == 0, (i + j) % 2 == 1)


def test_energies_are_those_of_the_constraints() -> None:
    """k/2 times the square of the reference's constraints, kind by kind; gravity with every vertex's own mass."""
    for name in ("isometric", "dihedral", "distances"):
        scene = mesh_scene(name)
        position = build(scene).position
        found, wanted = energies(scene, position, np.zeros_like(position)), {"structural": 0.0, "bending": 0.0}
        edges = len(constraint_sets(scene)[0].corners)
        for number, item in enumerate(reference.items_of(scene)):
            values, _ = item.of(position[item.corners])
            wanted["structural" if number < edges else "bending"] += float(values @ values) / 2 / item.compliance
        for kind, energy in wanted.items():
            np.testing.assert_allclose(found[kind], energy, rtol=1e-9)
        assert found["spring"] == found["structural"] + found["bending"] > 0
        np.testing.assert_allclose(found["gravity"], 9.81 * float((masses(scene)[:, 0] * position[:, 1]).sum()))


def test_what_is_drawn_and_the_plan() -> None:
    scene = Scene(GARMENT)
    assert scene.mesh is not None
    lines = drawn_lines(scene)
    mesh = mesh_of(scene.mesh)
    assert sum(len(ends) for ends, _ in lines) == len(mesh.edges.edges)
    for ends, rest in lines:
        lengths = np.linalg.norm(mesh.position[ends[:, 1]] - mesh.position[ends[:, 0]], axis=1)
        assert np.abs(lengths / rest - 1).max() < 0.01
    assert np.abs(spring_strain(scene, build(scene).position)).max() == 0
    names = [stage.name for stage in scene_plan(scene).root.stages()]
    assert names[0] == "predict" and names[-1] == "update velocity" and names[1] == "project edges 0"
    assert scene.grid.extent == pytest.approx(1.0)
