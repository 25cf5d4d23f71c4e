"""The window's camera, label, lines and detail as pure functions: none of it needs OpenGL."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softlab.app.render.camera3d import MAX_PITCH, NEAREST, Camera3D
from softlab.app.render.detail import DETAILS, FINE, QUICK, next_detail, usual_detail
from softlab.app.render.legends import range_texts
from softlab.app.render.panels import TIP_GAP, beside_tip, divided
from softlab.app.window.demo import NO_BODIES
from softlab.app.window.idle_redraw import SETTLE, TOUCHES, IdleRedraw
from softlab.app.window.keys import keys_text
from softlab.app.window.overlay import MESSAGE_SECONDS
from softlab.app.window.view_options import OF_PLANE, ViewOptions

WINDOW = (1200.0, 900.0)
LABEL = (70.0, 18.0)
UP = np.array([0.0, 1.0, 0.0])
ANGLE = st.floats(-1.5, 1.5)


def height(camera: Camera3D, point: np.ndarray, normal: np.ndarray) -> float:
    """Of the eye over a plane, in distances."""
    return float((camera.eye - point) @ normal) / camera.distance


# ---------------------------------------------------------------------- the camera and the ground


def test_dragging_down_ends_just_above_the_ground() -> None:
    camera = Camera3D(1200, 900, y=2.0, distance=10.0)
    for _ in range(100):
        camera.orbit(0.0, 40.0)  # up by so much: the eye goes down
        camera.stay_above(np.zeros(3), UP)
    assert height(camera, np.zeros(3), UP) == pytest.approx(NEAREST)
    assert camera.pitch == pytest.approx(np.arcsin(NEAREST - 0.2)), (
        "what stands on the ground is seen from below, a little"
    )
    assert camera.target == pytest.approx([0, 2, 0])


def test_above_the_ground_nothing_changes() -> None:
    camera = Camera3D(1200, 900, y=2.0, distance=10.0, pitch=-0.1)
    before = replace(camera)
    camera.stay_above(np.zeros(3), UP)
    assert camera == before


@given(ANGLE, ANGLE, st.floats(-5.0, 5.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0))
def test_the_eye_is_above_every_floor_wherever_it_looks(
    pitch: float, yaw: float, y: float, slope: float, turned: float
) -> None:
    normal = np.array([np.sin(slope) * np.cos(turned), np.cos(slope), np.sin(slope) * np.sin(turned)])
    point = np.array([0.3, -0.2, 0.1])
    camera = Camera3D(1200, 900, y=y, distance=3.0, yaw=yaw, pitch=min(max(pitch, -MAX_PITCH), MAX_PITCH))
    camera.stay_above(point, normal)
    assert height(camera, point, normal) >= NEAREST - 1e-9
    assert abs(camera.pitch) <= MAX_PITCH


@pytest.mark.parametrize("normal", [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.9, 0.43588989, 0.0]])
def test_walls_and_ceilings_leave_it_outside(normal: list[float]) -> None:
    camera = Camera3D(1200, 900, distance=10.0, yaw=-1.0)
    before = replace(camera)
    camera.stay_above(np.array([5.0, 5.0, 0.0]), np.array(normal))
    assert camera == before


# ---------------------------------------------------------------------- the force's label


@pytest.mark.parametrize("turn", np.arange(0, 2 * np.pi, np.pi / 8))
@pytest.mark.parametrize("length", [2.0, 30.0, 300.0])
def test_the_label_lies_clear_of_the_arrow_and_of_the_ring(turn: float, length: float) -> None:
    way = np.array([np.cos(turn), np.sin(turn)])
    start = np.array([600.0, 450.0])
    end = start + length * way
    left, bottom = beside_tip(tuple(start), tuple(end), LABEL, WINDOW)
    low, high = np.array([left, bottom]), np.array([left, bottom]) + LABEL
    for share in np.linspace(0, 1, 50):  # of the arrow, whose head is 6 pixels to either side
        at = start + share * (end - start)
        away = np.hypot(*(at - np.clip(at, low, high)))
        assert away >= TIP_GAP - 1e-9


@pytest.mark.parametrize("end", [(1190.0, 450.0), (10.0, 450.0), (600.0, 895.0), (600.0, 3.0), (1195.0, 895.0)])
def test_near_the_edge_the_label_stays_in_the_window(end: tuple[float, float]) -> None:
    left, bottom = beside_tip((600.0, 450.0), end, LABEL, WINDOW)
    assert 0 <= left <= WINDOW[0] - LABEL[0] and 0 <= bottom <= WINDOW[1] - LABEL[1]


# ---------------------------------------------------------------------- lines and detail


@pytest.mark.parametrize(
    "text,parts,expected",
    [("a\nb\nc", 3, ["a", "b", "c"]), ("a\nb\nc", 2, ["a", "b\nc"]), ("a", 3, ["a", "", ""]), ("a\nb", 1, ["a\nb"])],
)
def test_lines_go_to_their_styles(text: str, parts: int, expected: list[str]) -> None:
    assert divided(text, parts) == expected


@pytest.mark.parametrize(
    "renderer,detail",
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", QUICK),
        ("softpipe", QUICK),
        ("SwiftShader Device (LLVM 10.0.0)", QUICK),
        ("NVIDIA H200/PCIe/SSE2", FINE),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", FINE),
    ],
)
def test_a_processor_that_draws_is_asked_for_less(renderer: str, detail: object) -> None:
    assert usual_detail(renderer) is detail


def test_the_key_goes_through_every_detail_and_costs_fall() -> None:
    found = [FINE]
    for _ in DETAILS:
        found.append(next_detail(found[-1]))
    assert set(found) == set(DETAILS) and found[0] is found[-1]
    costs = [(max(detail.samples, 1) / detail.coarse**2, detail.shadows) for detail in DETAILS]
    assert costs == sorted(costs, reverse=True) and len(set(costs)) == len(costs)


@pytest.mark.parametrize("bodies", [False, True])
def test_the_keys_of_space_name_the_detail_and_the_turn_once(bodies: bool) -> None:
    text = keys_text(600, "bodies" if bodies else "sheet", space=True)
    assert text.count("picture fine, plain, quick") == 1 and text.count("rotate (middle)") == 1
    assert "fine, plain" not in keys_text(600)


# ---------------------------------------------------------------------- what keys change of the look


class SeenView:
    """A view that only knows what it shows."""

    def __init__(self) -> None:
        self.detail, self.lines, self.skin = FINE, False, True
        self.particles = self.clusters = self.links = False
        self.subject, self.colourings = "sheet", ()
        self.show_in = lambda detail: setattr(self, "detail", detail)

    def toggle_lines(self) -> bool:
        self.lines = not self.lines
        return self.lines

    def toggle(self, name: str) -> None:
        setattr(self, name, not getattr(self, name))

    def shows(self, name: str) -> bool:
        return bool(getattr(self, name))


def looks_of(dimensions: int, bodies: bool) -> tuple[ViewOptions, list[str]]:
    said: list[str] = []
    scene = SimpleNamespace(dimensions=dimensions, bodies={"star": None} if bodies else {})
    demo = SimpleNamespace(world=SimpleNamespace(scene=scene), say=said.append)
    return ViewOptions(cast("Any", demo), [SeenView(), SeenView()]), said


def test_keys_of_bodies_and_of_space_say_where_they_mean_nothing() -> None:
    for dimensions, told in ((2, OF_PLANE), (3, "surface")):
        looks, said = looks_of(dimensions, bodies=False)
        looks.toggle("particles")
        looks.next_colouring()
        looks.toggle_lines()
        looks.toggle_lines()
        assert said[:2] == [NO_BODIES] * 2 and said[-1] == told


def test_the_look_changes_in_every_view() -> None:
    looks, said = looks_of(3, bodies=True)
    looks.next_detail()
    looks.toggle("particles")
    assert [(view.detail, view.particles) for view in looks.views] == [(DETAILS[1], True)] * 2
    assert said == [f"picture quality plain: {DETAILS[1].meaning}", "particles behind the skin"]


# ---------------------------------------------------------------------- the ends of legends, and when nothing is drawn


def test_the_ends_of_a_legend_are_open() -> None:
    assert range_texts(1.0, levels=False) == ["\u2264 \u22121", "\u22120.5", "0", "+0.5", "\u2265 +1"]
    assert range_texts(20.0, levels=True) == ["0", "5", "10", "15", "\u2265 20"]


def test_a_paused_window_is_drawn_when_something_changed_alone() -> None:
    """Some frames after each touch, one at least after a message is over, and all where something moves."""
    heard: dict[str, Any] = {}
    demo = SimpleNamespace(
        paused=True, frozen=False, compiling=None, message_count=0, picker=SimpleNamespace(poke=None)
    )
    panel, shots = SimpleNamespace(open=False, takes_keys=False), SimpleNamespace(recording=False)
    window = SimpleNamespace(push_handlers=lambda **handlers: heard.update(handlers))
    still = IdleRedraw(cast(Any, SimpleNamespace(demo=demo, panel=panel, shots=shots, window=window)))

    def drawn(now: float = 0.0) -> int:
        return sum(still.wanted(now) for _ in range(2 * SETTLE))

    assert drawn() == SETTLE and drawn() == 0
    for name in TOUCHES:
        assert heard[name]() is None and drawn() == SETTLE, name  # None: others hear of it, too
    heard["on_mouse_motion"](3, 4, 1, 1)
    assert drawn() == 0
    panel.open = True
    heard["on_mouse_motion"](3, 4, 1, 1)
    assert drawn() == SETTLE and drawn() == 0
    demo.message_count += 1
    assert drawn() == SETTLE and drawn() == 0
    assert drawn(1.01 * MESSAGE_SECONDS) == SETTLE and drawn(2 * MESSAGE_SECONDS) == 0
    for whose, name, value in ((demo, "paused", False), (shots, "recording", True), (panel, "takes_keys", True)):
        before = getattr(whose, name)
        setattr(whose, name, value)
        assert drawn() == 2 * SETTLE, name
        setattr(whose, name, before)
        drawn()
    demo.picker.poke = object()
    assert drawn() == 2 * SETTLE
