"""A tank: one table that a scene reads as the planes of its floor and walls."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.command.scene_file import scene_toml
from softlab.app.driver import open_simulation
from softlab.model.scene.reader import tables_of
from softlab.model.scene.scene import Scene, load_scene

WATER: dict[str, Any] = {
    "water": {"kind": "fluid", "size": [0.2, 0.1, 0.1], "rest_distance": 0.05},
    "gravity": {}, "method": {"solver": "pbf", "dt": 0.01, "substeps": 2, "iterations": 2},
}  # fmt: skip
PLANE = WATER | {"water": {"kind": "fluid", "dimensions": 2, "size": [0.2, 0.1], "rest_distance": 0.05}}
WALLS = ("floor", "left", "right", "back", "front")


def test_a_tank_is_the_planes_of_the_dam_break() -> None:
    planes = load_scene("dam-break")
    tables = {name: table for name, table in planes.as_dict().items() if name not in WALLS}
    tank = Scene(tables | {"tank": {"size": [1.5, 1.0, 0.3]}})
    assert [tank.parts[f"tank-{wall}"] for wall in WALLS] == [planes.parts[wall] for wall in WALLS]
    assert set(tank.kinds) - {f"tank-{wall}" for wall in WALLS} == set(planes.kinds) - set(WALLS)


@pytest.mark.parametrize(("tables", "size"), [(WATER, [0.4, 0.5, 0.3]), (PLANE, [0.4, 0.5])], ids=["space", "plane"])
@pytest.mark.parametrize("open_top", [True, False])
def test_its_planes_bound_its_box(tables: dict[str, Any], size: list[float], open_top: bool) -> None:
    origin = [-0.1, 0.2, 0.3][: len(size)]
    tank = {
        "kind": "tank",
        "size": size,
        "origin": origin,
        "open_top": open_top,
        "thickness": 0.01,
        "static_friction": 0.4,
    }
    scene = Scene(tables | {"basin": tank})
    planes = [part for kind, part in scene.colliders if kind == "plane"]
    assert len(planes) == 2 * len(size) - open_top and not {"basin", "tank"} & set(scene.parts)
    assert {(part.thickness, part.static_friction) for part in planes} == {(0.01, 0.4)}
    corners = np.array(np.meshgrid(*([0.0, one] for one in size))).reshape(len(size), -1).T + origin
    corners = np.hstack([corners, np.zeros((len(corners), 3 - len(size)))])
    gaps = np.array([(corners - part.point) @ np.array(part.normal) for part in planes])
    assert gaps.min() > -1e-12 and all((row < 1e-12).sum() == len(corners) // 2 for row in gaps)
    outside = corners.mean(axis=0) + np.array([0.0, 10.0, 0.0])
    assert (min((outside - part.point) @ np.array(part.normal) for part in planes) > 0) == open_top


def test_it_is_written_back_as_planes_and_read_again() -> None:
    scene = Scene(WATER | {"tank": {"size": [0.4, 0.5, 0.3]}})
    text = scene_toml(scene)
    assert "[tank-floor]" in text and "[tank]" not in text
    tables = tables_of(text)
    assert Scene(tables).canonical() == scene.canonical() == scene.replace({"method.dt": 0.01}).canonical()
    assert scene.replace({"tank-floor.static_friction": 0.5}).parts["tank-floor"].static_friction == 0.5  # type: ignore[attr-defined]


def test_water_stays_in_it() -> None:
    scene = Scene(WATER | {"tank": {"size": [0.25, 0.5, 0.15]}})
    with open_simulation(scene, "cpu", threads="1", math="exact") as simulation:
        simulation.advance(20)
        position = simulation.read("position")
    assert (position > -1e-5).all() and (position[:, 0] < 0.25 + 1e-5).all() and (position[:, 2] < 0.15 + 1e-5).all()


def test_the_command_line_can_add_one() -> None:
    scene = Scene(WATER).replace({"tank.size": [0.4, 0.5, 0.3], "tank.open_top": False})
    assert "tank-top" in scene.parts


def test_bodies_rest_on_its_walls_as_on_planes() -> None:
    """Without a fluid an ungiven thickness follows from the bodies; a given one stays."""
    body = {"kind": "rigid_body", "shape": {"name": "box"}, "particle_spacing": 0.5, "origin": [2.0, 1.0, 2.0]}
    tables = {"body": body, "gravity": {}}
    floor = Scene(tables | {"floor": {"kind": "plane"}}).parts["floor"]
    tank = Scene(tables | {"tank": {"size": [4.0, 4.0, 4.0]}}).parts["tank-floor"]
    assert tank.thickness == floor.thickness != 0.0  # type: ignore[attr-defined]
    given = Scene(tables | {"tank": {"size": [4.0, 4.0, 4.0], "thickness": 0.125}})
    assert given.parts["tank-floor"].thickness == 0.125  # type: ignore[attr-defined]
