"""Scenes side by side in the demo: their panes, their clocks, which of them keys change, whose mass the mouse takes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from real_window import PATIENCE, display, needs_display  # noqa: F401
from test_viewer import GRID, TABLES

from softlab.app.window.demo import Demo
from softlab.app.window.demo_report import numbers_text, title_text
from softlab.app.window.keys import WORLDS_KEY, hint, keys_text
from softlab.app.window.panes import GAP, MAX_WORLDS, check_alike, panes, titles_of
from softlab.app.window.worlds import STEPS_PER_FRAME
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene

MOON = 1.62  # m/s^2


@pytest.fixture
def pair() -> Iterator[Demo]:
    """The same grid on Earth and on the Moon."""
    on = {"enabled": True}
    scenes = [
        Scene(TABLES | {"title": "Earth", "gravity": on}),
        Scene(TABLES | {"title": "Moon", "gravity": on | {"acceleration": MOON}}),
    ]
    with Demo(scenes) as running:
        yield running


def gravities(demo: Demo) -> list[bool]:
    return [bool(world.scene.gravity and world.scene.gravity.enabled) for world in demo.worlds]


def steps(demo: Demo) -> list[float]:
    return [world.scene.method.dt for world in demo.worlds]


# ---------------------------------------------------------------------- without a window


@pytest.mark.parametrize("width,height", [(1200, 900), (481, 367)])
@pytest.mark.parametrize("count", range(1, MAX_WORLDS + 1))
def test_panes_are_alike_and_fill_the_window_but_for_the_gaps(count: int, width: int, height: int) -> None:
    found = panes(count, width, height)
    assert len(found) == count and len({(pane.width, pane.height) for pane in found}) == 1
    covered = np.zeros((height, width), int)
    for pane in found:
        covered[pane.bottom : pane.bottom + pane.height, pane.left : pane.left + pane.width] += 1
    assert covered.max() == 1
    assert covered[-1, 0] == 1 and covered[0].any()  # from the upper edge to the lower
    columns = len({pane.left for pane in found})
    rows = len({pane.bottom for pane in found})
    assert columns * rows >= count and columns == (count if count <= 3 else -(-count // rows))
    whole = covered[found[0].bottom]  # of the first row, which is full: at most a pixel a gap is rounded away
    assert whole[0] == whole[-1] == 1 and (whole == 0).sum() <= (columns - 1) * (GAP + 1)
    for number, pane in enumerate(found):
        middle = pane.left + pane.width / 2, pane.bottom + pane.height / 2
        assert [other.away(*middle) == 0 for other in found] == [k == number for k in range(count)]


def test_what_cannot_stand_side_by_side_is_told() -> None:
    plane, cloth, bodies = load_scene("lab-grid"), load_scene("cloth-hanging"), load_scene("two-worlds")
    for scenes in ([plane, cloth], [cloth, bodies], [bodies, bodies, plane]):
        with pytest.raises(SceneError, match=f"cannot be shown beside {scenes[0].name}"):
            check_alike(scenes)
    for count in (0, MAX_WORLDS + 1):
        with pytest.raises(SceneError, match=f"{count} scenes"):
            check_alike([plane] * count)
    check_alike([plane, load_scene("lab-curtain")])
    check_alike([bodies] * MAX_WORLDS)
    assert titles_of([plane, cloth]) == [plane.title, cloth.title]
    assert titles_of([plane, cloth, plane]) == [f"{plane.title} (1)", cloth.title, f"{plane.title} (2)"]


def test_the_two_worlds_are_one_but_for_gravity() -> None:
    earth, moon = load_scene("two-worlds"), load_scene("two-worlds-moon")
    assert earth.replace({"gravity.acceleration": MOON}).canonical() == moon.canonical() != earth.canonical()


def test_tab_chooses_all_or_one_alone(pair: Demo) -> None:
    seen = []
    for _ in range(4):
        seen.append((pair.alone, pair.current))
        pair.next_world()
    assert seen == [(False, 0), (True, 0), (True, 1), (False, 0)]
    assert "Earth only" in pair.message
    with Demo([Scene(TABLES)]) as single:
        single.next_world()
        assert not single.alone and "only one scene" in single.message


def test_keys_change_every_world_or_the_chosen_one_alone(pair: Demo) -> None:
    pair.toggle_gravity()
    assert gravities(pair) == [False, False] and pair.message == "gravity off"
    pair.toggle_gravity()
    assert gravities(pair) == [True, True] and pair.message == "gravity on: 9.81, 1.62 m/s² downward"
    pair.next_world()
    pair.next_world()
    pair.toggle_gravity()
    pair.change_dt(1)
    pair.change_stiffness(1)
    assert gravities(pair) == [True, False]
    assert steps(pair) == pytest.approx([0.01, 0.0125])
    springs = [world.scene.springs.stiffness for world in pair.worlds if world.scene.springs]
    assert springs == pytest.approx([10.0, 12.5]) and pair.message.startswith("Moon: stiffness 12.5 N/m")
    assert "gravity off" in title_text(pair, 1) and "(keys" in title_text(pair, 1) and "9.81" in title_text(pair, 0)
    first, second, third = numbers_text(pair, 0.02, 0.01, "fine").split("\n")  # what matters most is first
    assert first.startswith("Moon: time 0.00 s   50 frames/s") and second.startswith("dt 0.0125 s, limit")
    assert third.startswith("cpu, ") and third.endswith("drawing 10 ms (fine)")
    pair.world.limit = 25.0  # far beyond the step: it tells nothing of it
    assert "limit" not in numbers_text(pair, 0.02, 0.01)
    pair.physics_seconds = 1.01
    slow = numbers_text(pair, 1.0, 0.01, brief=True)  # beside the panel, which tells the rest
    assert "1 frame/s" in slow and "physics 1010 ms, drawing 10 ms" in slow
    assert "energy" not in slow and "masses" not in slow
    pair.next_world()
    pair.change_dt(-1)  # each by the factor
    assert steps(pair) == pytest.approx([0.008, 0.01])
    pair.restart()
    assert gravities(pair) == [True, True] and steps(pair) == [0.01, 0.01]


def test_what_one_world_refuses_is_changed_in_none(pair: Demo) -> None:
    """The second's dt²/2 is the shortest that float32 holds but for less than the factor; the first's would have held."""
    shortest = 1.1 * float(np.sqrt(2 * np.finfo(np.float32).tiny))  # s
    pair.worlds[1].set("method.dt", shortest)
    pair.change_dt(-1)
    assert "method.dt" in pair.message and steps(pair) == [0.01, shortest]


def test_the_clocks_go_together_whatever_the_steps(pair: Demo) -> None:
    pair.next_world()
    pair.change_dt(-3)
    short = pair.world.scene.method.dt
    for _ in range(7):
        pair.frame()
        earth, moon = pair.worlds
        assert moon.step % pair.steps_per_frame == 0 and abs(earth.time - moon.time) <= short / 2 + 1e-12
    assert pair.steps_of(pair.worlds[1]) == 10 and pair.steps_of(pair.worlds[0]) == round(0.1 / short)
    pair.change_dt(-60)  # does not hang: it lags
    before = pair.world.step
    pair.frame()
    assert pair.world.step == before + STEPS_PER_FRAME[-1]


def test_a_mass_of_the_world_under_the_pointer_is_pulled_alone(pair: Demo) -> None:
    particle = 6 * 8 + 4
    pair.frame()
    pair.turn_to(1)
    x, y = pair.position[particle].astype(float)
    assert pair.take(particle, (x, y))
    pair.drag(x + 3, y)
    assert pair.force()[0] > 0
    pair.frame()
    moved = [position[particle, 0] - x for position in pair.positions]
    assert moved[1] > 0.1 and abs(moved[0]) < 0.02
    pair.turn_to(0)  # lets go
    assert pair.picker.poke is None and pair.picker.selected is None
    velocity = pair.worlds[1].state().velocity
    assert np.isfinite(velocity).all() and pair.worlds[1]._poke_force is not None
    pair.press_key()
    pair.frame()
    assert pair.force()[1] < 0


def test_it_says_which_world_diverged() -> None:
    scenes = [Scene(TABLES | {"title": name, "gravity": {}}) for name in ("Short", "Long")]
    with Demo(scenes) as demo:
        demo.next_world()
        demo.next_world()
        for _ in range(9):
            demo.change_dt(1)
        for _ in range(2000):
            demo.frame()
            if demo.frozen:
                break
        assert demo.frozen and demo.failure.startswith("Long: diverged at step")
        assert all(np.isfinite(position).all() for position in demo.positions)
        demo.restart()
        demo.frame()
        assert not demo.frozen and [world.step for world in demo.worlds] == [10, 10]


def test_the_key_is_told_where_it_does_something() -> None:
    assert WORLDS_KEY[1] in keys_text(1200, several=True) and WORLDS_KEY[1] not in keys_text(1200)
    assert "Tab" in hint(several=True) and "Tab" not in hint()


# ---------------------------------------------------------------------- the window

CODE = """
import json, sys
import numpy as np
from softlab.app.window.demo import Demo
from softlab.app.output.offscreen import read_pixels
from softlab.app.window.viewer import Viewer
from softlab.model.scene.scene import Scene
tables, folder = json.loads(sys.argv[1]), sys.argv[2]
with Demo([Scene(tables | {"title": "left"}), Scene(tables | {"title": "right"})]) as demo:
    viewer = Viewer(demo, None, None)
    def frames(count):  # frames of physics: those before, while kernels are compiled, do not count, and ignore keys
        last = viewer.frame_count + count
        while viewer.frame_count < last:
            viewer._draw()
    frames(30)
    first = read_pixels(viewer.width, viewer.height)
    viewer.controls._key_down(viewer.controls.key.TAB, 0)
    viewer.controls._key_down(viewer.controls.key.TAB, 0)
    viewer.controls._key_down(viewer.controls.key.G, 0)
    frames(4)
    place = viewer.camera.to_window(demo.positions[1][36].astype(float))
    pane = viewer.panes[1]
    ratio = viewer.window.width / viewer.width
    x, y = (place + (pane.left, pane.bottom)) * ratio
    viewer.controls._mouse_down(x, y, 1, 0)
    held = demo.picker.poke.particle if demo.picker.poke else None
    viewer.controls._mouse_drag(x + 40 * ratio, y, 40 * ratio, 0, 1, 0)
    frames(4)
    told = viewer.state()
    viewer.controls._mouse_up(x, y, 1, 0)
    np.savez(folder + "/seen.npz", first=first, last=read_pixels(viewer.width, viewer.height))
    panes = [[p.left, p.bottom, p.width, p.height] for p in viewer.panes]
    print(json.dumps(told | {"held": held, "panes": panes, "after": demo.picker.poke is None}))
    viewer.window.close()
"""


@pytest.mark.display
@needs_display
def test_window_shows_two_worlds_each_in_its_half(tmp_path: Path, display: str) -> None:  # noqa: F811
    tables = TABLES | {"grid": GRID, "gravity": {"enabled": False}}
    environment = os.environ | {"DISPLAY": display, "OMP_WAIT_POLICY": "passive"}
    environment.pop("NUMBA_ENABLE_CUDASIM", None)
    done = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(tables), str(tmp_path)], env=environment, capture_output=True,
        text=True, timeout=PATIENCE, check=False, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    assert (told["current"], told["alone"], told["held"], told["after"]) == (1, True, 36, True)
    assert [world["gravity"] for world in told["worlds"]] == [0.0, 9.81] and told["poke"]["particle"] == 36
    left, right = told["panes"]
    x, _ = told["masses"]["36"]["window"]
    assert right[0] < x < right[0] + right[2] and left[2:] == right[2:]
    with np.load(tmp_path / "seen.npz") as seen:
        first, last = seen["first"][::-1, :, :3].astype(int), seen["last"][::-1, :, :3].astype(int)

    def drawn(picture: np.ndarray, pane: list[int]) -> np.ndarray:
        """A pane without its title, the legend and the hint."""
        across, up, wide, high = pane
        return picture[up + 130 : up + high - 80, across : across + wide]

    # The same scene by the same camera; edges are smoothed from places that are rounded elsewhere in the window.
    assert np.abs(drawn(first, left) - drawn(first, right)).max() <= 2
    assert (drawn(first, left).min(axis=2) < 200).mean() > 0.01
    assert (np.abs(drawn(last, left) - drawn(last, right)).max(axis=2) > 60).mean() > 0.01
    gap = first[left[1] + 130 : left[1] + left[3] - 80, left[0] + left[2] : right[0]]
    assert len(np.unique(gap.reshape(-1, 3), axis=0)) == 1 and gap.max() < 250
