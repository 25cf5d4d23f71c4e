"""Refusals name the part and the field that is wrong, whichever constant the field ends up in."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import InputError, SceneError
from softlab.model.core.build import build
from softlab.model.core.families import family_of, stability_limit
from softlab.model.core.stability.diagnosis import diagnose, refusal
from softlab.model.geometry.measures import rotation_about
from softlab.model.scene.scene import Scene, load_scene

SHEET = {"shape": "sheet", "rows": 3, "columns": 3, "spacing": 0.1}


def refused(tables: dict) -> SceneError:
    with pytest.raises(SceneError) as caught:
        scene = Scene(tables, "odd")
        family_of(scene).record(scene, np.float32, (0.0, 0.0, 0.0)[: scene.dimensions])
    return caught.value


@pytest.mark.parametrize("spacing", [1e-320, 1e308])
@pytest.mark.parametrize("name", ["mesh", "banner"])
def test_a_spacing_whose_square_is_no_number(name: str, spacing: float) -> None:
    part = SHEET | {"spacing": spacing} | ({} if name == "mesh" else {"kind": "mesh"})
    error = refused({name: part, "method": {"solver": "xpbd"}})
    assert (error.field, error.value) == (f"{name}.spacing", spacing) and "1e-150 to 1e+150 m" in error.allowed


def test_other_fields_of_a_mesh_have_its_name() -> None:
    error = refused({"banner": SHEET | {"kind": "mesh", "rows": 1}, "method": {"solver": "xpbd"}})
    assert error.field == "banner.rows x banner.columns"


def test_a_file_is_refused_with_its_part_and_scale() -> None:
    scene = load_scene("cloth-mesh")
    with pytest.raises(InputError, match=r"^mesh: .*garment.obj: none of its .* \(at scale = 9.99989e-321\)$"):
        scene.replace({"mesh.scale": 1e-320})


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"grid.mass": 3e152}, "grid.mass"), ({"grid.mass": 1e-60}, "grid.mass"),
        ({"damping.coefficient": 1e100}, "damping.coefficient"), ({"springs.stiffness": 1e300}, "springs.stiffness"),
        ({"grid.mass": 10.0, "springs.stiffness": 1e-300}, "springs.stiffness"),
    ],
)  # fmt: skip
def test_what_is_farthest_from_one_is_to_blame(changes: dict, field: str) -> None:
    scene = load_scene("lab-grid").replace({"damping.coefficient": 0.05}).replace(changes)
    with pytest.raises(SceneError) as caught:
        family_of(scene).record(scene, np.float32, (0.0, 0.0))
    assert caught.value.field == field and "float32" in caught.value.allowed


def test_a_density_is_to_blame_for_a_damper_that_vanishes() -> None:
    """0.05 N s/m over 1e150 kg is no number of float32: the body is too heavy, the damper is ordinary."""
    box = {"kind": "tetrahedral_body", "shape": {"name": "box"}, "edge": 1.0, "density": 3e152}
    tables = {"box": box, "damping": {"coefficient": 0.05}, "method": {"solver": "xpbd", "dt": 0.01}}
    error = refused(tables)
    assert (error.field, error.value) == ("box.density", 3e152) and "braking" in error.allowed


BOX = {"kind": "tetrahedral_body", "shape": {"name": "box"}, "edge": 0.5}
CLOTH = {"rows": 3, "columns": 3, "spacing": 0.1}
WATER = {"kind": "fluid", "size": [0.2, 0.2, 0.2], "rest_distance": 0.1}
STEPPED: dict[str, dict] = {
    "tetrahedra": {"box": BOX, "method": {"solver": "xpbd"}}, "newton": {"box": BOX, "method": {"solver": "newton"}},
    "vbd": {"box": BOX, "method": {"solver": "vbd"}}, "fluid": {"water": WATER, "method": {"solver": "pbf"}},
    "cloth": {"cloth": CLOTH, "structural": {}, "method": {"solver": "xpbd"}},
    "springs": {"cloth": CLOTH, "structural": {}, "method": {"dt": 1e-3}},
}  # fmt: skip


@pytest.mark.parametrize("dt", [1e-320, 1e-160, 1e160, 1e300])
@pytest.mark.parametrize("family", STEPPED)
def test_a_step_whose_square_is_no_number(family: str, dt: float) -> None:
    """1 / h^2 ended in a ZeroDivisionError or an OverflowError of Python."""
    tables = STEPPED[family]
    error = refused(tables | {"method": tables["method"] | {"dt": dt}})
    assert (error.field, error.value) == ("method.dt", dt) and "1e-150 to 1e+150 s" in error.allowed


def test_a_block_of_more_particles_than_can_be_counted() -> None:
    for changes in ({"rest_distance": 1e-320}, {"size": [1e300, 0.2, 0.2]}):
        error = refused({"water": WATER | changes, "method": {"solver": "pbf"}})
        assert error.field == "water.size" and "rest_distance" in error.allowed


@pytest.mark.parametrize(
    ("collider", "field", "value"),
    [
        ({"kind": "mesh_collider", "shape": {"name": "box", "resolution": 1}}, "spin", [1e60, 0.0, 0.0]),
        ({"kind": "plane"}, "thickness", 1e60), ({"kind": "sphere"}, "radius", 1e60),
        ({"kind": "box"}, "velocity", [0.0, -1e60, 0.0]), ({"kind": "capsule"}, "static_friction", 1e300),
    ],
)  # fmt: skip
def test_a_collider_beyond_the_numbers_of_the_precision(collider: dict, field: str, value: object) -> None:
    tables = STEPPED["cloth"] | {"wall": collider | {field: value}}
    with pytest.raises(SceneError) as caught:
        open_simulation(Scene(tables, "odd"), precision="float32", threads=1)
    assert (caught.value.field, caught.value.value) == (f"wall.{field}", value)
    assert "float32 can hold" in caught.value.allowed


def test_an_edge_is_refused_by_its_name() -> None:
    with pytest.raises(SceneError) as caught:
        build(Scene({"box": BOX | {"edge": 1e-320}, "method": {"solver": "xpbd"}}, "odd"))
    assert caught.value.field == "box.edge"


def test_a_compliance_whose_inverse_is_no_number() -> None:
    error = refused(STEPPED["cloth"] | {"structural": {"compliance": 1e-320}})
    assert (error.field, error.value) == ("structural.compliance", 1e-320)


@pytest.mark.parametrize("spacing", [1e-320, 1e-60, 1e60])
def test_a_spacing_is_to_blame_for_a_rest_length(spacing: float) -> None:
    error = refused(STEPPED["springs"] | {"cloth": CLOTH | {"spacing": spacing}})
    assert (error.field, error.value) == ("cloth.spacing", spacing)


@pytest.mark.parametrize(
    ("family", "part", "field"), [("tetrahedra", "box", "mass_damping"), ("springs", "structural", "damping")]
)
def test_a_damper_is_to_blame_for_a_step_that_nobody_can_do(family: str, part: str, field: str) -> None:
    tables = STEPPED[family]
    error = refusal(Scene(tables | {part: tables[part] | {field: 1e60}}, "odd"))
    assert error is not None and f"{part}.{field} = 1e+60 is too large" in str(error)


def test_a_number_that_no_step_can_be_computed_with() -> None:
    """The message of a run that diverged blamed forces."""
    scene = Scene(STEPPED["tetrahedra"] | {"box": BOX | {"damping": 1e60}}, "odd")
    assert "box.damping = 1e+60" in diagnose(scene, stability_limit(scene)).cause
    assert "forces" in diagnose(Scene(STEPPED["vbd"], "usual"), np.inf).cause


def test_any_angle_is_a_turn() -> None:
    """1e60 degrees were no number, and the mesh was to be exported again."""
    assert np.array_equal(rotation_about((0.0, 1.0, 0.0), 1e60), rotation_about((0.0, 1.0, 0.0), 1e60 % 360))
    assert np.array_equal(rotation_about((1.0, 2.0, 0.0), 380.0), rotation_about((1.0, 2.0, 0.0), 20.0))


def test_a_velocity_is_not_blamed_on_an_origin() -> None:
    scene = Scene({"box": BOX | {"velocity": [1e60, 0.0, 0.0]}, "method": {"solver": "xpbd"}}, "odd")
    with pytest.raises(InputError, match="see a body's velocity or spin"):
        open_simulation(scene, precision="float32", threads=1)


@pytest.mark.parametrize("table", [{"kind": "sink"}, {"kind": "mesh", "shape": "sheet"}])
def test_an_unknown_key_beside_a_shape_that_is_a_word(table: dict) -> None:
    """It was looked for within the shape, as if that were a table, and ended in a StopIteration."""
    error = refused({"part": table | {"acceleration": 1.0}})
    assert error.field == "part.acceleration" and "unknown key; known: " in error.allowed
