"""The drawn edges of a tank: where its walls are, and none where there is no tank of water."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.render.fluid.tank_frame import BAR, tank_box, tank_frame
from softlab.model.scene.scene import Scene, load_scene

WATER: dict[str, Any] = {"kind": "fluid", "size": [0.2, 0.4, 0.1], "rest_distance": 0.05}
TANK: dict[str, Any] = {"size": [0.4, 0.5, 0.3], "origin": [-0.1, 0.0, 0.2]}


@pytest.mark.parametrize("open_top", [True, False])
def test_a_tank_is_a_box_of_twelve_bars_outside_of_it(open_top: bool) -> None:
    scene = Scene({"water": WATER | {"origin": [0.0, 0.0, 0.2]}, "tank": TANK | {"open_top": open_top}})
    box = tank_box(scene)
    assert box is not None and box[2]
    np.testing.assert_allclose(box[:2], [[-0.1, 0.0, 0.2], [0.3, 0.5, 0.5]])
    bars = tank_frame(scene)
    corners = np.concatenate([bar.vertices for bar in bars])
    assert len(bars) == 12
    half = BAR * 0.5
    np.testing.assert_allclose(corners.min(axis=0), np.array([-0.1, 0.0, 0.2]) - 2 * half, atol=1e-6)
    inside = [*np.array(box[:2]), [1e-06] * 3, [-1e-06] * 3]
    for bar in bars:
        low, high = bar.vertices.min(axis=0), bar.vertices.max(axis=0)
        assert ((high <= inside[0]) | (low >= inside[1]) | [False, low[1] >= 0.5 - 2 * half, False]).any()


def test_walls_without_an_end_have_no_rim() -> None:
    """Those of the dam break: bars below, and at the corners to a quarter over the water."""
    bars = tank_frame(load_scene("dam-break"))
    box = tank_box(load_scene("dam-break"))
    assert len(bars) == 8 and box is not None and not box[2]
    top = load_scene("dam-break").fluid_set.position[:, 1].max()
    assert max(bar.vertices[:, 1].max() for bar in bars) == pytest.approx(1.25 * top, rel=0.02)


@pytest.mark.parametrize("name", ["fountain", "lab-water", "soft-pile", "cloth-sphere"])
def test_nothing_else_has_a_frame(name: str) -> None:
    """No floor with four walls: blocks, a plane, no fluid."""
    assert tank_frame(load_scene(name)) == []


def test_walls_that_move_have_no_frame() -> None:
    scene = load_scene("dam-break").replace({"right.velocity": [0.1, 0.0, 0.0]})
    assert tank_box(scene) is None
