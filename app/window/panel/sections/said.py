"""What every section of the panel is given."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.app.window.demo import Demo
from softlab.app.window.panel.look import Look
from softlab.app.window.panel.sliders import Sliders
from softlab.app.window.panel.state import PanelState
from softlab.app.window.shown import Shown


@dataclass(frozen=True)
class Said:
    """The `rows` that are laid out, of a `viewer`, in a `look`, and what the panel remembers, its `state`."""

    rows: Sliders
    viewer: Shown
    look: Look
    state: PanelState

    @property
    def demo(self) -> Demo:
        """What is steered."""
        return self.viewer.demo
