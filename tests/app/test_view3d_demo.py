"""The demo in space: a cloth is pulled, pushed, turned about, in a window and without one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from fake_cloth import open_fake
from real_window import StillWindow, display, needs_display  # noqa: F401  # a fixture, and the window of another demo
from test_view3d import HANGING, REST, SCENE, looks_like

from softlab.app.render import colours
from softlab.app.render.camera3d import Camera3D
from softlab.app.window.demo import Demo
from softlab.app.window.keys import keys_of, keys_text
from softlab.model.scene.scene import Scene, load_scene

# ---------------------------------------------------------------------- the demo


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([SCENE], open_world=open_fake) as running:
        yield running


def test_a_mass_is_pulled_in_space_and_let_go(demo: Demo) -> None:
    assert demo.take(31, REST[31] + (0.1, 0.2, 0.3))
    gain = 100.0  # N/m: the stiffest springs'
    np.testing.assert_allclose(demo.force(), np.array([0.1, 0.2, 0.3]) * gain, rtol=1e-5)
    demo.drag(*(REST[31] + (0.0, 0.0, 0.2)))
    demo.frame()
    moved = demo.positions[0] - REST
    assert moved[31, 2] > 0.001 and not moved[30].any()
    for _ in range(60):
        demo.frame()
    np.testing.assert_allclose(demo.positions[0][31], REST[31] + (0.0, 0.0, 0.2), atol=0.01)
    demo.release()
    assert demo.force() == (0.0, 0.0, 0.0)


def test_a_pulled_cloth_does_not_swing_up() -> None:
    """The hand takes energy once it holds still: after 3 s of a pull the mass is at rest near the pointer, and a cloth of
    real springs, nearly without dampers, has no more energy than the pull has given it: half of force times way."""
    scene = load_scene("cloth-hanging").replace({"cloth.rows": 12, "cloth.columns": 12, "gravity.enabled": False})
    with Demo([scene], math="exact") as demo:
        start = demo.positions[0][66].astype(float)
        target = start + np.array([0.3, 0.2, 0.2])
        assert demo.take(66, target)
        most = 0.0
        for _ in range(300):
            demo.frame()
            most = max(most, float(np.abs(demo.positions[0][66] - start).max()))
        assert not demo.frozen and most < 0.6  # twice the way: a swing without loss about the pointer
        stiffness = 100.0  # N/m, of the hand: not more work than filling its spring by the whole way
        assert demo.statistics.kinetic < 0.5 * stiffness * float(np.sum((target - start) ** 2))
        assert np.linalg.norm(demo.positions[0][66] - target) < np.linalg.norm(start - target)


def test_arrows_and_enter_work_as_in_the_plane(demo: Demo) -> None:
    camera = Camera3D(800, 600, yaw=np.pi / 2, pitch=0.0)  # from +x: what lies to the right in the window is -z
    demo.press_key()
    assert demo.picker.selected == 3 * 9 + 4
    assert demo.force()[1] < 0 == demo.force()[0] == demo.force()[2]
    demo.release()
    demo.move_selection(1, 0, camera.direction(1, 0))
    assert demo.picker.selected == 3 * 9 + 5
    demo.press_key()
    np.testing.assert_allclose(np.array(demo.force()) / 50.0, (0, 0, -1), atol=1e-12)  # two spacings of 100 N/m


def test_the_demo_changes_every_kind_of_spring(demo: Demo, monkeypatch: pytest.MonkeyPatch) -> None:
    changes: dict[str, Any] = {}
    monkeypatch.setattr(demo.world, "set", changes.__setitem__)
    demo.change_stiffness(1)
    assert changes == {"structural.stiffness": 125.0, "shear.stiffness": 125.0}
    assert "structural stiffness 125 N/m, shear stiffness 125 N/m" in demo.message


def test_the_statistics_have_three_dimensions(demo: Demo) -> None:
    np.testing.assert_allclose(demo.statistics.bounds, (0, -1.5, 0, 2, 0, 0), atol=1e-6)
    assert demo.statistics.strain_range == pytest.approx(0.01)


def test_the_keys_of_space_are_told() -> None:
    wide, narrow, keys = keys_text(1200, space=True), keys_text(400, space=True), keys_of("sheet", True)
    assert len(narrow.splitlines()) == len(keys) + 1 and len(wide.splitlines()) == -(-len(keys) // 2) + 1
    assert "surface" in wide and "surface" not in keys_text(1200)
    assert all(len(meaning) < 30 and len(key) < 8 for key, meaning in keys)


# ---------------------------------------------------------------------- the window itself


@pytest.fixture(scope="module")
def cloth_window(tmp_path_factory: pytest.TempPathFactory, display: str) -> Iterator[StillWindow]:  # noqa: F811
    with StillWindow(tmp_path_factory.mktemp("cloth"), display, Scene(HANGING)) as shown:
        yield shown


@pytest.mark.display
@needs_display
def test_window_turns_moves_zooms_and_frames(cloth_window: StillWindow) -> None:
    before = cloth_window.settled()
    cloth_window.xdotool("mousemove", 60, 300)  # beside the cloth
    cloth_window.xdotool("mousedown", 1)
    cloth_window.xdotool("mousemove", 110, 280)
    state = cloth_window.wait("a turn", lambda state: state["yaw"] < before["yaw"] - 0.2)
    assert state["pitch"] < before["pitch"] and state["poke"] is None
    cloth_window.xdotool("mouseup", 1)
    cloth_window.xdotool("mousedown", 2)
    cloth_window.xdotool("mousemove", 60, 300)
    cloth_window.wait("the turn back", lambda state: abs(state["yaw"] - before["yaw"]) < 0.01)
    cloth_window.xdotool("mouseup", 2)
    cloth_window.xdotool("click", 4)
    cloth_window.wait("a nearer eye", lambda state: state["distance"] < 0.95 * before["distance"])
    x = cloth_window.mass(31)[0]
    cloth_window.xdotool("mousedown", 3)
    cloth_window.xdotool("mousemove", 100, 320)
    cloth_window.wait("a moved view", lambda state: abs(state["masses"]["31"]["window"][0] - x - 40) < 3)
    cloth_window.xdotool("mouseup", 3)
    cloth_window.key("f")
    state = cloth_window.wait(
        "everything framed", lambda state: abs(state["distance"] - before["distance"]) < 0.01 * before["distance"]
    )
    assert math.isclose(state["yaw"], before["yaw"], abs_tol=0.01)


@pytest.mark.display
@needs_display
def test_window_pulls_a_mass_in_the_plane_of_the_view(cloth_window: StillWindow) -> None:
    cloth_window.settled()
    x, y = cloth_window.grab(31)
    # so far that springs stay long: nearer, the sheet folds until nothing pulls, before a busy machine has looked
    cloth_window.xdotool("mousemove", x + 100, y - 50)
    cloth_window.xdotool("mousemove", x + 200, y - 100)
    state = cloth_window.wait(
        "a pull", lambda state: state["poke"] is not None and math.hypot(*state["poke"]["force"]) > 1
    )
    force, yaw, pitch = np.array(state["poke"]["force"]), state["yaw"], state["pitch"]
    toward = np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), math.cos(yaw) * math.cos(pitch)])
    assert state["poke"]["particle"] == 31 and len(force) == 3
    # nothing along the line of sight, but for what the mass moves within a frame in the plane's own rounding
    assert abs(force @ toward) < 0.02 * np.linalg.norm(force)
    cloth_window.xdotool("mouseup", 1)
    cloth_window.wait("the hand let go", lambda state: state["poke"] is None)
    cloth_window.key("r")


@pytest.mark.display
@needs_display
def test_window_shows_springs_keys_and_a_picture(cloth_window: StillWindow) -> None:
    from PIL import Image

    cloth_window.key("r")
    cloth_window.key("f")
    cloth_window.key("l")
    cloth_window.wait("springs", lambda state: state["lines"])
    cloth_window.key("l")
    cloth_window.wait("a surface", lambda state: not state["lines"])
    cloth_window.settled()
    cloth_window.key("s")
    state = cloth_window.wait("a screenshot", lambda state: state["screenshot"] is not None)
    picture = np.asarray(Image.open(state["screenshot"]))
    assert list(picture.shape[:2]) == state["window"][::-1]
    x, y = cloth_window.mass(31)
    assert looks_like(picture[y - 5 : y + 6, x + 14 : x + 20].reshape(-1, 3) / 255, colours.CLOTH_FRONT)
