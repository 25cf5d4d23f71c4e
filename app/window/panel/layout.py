"""Layout of the panel: a fixed head with the time and the play button, and below it sections that open and close."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from softlab.app.window.panel.sections.fields import parameters
from softlab.app.window.panel.sections.files import files
from softlab.app.window.panel.sections.frame import PanelFrame
from softlab.app.window.panel.sections.itself import itself
from softlab.app.window.panel.sections.layers import layers
from softlab.app.window.panel.sections.machine import machine
from softlab.app.window.panel.sections.measured import measured
from softlab.app.window.panel.sections.running import head
from softlab.app.window.panel.sections.scene import scene
from softlab.app.window.panel.sections.view import view
from softlab.app.window.panel.sliders import Sliders
from softlab.app.window.panel.state import PanelState
from softlab.app.window.panel.style import PanelStyle
from softlab.app.window.window_protocol import WindowProtocol

SECTIONS: tuple[tuple[str, Callable[[PanelFrame], None], bool], ...] = (
    ("Scene", scene, True),
    ("Parameters", parameters, True),
    ("Measured", measured, True),
    ("Layers", layers, False),
    ("View", view, False),
    ("Machine", machine, False),
    ("Files", files, False),
    ("Panel", itself, False),
)  # name, what it holds, whether it is open at first


class Layout:
    """The panel over a viewer; `draw` lays out a frame of it. `every`: all sections are open at first."""

    def __init__(
        self, imgui: ModuleType, viewer: WindowProtocol, style: PanelStyle, state: PanelState, every: bool = False
    ):
        self.every = state.every = every
        self.imgui, self.viewer, self.style, self.state = imgui, viewer, style, state
        self.frame = PanelFrame(Sliders(imgui, style, state), viewer, style, state)

    def draw(self) -> None:
        """Lay out one frame, at the right of the window."""
        imgui, viewer = self.imgui, self.viewer
        width = viewer.width - viewer.shown_width
        self.state.history.record(viewer.demo.world, viewer.demo.statistics)
        self.state.places.clear()
        fixed = imgui.WindowFlags_
        flags = fixed.no_title_bar | fixed.no_resize | fixed.no_move | fixed.no_collapse | fixed.no_saved_settings
        imgui.set_next_window_pos(imgui.ImVec2(viewer.width - width, 0))
        imgui.set_next_window_size(imgui.ImVec2(width, viewer.height))
        imgui.begin("panel", None, int(flags | fixed.no_scrollbar | fixed.no_scroll_with_mouse))
        head(self.frame)
        imgui.separator()
        imgui.begin_child("sections", imgui.ImVec2(0, 0))
        for name, section, opened in SECTIONS:
            imgui.set_next_item_open(opened or self.every, int(imgui.Cond_.once))
            imgui.push_font(self.style.bold, 15.0)
            shown = imgui.collapsing_header(name)
            imgui.pop_font()
            self.frame.rows.record_place(f"section {name}")
            if shown:
                imgui.indent(6 * self.style.unit)
                section(self.frame)
                self.frame.rows.gap(6)
                imgui.unindent(6 * self.style.unit)
        imgui.end_child()
        self.state.cancels = False
        imgui.end()
