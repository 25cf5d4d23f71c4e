"""The arguments of every section of the panel."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.app.window.demo import Demo
from softlab.app.window.panel.sliders import Sliders
from softlab.app.window.panel.state import PanelState
from softlab.app.window.panel.style import PanelStyle
from softlab.app.window.window_protocol import WindowProtocol


@dataclass(frozen=True)
class PanelFrame:
    """The `rows` that are laid out for a `viewer`, their `style`, and the panel's `state`, which persists between
    frames."""

    rows: Sliders
    viewer: WindowProtocol
    style: PanelStyle
    state: PanelState

    @property
    def demo(self) -> Demo:
        """The demo that the panel controls."""
        return self.viewer.demo
