"""Scenes with distance fields: cloths and bodies on them, what is written and told of them, bad input, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import end_state, opened, same
from closed_meshes import ball, both, box
from cloth_solve import cloth, each_solver
from field_scenes import BLOCK, CARRIER, block, falling_bar, falling_cloth
from surface_touch import check_falling_cloth
from test_mesh_collider import written

from softlab.app.driver import open_simulation
from softlab.app.render.collider_shapes import collider_mesh, grounds
from softlab.model.base.errors import InputError, SceneError
from softlab.model.contact.cloth_parameters import B_TREE, COLLIDER_FIELDS, collider_numbers
from softlab.model.contact.overlaps import overlap_lines
from softlab.model.formulas.distance_field import SETTLED
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tables.colliders.distance_field import DistanceField

# ---------------------------------------------------------------------- cloths and bodies


@each_solver
def test_a_cloth_falls_on_it(solver: str) -> None:
    check_falling_cloth(solver, falling_cloth("semi-implicit-euler"), "distance_field")


def test_kernels_and_threads_agree() -> None:
    scene = falling_bar()
    first = end_state(scene, precision="float32", threads=1)
    assert not same(first, end_state(falling_bar(origin=[0.0, -50.0, 0.0]), precision="float32"))  # it was met
    for kernel in ("fused", "stages"):
        assert same(first, end_state(scene, precision="float32", threads=2, kernel=kernel)), kernel


def test_a_body_comes_to_rest_on_it_and_is_carried() -> None:
    """A bar on a block that goes sideways at 0.2 m/s: after a second none of its particles is nearer to the block than the
    thickness, less 1/64, and its middle moves as the block does."""
    still = {"shape": BLOCK, "spacing": 0.125, "origin": [0.0, -0.5, 0.0], "velocity": [0.2, 0.0, 0.0], "angle": 0.0}
    scene = falling_bar(**still, spin=[0.0, 0.0, 0.0], static_friction=1.0, dynamic_friction=1.0)
    scene = scene.replace({"bar.velocity": [0.0, 0.0, 0.0], "bar.spin": [0.0, 0.0, 0.0], "bar.origin": [0.0, 0.2, 0.0]})
    with opened(scene, precision="float32", threads=1) as simulation:
        simulation.advance(100)
        early = simulation.read("position").astype(float)
        simulation.advance(50)
        late = simulation.read("position").astype(float)
    assert late[:, 1].min() >= 0.03 * SETTLED - 1e-6
    assert late[:, 1].min() < 0.035
    assert (late - early)[:, 0].mean() == pytest.approx(0.1, rel=0.02)


# ---------------------------------------------------------------------- scenes and bad input


def test_a_scene_of_it_is_written_and_read() -> None:
    scene = cloth(
        2, 2, hill={"kind": "mesh_collider", "shape": {"name": "terrain", "resolution": 2}}, distance_field=CARRIER
    )
    assert Scene(scene.as_dict(), "cloth").canonical() == scene.canonical()
    assert [kind for kind, _ in scene.colliders] == ["mesh_collider", "distance_field"]
    numbers, part = collider_numbers(scene, np.float32), scene.parts["distance_field"]
    assert isinstance(part, DistanceField)
    place = COLLIDER_FIELDS + int(numbers[COLLIDER_FIELDS + B_TREE])
    assert np.array_equal(numbers[place:], part.numbers(np.float32)) and part.number_count == numbers.size - place
    moved = scene.replace({"distance_field.spacing": 0.05}).parts["distance_field"]
    assert isinstance(moved, DistanceField) and moved.number_count > part.number_count


def test_what_cannot_be_a_field_is_told_apart(tmp_path: Path) -> None:
    open_box = box((1.0, 1.0, 1.0))[0], box()[1][2:]
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]), np.array([[0, 1, 2], [1, 3, 2]])
    for file, mesh, words in (("open", open_box, "not closed.*mesh_collider"), ("flat", flat, "not closed|no volume")):
        path = written(tmp_path / f"{file}.obj", *mesh)
        with pytest.raises(InputError, match=words) as told:
            collider_numbers(cloth(2, 2, distance_field={"file": path, "spacing": 0.1}), np.float32)
        assert path in str(told.value)
    plate = BLOCK | {"sides": (1.0, 0.05, 1.0)}
    for fields, words in [
        ({"shape": BLOCK, "spacing": 2.0}, r"1 m across.*at most 0.25"),
        ({"shape": plate, "spacing": 0.04}, r"0.05 m across.*at most 0.0125"),
        ({"shape": BLOCK, "spacing": 0.002}, r"grid of 1.37e\+08 points, at most 16773120; use at least 0.004"),
        ({"shape": BLOCK, "spacing": 1e-9}, r"grid of 1.06e\+27 points"),
        ({"shape": BLOCK, "spacing": 1e-300}, "use at least 0.004"),
        ({"shape": BLOCK | {"sides": (100.0, 0.01, 100.0)}}, "make it a mesh_collider"),
    ]:
        with pytest.raises(SceneError, match=words) as caught:
            collider_numbers(cloth(2, 2, distance_field=fields), np.float32)
        assert caught.value.field == "distance_field.spacing"
    for fields, field in [
        ({}, "distance_field.file"),
        ({"shape": BLOCK, "file": "tunic.obj"}, "distance_field.file"),
        ({"shape": {"name": "terrain"}}, "distance_field.shape"),
        ({"shape": BLOCK, "spacing": 0.0}, "distance_field.spacing"),
        ({"shape": BLOCK, "spacing": "fine"}, "distance_field.spacing"),
        ({"shape": BLOCK, "thickness": 0.0}, "distance_field.thickness"),
    ]:
        with pytest.raises(SceneError) as caught:
            cloth(2, 2, distance_field=fields)
        assert caught.value.field == field
    with pytest.raises(SceneError, match="belongs to a cloth"):
        Scene({"grid": {"rows": 2, "columns": 2}, "distance_field": {"shape": BLOCK}})


def test_the_spacing_that_is_named_would_do() -> None:
    with pytest.raises(SceneError) as caught:
        block(spacing=0.002).grid  # noqa: B018
    would = float(str(caught.value).rsplit("at least ", 1)[1])
    assert block(spacing=would).number_count > 0.9 * 2**24


def test_what_is_told_of_it(tmp_path: Path) -> None:
    """The grid, how far off it is at the corners (a cube's: all of a cell's other corners lie outside), and what was made
    good: a hole, a piece that runs through another."""
    first, second = block().lines()
    assert first == "12 triangles, 1 x 1 x 1 m"
    assert second.startswith("distances at 13 x 13 x 13 points, 0.125 m apart: at most 0") and second.endswith(
        "corners"
    )
    position, triangles = ball(0.5, 3)
    lines = DistanceField(file=written(tmp_path / "hole.obj", position, triangles[1:]), spacing=0.2).lines()
    assert "1 hole" in lines[1] and "was filled with" in lines[1]
    crossed = both(box(), box((0.5, 0.5, 0.5), (0.5, 0.1, 0.1)))
    lines = DistanceField(file=written(tmp_path / "two.obj", *crossed), spacing=0.2).lines()
    assert "intersects itself" in lines[-1]


def test_pinned_masses_in_it_are_told() -> None:
    sheet = {"pinned": "top-corners", "origin": (0.0, 0.3, 0.0)}
    near = cloth(2, 2, sheet=sheet, distance_field={"shape": BLOCK, "spacing": 0.125})
    assert "2 of 2 pinned masses begin inside a distance_field or nearer" in overlap_lines(near)[0]
    assert not overlap_lines(near.replace({"distance_field.origin": (0.0, -9.0, 0.0)}))


def test_what_is_drawn_is_its_mesh() -> None:
    part = block(origin=(1.0, 2.0, 3.0), spin=(0.0, 0.5, 0.0))
    drawn = collider_mesh(part)
    assert drawn is not None and drawn.turns
    assert np.allclose(drawn.vertices[drawn.triangles], part.position[part.triangles] + [1, 2, 3], atol=1e-6)
    assert grounds(cloth(3, 3, distance_field=part.model_dump()), 0.0, 0.0) == []


def test_bodies_of_the_catalogue_stay_out_of_the_mill() -> None:
    """A second and a half of soft-on-field: no particle nearer to it than the thickness, less 1/64 and roundings of 4 m."""
    scene = load_scene("soft-on-field")
    mill: Any = scene.parts["mill"]
    with open_simulation(scene, "cpu", threads=2) as simulation:
        simulation.advance(150)
        position = simulation.read("position").astype(float)
    place = (position - mill.origin) @ mill.turn_at(1.5)
    end = mill.field.low + mill.field.spacing * (np.array(mill.field.distance.shape) - 1)
    within = ((place > mill.field.low) & (place < end)).all(axis=1)
    away = mill.field.at(place[within])
    assert within.sum() > 100 and (away < 1.5 * mill.thickness).sum() > 20
    assert away.min() > mill.thickness * SETTLED - 16 * np.finfo(np.float32).eps
