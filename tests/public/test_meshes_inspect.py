"""softlab inspect: what a file holds, what it can be used as, and why not; progress of work on meshes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from closed_meshes import ball, blocks, both, box, volume_of, without_some
from meshes import sheet
from test_cli import command, refused  # noqa: F401
from test_mesh import binary_stl, obj, write

from softlab.app.command.waiting import waiting_shown
from softlab.model.assets.inspection import BODIES, SURFACE_ROLES, guessed_unit, inspected
from softlab.model.assets.soft_body import RigidBody
from softlab.model.base.errors import InputError
from softlab.model.base.waiting import steps, waiting_watched
from softlab.model.geometry.mesh import read_mesh
from softlab.model.geometry.signed_distance import squared_distances
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh


def test_a_closed_mesh_fits_everything(tmp_path: Path) -> None:
    found = inspected(write(tmp_path, "box.obj", obj(*box((1.0, 2.0, 3.0)))))
    assert (found.vertices, found.triangles, found.pieces, found.rims, found.non_manifold_edges) == (8, 12, 1, 0, 0)
    assert found.size == (1.0, 2.0, 3.0) and found.low == (-0.5, -1.0, -1.5)
    assert (found.area, found.volume) == (pytest.approx(22.0), pytest.approx(6.0))
    fits = {name for name, reason in found.roles.items() if not reason}
    assert fits | {"tetrahedral_body_conforming"} == set(SURFACE_ROLES)


def test_an_open_sheet_fits_cloth_and_colliders(tmp_path: Path) -> None:
    found = inspected(write(tmp_path, "sheet.obj", obj(*sheet(3, 5, 0.5))), scale=2.0)
    assert found.volume is None and found.rims == 1 and found.area == pytest.approx(8.0)
    assert found.widest_rim == pytest.approx(np.hypot(2.0, 4.0))
    assert not found.roles["cloth"] and not found.roles["mesh_collider"]
    assert all("holds no volume" in found.roles[role] for role in BODIES)
    assert found.unit == "given by the scale: 2 m"


def test_a_soup_fits_bodies_but_no_cloth(tmp_path: Path) -> None:
    """Cubes that touch along edges."""
    found = inspected(write(tmp_path, "a.obj", obj(*blocks([(0, 0, 0), (1, 1, 0)]))))
    assert found.non_manifold_edges == 1 and found.volume == pytest.approx(2.0) and found.pieces == 2
    assert "1 edge has more than two triangles" in found.roles["cloth"]
    assert not found.roles["soft_body"] and not found.roles["tetrahedral_body"] and not found.roles["distance_field"]
    assert any("winding numbers" in repair for repair in found.repairs)


def test_a_scan_with_a_hole_fits_bodies_with_fill_holes(tmp_path: Path) -> None:
    file = write(tmp_path, "scan.obj", obj(*without_some(ball(), 3)))
    found = inspected(file)
    assert found.volume is None and found.filled_volume == pytest.approx(volume_of(ball()), rel=0.02)
    assert found.as_dict()["fits_with_fill_holes"] == BODIES
    assert all("fill_holes = true" in found.roles[name] for name in BODIES)
    lines = "\n".join(found.lines())
    assert (
        "fits soft_body, rigid_body, tetrahedral_body, distance_field with fill_holes = true, which closes 1 hole"
        in lines
    )
    assert "does not fit soft_body" not in lines
    assert RigidBody.from_mesh(read_mesh(file), particle_spacing=0.1, fill_holes=True).mass.sum() == pytest.approx(
        1000 * found.filled_volume
    )


@pytest.mark.parametrize("height", [0.0, 0.1, 1 / 3])
def test_a_flat_sheet_is_not_told_to_fill_its_holes(height: float, tmp_path: Path) -> None:
    """At 0.1 m its cap lies 1e-17 m beside it, and holds as much of the box around both as a body does."""
    position, triangles = sheet(3, 5, 0.5)
    found = inspected(write(tmp_path, "sheet.obj", obj(position @ np.diag([1, 1, 0]) + [0, 0, height], triangles)))
    assert found.filled_volume is None
    for name in BODIES:
        assert "the mesh holds no volume" in found.roles[name] and "fill_holes" not in found.roles[name]


def test_a_soup_is_shown_as_it_is_in_the_file(tmp_path: Path) -> None:
    """A small cube on a large sheet with a fin: what bounds no volume counts, too."""
    position, triangles = sheet(5, 5, 1.0)
    fins = np.array([[2.0, -2.0, 3.0], [2.0, -2.0, -3.0]])
    soup = np.concatenate([triangles, [[12, 13, 25], [12, 13, 26]]])
    mesh = both((np.concatenate([position, fins]), soup), box((0.5, 0.5, 0.5), (9.0, 9.0, 9.0)))
    found = inspected(write(tmp_path, "a.obj", obj(*mesh)))
    area = (
        float(
            np.linalg.norm(np.cross(*(mesh[0][mesh[1][:, k]] - mesh[0][mesh[1][:, 0]] for k in (1, 2))), axis=1).sum()
        )
        / 2
    )
    assert (found.vertices, found.triangles, found.pieces) == (35, len(soup) + 12, 2)
    assert found.area == pytest.approx(area) and found.size == pytest.approx(tuple(np.ptp(mesh[0], axis=0)))
    assert found.volume == pytest.approx(0.125) and found.rims == 2
    assert "of its area bounds a volume" in found.notes[0]


def test_the_size_with_the_guessed_scale(tmp_path: Path) -> None:
    found = inspected(write(tmp_path, "part.stl", binary_stl(*box((300.0, 200.0, 25.0)))))
    assert "size 300 x 200 x 25 m as it is (0.3 x 0.2 x 0.025 m with scale = 0.001)" in found.lines()[1]
    found = inspected(tmp_path / "part.stl", scale=0.001)
    assert found.lines()[1].startswith("size 0.3 x 0.2 x 0.025 m, from")


@pytest.mark.parametrize(
    "name,words",
    [("a.xyz", "cloud of points"), ("a.SLDPRT", "export it as .stl or .step"), ("a.ctm", "export it as .ply")],
)
def test_formats_of_other_programs_name_what_to_do(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        inspected(write(tmp_path, name, "1 2 3\n"))


def test_tetrahedra(tmp_path: Path) -> None:
    mesh = voxel_mesh(box((0.3, 0.2, 0.1)), edge=0.1).mesh
    rows = "".join(f"{k} {' '.join(map(repr, map(float, point)))}\n" for k, point in enumerate(mesh.position))
    write(tmp_path, "a.node", f"{len(mesh.position)} 3 0 0\n{rows}")
    cells = "".join(f"{k} {' '.join(map(str, corners))}\n" for k, corners in enumerate(mesh.tetrahedra))
    found = inspected(write(tmp_path, "a.ele", f"{len(mesh.tetrahedra)} 4 0\n{cells}"))
    assert found.tetrahedra == 30 and found.volume == pytest.approx(0.006) and found.rims == 0
    assert not found.roles["tetrahedral_body"] and "read as tetrahedra alone" in found.roles["cloth"]


@pytest.mark.parametrize(
    "name,longest,words",
    [
        ("a.obj", 0.15, r"probably m \(the longest side is 0.15\)$"),
        ("a.obj", 1.7, "probably m"),
        ("a.obj", 170.0, "probably cm .*scale = 0.01; or, as most CAD parts, mm: scale = 0.001"),
        ("a.obj", 1700.0, "probably mm .*scale = 0.001"),
        ("a.stl", 25.0, "probably mm .*scale = 0.001"),
        ("a.stl", 2.5, "probably m .*in mm: scale = 0.001, or in inches: scale = 0.0254"),
        ("a.stl", 7.25, "probably mm .*scale = 0.001, or in inches: scale = 0.0254"),
        ("a.ply", 15.0, "probably m .*if it is a CAD part in mm: scale = 0.001"),
        ("a.glb", 5.0, "m, as .glb has it$"),
        ("a.glb", 254.0, "m, as .glb has it .*254; if that is too large, its program meant mm: scale = 0.001"),
        ("a.obj", 1e6, "unknown"),
        ("a.ply", 1e-4, "probably m .*if that is too small, give a scale"),
    ],
)
def test_units_are_guessed(name: str, longest: float, words: str) -> None:
    import re

    assert re.search(words, guessed_unit(Path(name), longest, 1.0)[0])


def test_far_from_its_origin(tmp_path: Path) -> None:
    """As maps have it."""
    position, triangles = ball()
    found = inspected(write(tmp_path, "a.obj", obj(position + np.array([5e6, 0, 0]), triangles)))
    assert "times its size: move it to the origin" in found.notes[0]


def test_the_command(command, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    write(tmp_path, "ball.stl", binary_stl(*ball()))
    shown = command("inspect ball.stl --scale 0.001")
    assert shown.status == 0, shown.err
    for words in (
        "66 vertices, 128 triangles, 1 piece",
        "closed",
        "repair: ",
        "fits cloth, soft_body, rigid_body",
        "m^3",
    ):
        assert words in shown.out
    held = json.loads(command("inspect ball.stl --json").out)
    assert held["triangles"] == 128 and held["roles"]["cloth"] == {"fits": True, "reason": ""}
    assert set(held) >= {"size", "area", "volume", "pieces", "rims", "non_manifold_edges", "unit", "repairs", "roles"}
    helped = command("inspect --help").out
    assert "Example: softlab inspect scan.ply" in " ".join(helped.split())
    refused(command("inspect none.obj"), 2, "no such file")
    refused(command("inspect ball.stl --scale 0"), 2, "scale")
    write(tmp_path, "line.obj", "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n")
    refused(command("inspect line.obj"), 2, "line.obj: none of its 1 triangles has an area")


def test_holes_are_filled_by_cook(command, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    position, triangles = ball(halvings=1)
    write(tmp_path, "open.obj", obj(position, triangles[1:]))
    refused(command("cook open.obj a.npz --voxels 4"), 2, "--fill-holes")
    cut = command("cook open.obj a.npz --voxels 4 --fill-holes")
    assert cut.status == 0 and "1 hole" in cut.out and (tmp_path / "a.npz").exists()


# ---------------------------------------------------------------------- progress


def test_long_work_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fractions that rise to 1; short work says nothing."""
    seen: list[tuple[str, float]] = []
    with waiting_watched(lambda label, fraction: seen.append((label, fraction))):
        assert list(steps(range(3), 3, "quick")) == [0, 1, 2]
        assert not seen
        monkeypatch.setattr("softlab.model.base.waiting.INTERVAL", -1.0)
        assert list(steps("abcd", 4, "slow")) == list("abcd")
        assert [fraction for _, fraction in seen] == [0.25, 0.5, 0.75, 1.0, 1.0] and seen[0][0] == "slow"
        seen.clear()
        position, triangles = ball()
        squared_distances(position[triangles], np.full(3, -1.0), np.array([21, 21, 21]), 0.1)
        assert {label for label, _ in seen} == {"sorting triangles", "distance field"}


def test_ctrl_c_ends_long_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the signal does it, between two batches; the bar is gone then."""
    monkeypatch.setattr("softlab.model.base.waiting.INTERVAL", -1.0)
    position, triangles = ball()

    def stop(_label: str, _fraction: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), waiting_shown(), waiting_watched(stop):
        squared_distances(position[triangles], np.full(3, -1.0), np.array([21, 21, 21]), 0.1)
    list(steps(range(3), 3, "after"))  # nobody is watching any more


def test_distances_to_small_triangles_and_large_ones() -> None:
    """The nearest middle is not the nearest triangle: beside a large square lie small ones."""
    large = np.array([[[0, 0, 0], [10, 0, 0], [0, 10, 0.0]]])
    small = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]) + np.array([[[-1, -1, 1.0]], [[-1, 0, 1]], [[0, -1, 1]]])
    low, spacing = np.array([-1.5, -1.5, 0.5]), 0.5
    found = squared_distances(np.concatenate([large, small]), low, np.array([9, 9, 3]), spacing)
    one = np.minimum.reduce(
        [squared_distances(np.array([t]), low, np.array([9, 9, 3]), spacing) for t in [*large, *small]]
    )
    assert np.array_equal(found, one)
