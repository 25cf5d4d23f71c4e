"""Refusals name the part and the field that is wrong, whichever constant the field ends up in."""

from __future__ import annotations

import numpy as np
import pytest

from model.core.errors import InputError, SceneError
from model.core.families import family_of
from model.scene.scene import Scene, load_scene

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
