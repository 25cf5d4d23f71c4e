"""Tables of fluids: what they are made into, what is refused, each with one clear line, and what is told of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fluid_scenes import FLOOR, METHOD, column_scene, flat, two_fluids

from softlab.app.plan.fluid import fluid_lines
from softlab.app.plan.report import plan_report
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build
from softlab.model.core.families import family_of
from softlab.model.fluid.measure import compression, density_errors, height
from softlab.model.scene.scene import Scene

NAN = float("nan")
WATER = {"kind": "fluid", "size": [0.2, 0.2, 0.2]}


def scene_of(water: Any = WATER, **tables: Any) -> Scene:
    return Scene({"water": water, "method": METHOD} | tables)


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("support", 0.0, "must be greater than 0"),
        ("rest_distance", 0.0, "must be greater than 0"),
        ("support", 0.03, "must be less than the support"),
        ("support", 0.5, "must be 1.2 to 4 rest distances"),
        ("density", 0.0, "must be greater than 0"),
        ("density", NAN, "must be"),
        ("viscosity", NAN, "must be"),
        ("viscosity", -1.0, "must be at least 0"),
        ("rest_distance", 2e-4, "main memory"),  # 10^9 particles
        ("size", [0.2, 0.2], "must have 3 numbers"),
        ("size", [0.2, 0.01, 0.2], "holds no particle"),
        ("vortices", 1.0, "needs a domain"),
        ("dimensions", 4, "must be one of 2"),
        ("maximum_speed", 0.0, "must be greater than 0"),
    ],
)
def test_bad_values(field: str, value: Any, told: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene_of(WATER | {field: value})
    assert str(caught.value).startswith(f"water.{field} = ") or field == "support", str(caught.value)
    assert told in str(caught.value) and "\n" not in str(caught.value)


def test_blocks_fluids_and_masses() -> None:
    """On the lattice, half a rest distance from the sides; a lattice of water weighs what water does, nearly."""
    block = {"origin": [1.0, 0.0, 0.0], "size": [0.1, 0.05, 0.15]}
    scene = scene_of(WATER | {"blocks": [block]}, oil=WATER | {"density": 500.0, "origin": [0.0, 0.2, 0.0]})
    found = scene.fluid_set
    assert found.particle_count == 64 + 6 + 64 and list(np.bincount(found.fluid)) == [70, 64]
    assert found.position[0] == pytest.approx(0.025) and found.position[1] == pytest.approx([0.075, 0.025, 0.025])
    assert found.masses[:64].sum() == pytest.approx(1000 * 0.2**3, rel=0.02) and found.lightness == (1.0, 2.0)
    assert np.array_equal(build(scene).inverse_mass, 1 / found.masses)
    assert Scene(scene.as_dict()).canonical() == scene.canonical()
    assert scene_of(**{"floor": FLOOR}).method.name == "pbf macklin"


def test_a_fluid_without_a_method_has_one() -> None:
    assert Scene({"water": WATER}).method.solver == "pbf"


def test_what_plan_tells() -> None:
    """Each parameter with its unit and meaning; the speed limit that follows from the support; both backends, or why not."""
    scene = two_fluids()
    lines = "\n".join(fluid_lines(scene))
    for word in (
        "water.viscosity = 9  (Pa s",
        "oil.density = 700  (kg/m^3)",
        "5.455 m/s (half a support radius per substep)",
        "XSPH removes",
    ):
        assert word in lines
    report = plan_report(scene, backends=("cpu", "gpu"))
    told = report.as_dict()
    assert told["fluids"] == 2 and told["limit"] is None and {one.name for one in report.backends} >= {"cpu"}
    assert family_of(scene).note(scene).startswith("density is kept")
    thick = column_scene(**{"water.viscosity": 1e6})
    assert "Pa s act at this substep" in family_of(thick).note(thick)


def test_what_is_measured() -> None:
    scene = flat()
    errors = density_errors(scene, scene.fluid_set.position)
    assert np.abs(errors).max() < 1e-12 and compression(scene, scene.fluid_set.position)[1] < 1e-12
    column = column_scene()
    assert height(column, column.fluid_set.position) == pytest.approx(0.2)
