"""The demo of bodies: which particle is under the pointer, what keys and panel tell."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bodies_scenes import PLANE, beams_and_torus
from fake_cloth import open_fake
from real_window import StillWindow, display, needs_display  # noqa: F401
from test_bodies_view import BODY_SET, SCENE
from test_view3d import drawing, looks_like, near  # noqa: F401  # a fixture among them

from softlab.app.render import colours
from softlab.app.render.camera3d import Camera3D
from softlab.app.window.demo import Demo
from softlab.app.window.demo_report import masses_text, numbers_text
from softlab.app.window.keys import hint, keys_of, keys_text
from softlab.app.window.mouse import Mouse
from softlab.app.window.picker import neighbour

# ---------------------------------------------------------------------- the demo


@pytest.fixture
def demo() -> Iterator[Demo]:
    with Demo([SCENE], open_world=open_fake) as running:
        yield running


def test_a_frame_takes_a_frames_time(demo: Demo) -> None:
    assert demo.steps_per_frame == 5  # of 0.005 s: 1.5 times 1/60 s, where 2 are a 1.67th of it
    demo.frame()
    assert demo.world.step == demo.steps_per_frame
    demo.change_steps(1)
    assert demo.steps_per_frame == 10


def test_the_particle_under_the_pointer_is_taken_between_others_too(demo: Demo) -> None:
    """What a skin hides between two particles that are seen 40 pixels apart."""
    viewer: Any = SimpleNamespace(demo=demo, camera=Camera3D(1200, 900), follow=True, space=True)
    viewer.pyglet = SimpleNamespace(window=SimpleNamespace(mouse=SimpleNamespace(LEFT=1, MIDDLE=2, RIGHT=4)))
    mouse = Mouse(viewer)
    torus = np.flatnonzero(BODY_SET.body == 2)
    particle = int(torus[np.argmax(BODY_SET.position[torus] @ viewer.camera.axes[2])])
    viewer.camera._aim(BODY_SET.position[particle])
    viewer.camera.distance = SCENE.bodies["torus"].particle_spacing * viewer.camera.focal / 40
    mouse.press(600 + 14.0, 450 + 14.0, 1)  # 20 pixels away, and half of what lies between the particles
    held = demo.picker.poke
    assert held is not None and BODY_SET.body[held.particle] == 2 and mouse.pointer == (614.0, 464.0)
    mouse.drag(700.0, 500.0, 86.0, 36.0)
    mouse.pull()
    target = np.array(demo.picker.poke.target)  # type: ignore[union-attr,arg-type]
    np.testing.assert_allclose(viewer.camera.to_window(target), (700, 500), atol=1e-6)
    assert abs((target - demo.positions[0][held.particle]) @ viewer.camera.axes[2]) < 1e-6  # in the plane of the window
    mouse.release(1)
    assert demo.picker.poke is None
    mouse.press(600 + 300.0, 450.0 + 300.0, 1)  # beside it: turns the view
    assert demo.picker.poke is None and mouse._moving == 1


def test_arrows_go_to_the_neighbour_that_way_in_the_same_body(demo: Demo) -> None:
    start = int(np.flatnonzero(BODY_SET.body == 1)[0])
    demo.picker.selected = start
    for direction in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)):
        before = BODY_SET.position[demo.picker.selected]
        demo.move_selection(1, 0, direction)
        assert demo.picker.direction == direction and BODY_SET.body[demo.picker.selected] == 1
        moved = BODY_SET.position[demo.picker.selected] - before
        if moved.any():
            assert moved @ direction > 0.7 * np.linalg.norm(moved)
            others = BODY_SET.position[BODY_SET.body == 1] - before
            distance = np.linalg.norm(others, axis=1)
            better = (others @ direction > np.sqrt(0.5) * distance) & (distance < np.linalg.norm(moved) - 1e-6)
            assert not (better & (distance > 0)).any()
    assert demo.picker.selected != start
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert neighbour(line, np.arange(3), 2, (1.0, 0.0, 0.0)) == 2


def test_the_panel_counts_particles_clusters_and_bodies(demo: Demo) -> None:
    text = numbers_text(demo, 0.02, 0.01)
    assert f"{BODY_SET.particle_count} particles in {BODY_SET.clusters.count} clusters of 3 bodies" in text
    assert "largest distance from goal" in text and "stiffness" not in text and "collider" not in text
    ball = {"kind": "sphere", "center": [9.0, 0.0, 0.0], "radius": 0.1}
    assert masses_text(beams_and_torus(**PLANE)).endswith("of 3 bodies, 1 collider")
    assert masses_text(beams_and_torus(**PLANE, ball=ball)).endswith("of 3 bodies, 2 colliders")


def test_the_keys_of_bodies_are_told() -> None:
    wide, narrow = keys_text(1200, "bodies", True), keys_text(400, "bodies", True)
    for text in (wide, narrow):
        assert all(meaning in text for _, meaning in keys_of("bodies", True)) and "P K C I" in text
        assert all(len(meaning) < 33 and len(key) < 8 for key, meaning in keys_of("bodies", True))
    assert ("{ }", "stiffness / 1.25, x 1.25") in keys_of("sheet", False) and "{ }" not in narrow
    assert "P: particles" in hint("bodies", True) and "P: " not in hint(space=True) + hint()


# ---------------------------------------------------------------------- the window


@pytest.mark.display
@needs_display
def test_window_shows_particles_and_skins_and_pulls_a_particle(tmp_path: Path, display: str) -> None:  # noqa: F811
    from PIL import Image

    with StillWindow(tmp_path, display, beams_and_torus(gravity={"enabled": False})) as window:
        window.key("n")
        window.key("m")
        window.key("i")
        window.wait("no links", lambda state: state["message"] == "these bodies have no links" and not state["links"])
        window.wait("a graph, and no numbers", lambda state: state["graph_shown"] and not state["numbers_shown"])
        for key, name, shown in (("c", "clusters", True), ("c", "clusters", False), ("o", "colouring", "group"),
                                 ("o", "colouring", "cluster"), ("o", "colouring", "body")):  # fmt: skip
            window.key(key)
            window.wait(f"{name} {shown}", lambda state, name=name, shown=shown: state[name] == shown)
        for key, particles, skin in (("p", True, True), ("k", True, False), ("l", False, True)):
            window.key(key)
            window.wait(f"key {key}", lambda state, p=particles, k=skin: (state["particles"], state["skin"]) == (p, k))
        window.key("p")
        window.key("k")
        window.wait("particles alone", lambda state: state["particles"] and not state["skin"])
        last = BODY_SET.particle_count - 1  # of the torus
        x, y = window.grab(last)
        window.xdotool("mousemove", x, y - 40)
        state = window.wait("a pull upward", lambda state: state["poke"] is not None and state["poke"]["force"][1] > 0)
        assert state["poke"]["particle"] == last
        window.xdotool("mouseup", 1)
        window.key("s")
        state = window.wait("a screenshot", lambda state: state["screenshot"] is not None)
        picture = np.asarray(Image.open(state["screenshot"]))[:, :, :3] / 255
        torus = np.array(colours.BODIES[2])
        strong = picture[picture.sum(axis=2) > 0.3]
        alike = np.abs(strong / strong.sum(axis=1, keepdims=True) - torus / torus.sum()).max(axis=1) < 0.03
        assert alike.sum() > 500
