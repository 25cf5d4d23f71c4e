"""What of a scene can be steered, by its tables: no window, and no Dear ImGui."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softlab.app.window.live import live_fields, live_parts
from softlab.app.window.materials import material_at
from softlab.app.window.measures import Statistics
from softlab.app.window.panel.history import LENGTH, History
from softlab.app.window.panel.parameters import parameters_of
from softlab.app.window.panel.sliders import fraction_of, rounded
from softlab.model.core.options import LIVE_PATHS
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import Scene, load_scene

GRID = {"grid": {"rows": 2, "columns": 2}, "springs": {}, "damping": {}, "gravity": {}}


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_every_field_of_the_catalogue_has_a_range_that_holds_it(name: str) -> None:
    scene = load_scene(name)
    found = parameters_of(scene, scene, live_parts(scene))
    paths = [one.path for one in found]
    assert len(paths) == len(set(paths)) and "method.dt" in paths
    for one in found:
        value = scene.value(one.path)
        assert one.live == (not one.why), one.path
        if one.kind in ("number", "whole"):
            assert one.low < one.high and one.low <= value <= one.high and math.isfinite(one.high), one
            assert not one.logarithmic or one.low > 0
        elif one.kind == "vector":
            assert one.low <= min(value) and max(value) <= one.high
        elif one.kind == "word":
            assert value in one.words
    live = {path for part in live_parts(scene) for path in LIVE_PATHS[part]}
    assert {one.path for one in found if one.live} == live & set(paths)


def test_units_are_those_of_the_tables() -> None:
    scene = Scene(GRID)
    units = {one.path: one.unit for one in parameters_of(scene, scene, live_parts(scene))}
    assert units["gravity.acceleration"] == "m/s^2" and units["springs.stiffness"] == "N/m"
    assert units["damping.coefficient"] == "N s/m" and units["method.dt"] == "s" and units["grid.mass"] == "kg"


def test_what_is_live_comes_first_and_the_rest_says_why_not() -> None:
    scene = Scene(GRID)
    found = parameters_of(scene, scene, live_parts(scene))
    assert [one.live for one in found] == sorted((one.live for one in found), reverse=True)
    assert {one.path for one in found if one.live} == {
        "gravity.enabled", "gravity.acceleration", "method.dt", "springs.stiffness", "damping.coefficient",
    }  # fmt: skip
    assert next(one for one in found if one.path == "method.integrator").why


def test_a_spring_of_a_compliance_has_a_live_stiffness() -> None:
    tables = {"grid": GRID["grid"], "springs": {"compliance": 0.01}, "method": {"solver": "xpbd"}}
    scene = Scene(tables)
    found = {one.path: one for one in parameters_of(scene, scene, live_parts(scene))}
    assert found["springs.stiffness"].live and not found["springs.compliance"].live
    rigid = Scene(tables | {"springs": {"compliance": 0.0}})
    assert "springs.stiffness" not in {one.path for one in parameters_of(rigid, rigid, live_parts(rigid))}


def test_what_no_stage_is_compiled_for_is_not_live() -> None:
    cloth = {"cloth": {"rows": 2, "columns": 2}, "structural": {}}
    still = Scene(cloth | {"damping": {"coefficient": 0.0}, "wind": {"drag": 0.0, "lift": 0.0}})
    assert not {"damping", "wind"} & set(live_parts(still))
    assert {"damping", "wind"} <= set(live_parts(Scene(cloth | {"damping": {}, "wind": {}})))


def test_live_fields_hold_gravity_where_there_is_none() -> None:
    fields = live_fields(Scene({"grid": GRID["grid"], "springs": {}}))
    assert fields == {
        "gravity.enabled": False, "gravity.acceleration": 9.81, "method.dt": 0.01, "springs.stiffness": 10.0,
    }  # fmt: skip


def test_a_slider_has_the_digits_of_its_numbers_and_a_share() -> None:
    assert rounded(float(np.float32(0.01))) == 0.01 and rounded(1234567.0) == 1234570.0
    assert fraction_of(1.0, 0.01, 100.0, True) == pytest.approx(0.5) and fraction_of(5.0, 0.0, 10.0, False) == 0.5
    assert fraction_of(11.0, 0.0, 10.0, False) == 1.0 and fraction_of(-1.0, 0.0, 10.0, False) == 0.0


def test_bodies_of_several_materials_change_alike() -> None:
    body = {"kind": "tetrahedral_body", "shape": {"name": "box"}}
    scene = Scene({"a": body | {"young_modulus": 1e5}, "b": body | {"young_modulus": 4e5, "poisson_ratio": 0.3}})
    assert material_at(scene, "young_modulus", 2e5) == {"a.young_modulus": 2e5, "b.young_modulus": 8e5}
    ratios = material_at(scene, "poisson_ratio", 0.4)
    assert ratios["a.poisson_ratio"] == 0.4 and ratios["b.poisson_ratio"] == pytest.approx(0.1)
    assert material_at(scene, "damping", 0.01) == {"a.damping": 0.01, "b.damping": 0.01}


def test_a_history_holds_the_last_looks_and_begins_anew_at_an_earlier_time() -> None:
    class World:
        time = 0.0
        scene = Scene(GRID)

    world, history = World(), History()
    for number in range(LENGTH + 5):
        world.time = float(number)
        history.record(world, Statistics(energy=number, kinetic=1.0, momentum=(3.0, 4.0)))  # type: ignore[arg-type]
    assert len(history.rows) == LENGTH and history.column("momentum")[-1] == 5.0
    assert history.column("time")[0] == 5.0
    world.time = 1.0
    history.record(world, Statistics())  # type: ignore[arg-type]
    assert len(history.rows) == 1
