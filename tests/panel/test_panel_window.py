"""The panel in the real window, on a virtual screen, with a mouse and a keyboard."""

from __future__ import annotations

from pathlib import Path

import pytest
from real_window import Window, display, needs_display  # noqa: F401

from softlab.app.command.dear_imgui import REMEDY


@pytest.mark.display
@needs_display
def test_a_dragged_slider_of_the_window_changes_gravity(tmp_path: Path, display: str) -> None:  # noqa: F811
    pytest.importorskip("imgui_bundle", reason=f"the panel needs Dear ImGui: {REMEDY}")
    with Window(tmp_path, display) as window:
        window.key("a")
        window.wait("the panel", lambda state: state["panel"] and "gravity.acceleration" in state["panel"])
        left, top, right, bottom = window.frames()["panel"]["gravity.acceleration"]
        middle = (top + bottom) // 2
        window.xdotool("mousemove", left + (right - left) // 3, middle)
        window.frames()
        window.xdotool("mousedown", 1)
        window.frames()
        window.xdotool("mousemove", right - 10, middle)
        said = window.wait("a stronger gravity", lambda state: state["message"].startswith("gravity.acceleration = 2"))
        window.xdotool("mouseup", 1)
        assert said["selected"] is None, "the scene was not pressed"
        left, top, right, bottom = window.frames()["panel"]["gravity.enabled"]
        window.xdotool("mousemove", left + 8, (top + bottom) // 2)
        window.frames()
        window.xdotool("click", 1)
        state = window.wait("gravity", lambda state: state["gravity"])
        fell = window.wait("a fall", lambda later: later["step"] > state["step"] + 100)
        assert fell["mean"][1] < state["mean"][1]
        left, top, right, bottom = window.frames()["panel"]["Duplicate to compare"]
        window.xdotool("mousemove", (left + right) // 2, (top + bottom) // 2)
        window.frames()
        window.xdotool("click", 1)
        both = window.wait("two worlds", lambda state: len(state.get("worlds", ())) == 2)
        assert both["alone"] and both["current"] == 1 and both["worlds"][0]["step"] == both["worlds"][1]["step"] > 0
        window.xdotool("mousemove", 600, 500)
        window.frames()
        window.key("a")
        window.wait("no panel", lambda state: state["panel"] is None)
        window.key("g")
        window.wait("keys that are the scene's again", lambda state: not state["gravity"])
