"""The window where the panel of settings, an optional component (app/window/panel), is not installed."""

from __future__ import annotations

from typing import Any

from softlab.app.window.shown import Shown
from softlab.model.core.components import component
from softlab.model.core.errors import BackendUnavailable

PANEL = "softlab.app.window.panel.panel:Panel"


def panel_of(viewer: Shown) -> Any:
    """Return the panel of a window, or what stands for it: closed, and A says what to install."""
    try:
        return component(PANEL, "the panel")(viewer)
    except BackendUnavailable as missing:
        return WithoutPanel(viewer, str(missing))


class WithoutPanel:
    """What a window asks of its panel (`Panel` of app/window/panel/panel.py), where there is none."""

    open, width, takes_keys = False, 0, False

    def __init__(self, viewer: Shown, missing: str):
        self._viewer, self._missing = viewer, missing

    def toggle(self) -> None:
        self._viewer.demo.say(self._missing)

    def _leave(self, *_: Any) -> bool:
        """Take neither keys nor mouse."""
        return False

    key = text = moved = pressed = released = scrolled = _leave

    def lay_out(self) -> None: ...

    def draw(self) -> None: ...

    def told(self) -> None: ...

    def close(self) -> None: ...
