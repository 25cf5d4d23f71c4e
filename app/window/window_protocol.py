"""Interface of the window for keys, mouse and overlay."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

from softlab.app.render.camera import Camera
from softlab.app.render.view import View
from softlab.app.window.demo import Demo
from softlab.app.window.frame_times import FrameTimes
from softlab.app.window.panes import Pane
from softlab.app.window.shots import Shots
from softlab.app.window.view_options import ViewOptions
from softlab.model.base.components import component
from softlab.model.base.errors import BackendUnavailable, Diverged
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    from pyglet.window import BaseWindow

PANEL = "softlab.app.window.panel.panel:Panel"  # an optional component

Judge = Callable[[Scene, State, Diverged | None], tuple[float | None, str | None]]


class Toggles(Protocol):
    """Overlays that a key shows or hides."""

    show_keys: bool
    show_graph: bool
    show_numbers: bool
    times: FrameTimes

    def toggle_keys(self) -> None: ...
    def toggle_graph(self) -> None: ...
    def toggle_numbers(self) -> None: ...


class Taking(Protocol):
    """Receives keys and mouse before the scene (app/window/panel/panel.py)."""

    open: bool

    @property
    def takes_keys(self) -> bool: ...
    def toggle(self) -> None: ...
    def key(self, symbol: int, down: bool) -> bool: ...
    def text(self, text: str) -> bool: ...
    def moved(self, x: float, y: float) -> bool: ...
    def pressed(self, x: float, y: float, button: int) -> bool: ...
    def released(self, button: int) -> bool: ...
    def scrolled(self, x: float, y: float, across: float, up: float) -> bool: ...


class Panel(Taking, Protocol):
    """The panel of the window, `width` pixels wide while it is open, or what stands for it."""

    @property
    def width(self) -> int: ...
    def lay_out(self) -> None: ...
    def draw(self) -> None: ...
    def widget_places(self) -> Mapping[str, Sequence[float]] | None: ...
    def close(self) -> None: ...


class WindowProtocol(Protocol):
    """The window over a Demo (app/window/viewer.py): `space`, `bodies`: it shows three dimensions, bodies; `width`,
    `height` in frame-buffer pixels, of which the scene has the left `shown_width` and the panel the rest; `follow`: the
    camera follows the motion; `frame_seconds`, `draw_seconds` [s] of the last frame; `drawn_by`: by software, or
    nothing; `judge`: returns the error of a state, or the reason why none is known."""

    pyglet: ModuleType
    demo: Demo
    window: BaseWindow
    space: bool
    bodies: bool
    views: list[View]
    panes: list[Pane]
    camera: Camera
    view_options: ViewOptions
    follow: bool
    frame_seconds: float
    draw_seconds: float
    drawn_by: str
    width: int
    height: int
    shown_width: int
    shots: Shots
    judge: Judge | None

    @property
    def overlay(self) -> Toggles: ...
    @property
    def panel(self) -> Taking: ...
    def frame_everything(self) -> None: ...
    def close(self) -> bool: ...
    def world_at(self, x: float, y: float) -> int: ...
    def drop_place(self, x: float, y: float) -> tuple[float, float, float]: ...


def panel_of(viewer: WindowProtocol) -> Panel:
    """Return the panel of a window, or a substitute for it: closed, and A says what to install."""
    try:
        panel: Panel = component(PANEL, "the panel")(viewer)
        return panel
    except BackendUnavailable as missing:
        return WithoutPanel(viewer, str(missing))


class WithoutPanel:
    """Stands in for the panel (`Panel` of app/window/panel/panel.py) if there is none."""

    open, width, takes_keys = False, 0, False

    def __init__(self, viewer: WindowProtocol, missing: str):
        self._viewer, self._missing = viewer, missing

    def toggle(self) -> None:
        self._viewer.demo.say(self._missing)

    def _leave(self, *_: object) -> bool:
        """Take neither keys nor mouse."""
        return False

    key = text = moved = pressed = released = scrolled = _leave

    def lay_out(self) -> None: ...

    def draw(self) -> None: ...

    def widget_places(self) -> None: ...

    def close(self) -> None: ...
