"""Meshes made fit for cutting: pieces united, triangles made fewer; volumes by closed forms."""

from pathlib import Path

import numpy as np
import pytest

from softlab.app.command.cook import cook_body
from softlab.model.assets.cooked import Repair, cooked
from softlab.model.base.errors import BackendUnavailable, InputError, SceneError
from softlab.model.geometry import repair
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.repair import simplified, united
from softlab.model.geometry.shapes import Shape
from softlab.model.geometry.solid import solid

BOX = Shape(name="box").mesh()  # a cube of a metre


Arrays = tuple[np.ndarray, np.ndarray]


def moved(mesh: TriangleMesh, by: float, turned: bool = False) -> Arrays:
    return mesh.position + np.array([by, 0, 0]), mesh.triangles[:, [0, 2, 1]] if turned else mesh.triangles


def both(*parts: Arrays) -> Arrays:
    first = np.cumsum([0, *(len(position) for position, _ in parts)])
    return (
        np.concatenate([position for position, _ in parts]),
        np.concatenate([triangles + start for (_, triangles), start in zip(parts, first, strict=False)]),
    )


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("by", "soup"), [(0.5, False), (0.123, False), (0.123, True)])
def test_two_cubes_that_overlap_have_the_volume_of_what_they_fill(by: float, turned: bool, soup: bool) -> None:
    """Also where vertices of both are at one place (0.5), and of a soup (.stl), whose vertices have no numbers."""
    pytest.importorskip("manifold3d")
    position, triangles = both(moved(BOX, 0.0), moved(BOX, by, turned))
    if soup:
        position, triangles = position[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)
    made = united(position, triangles)
    assert made.pieces == 1 and made.boundary_loops == 0
    assert solid(made, 0.0).volume == pytest.approx(1 + by, rel=1e-12)


def test_a_cube_in_a_cube_is_the_outer_one() -> None:
    pytest.importorskip("manifold3d")
    inner = BOX.position * 0.5 + BOX.position.mean(axis=0) * 0.5, BOX.triangles
    assert solid(united(*both(moved(BOX, 0.0), inner)), 0.0).volume == pytest.approx(1, rel=1e-12)


def test_a_body_of_united_pieces_weighs_them_once() -> None:
    pytest.importorskip("manifold3d")
    body = cooked(both(moved(BOX, 0.0), moved(BOX, 0.5)), edge=0.25, repair=Repair(unite=True), use_cache=False)
    assert body.report.volume == pytest.approx(1.5, rel=1e-9)


def test_open_pieces_are_refused() -> None:
    pytest.importorskip("manifold3d")
    with pytest.raises(InputError, match=r"piece 1 has a hole, .* conforming without --unite"):
        united(BOX.position, BOX.triangles[1:])


@pytest.mark.parametrize("most", [200, 1000])
def test_a_simplified_surface_stays_closed_and_keeps_its_volume(most: int) -> None:
    pytest.importorskip("igl")
    ball = Shape(name="ball", resolution=16).mesh()
    assert len(ball.triangles) > most
    made = simplified(ball, most)
    assert len(made.triangles) <= most and made.boundary_loops == 0 and made.pieces == 1
    # a closed surface of n triangles about a ball encloses 1 - O(1 / n) of it: an icosahedron's 20 leave 40 %, so 8 / n
    assert solid(made, 0.0).volume == pytest.approx(solid(ball, 0.0).volume, rel=8 / most)


def test_what_is_small_enough_is_left_alone() -> None:
    assert simplified(BOX, 10**6) is BOX
    with pytest.raises(SceneError, match="at least 4"):
        simplified(BOX, 3)


@pytest.mark.parametrize("name", ["manifold3d", "libigl"])
def test_what_is_missing_is_named_with_its_remedy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repair.importlib.util, "find_spec", lambda module: None)
    with pytest.raises(BackendUnavailable, match=rf"{name} is not installed; pip install -e .*meshing"):
        united(BOX.position, BOX.triangles) if name == "manifold3d" else simplified(BOX, 8)


def test_tetrahedra_of_a_file_have_no_use_for_it(tmp_path: Path) -> None:
    from rich.console import Console

    (tmp_path / "one.msh").write_text("nothing")
    with pytest.raises(SceneError, match="does not apply to a file of tetrahedra"):
        cook_body(str(tmp_path / "one.msh"), tmp_path / "body.npz", Console(), repair=Repair(unite=True))
    assert not (tmp_path / "body.npz").exists()
