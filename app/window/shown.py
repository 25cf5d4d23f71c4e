"""What keys, mouse and overlay ask of the window they belong to."""

from __future__ import annotations

from typing import Any, Protocol

from app.window.demo import Demo
from app.window.looks import Looks
from app.window.panes import Pane


class Toggles(Protocol):
    """What a key shows or hides over the picture."""

    def toggle_keys(self) -> None: ...
    def toggle_graph(self) -> None: ...
    def toggle_numbers(self) -> None: ...


class Shown(Protocol):
    """The window over a Demo (app/window/viewer.py): `space`, `bodies`: whether it shows three dimensions, and bodies;
    `width`, `height` in frame-buffer pixels; `follow`: whether the camera goes with what is to be seen; `frame_seconds`,
    `draw_seconds` [s] of the last frame; `drawn_by`: by software, or nothing."""

    pyglet: Any
    demo: Demo
    window: Any
    space: bool
    bodies: bool
    views: list[Any]
    panes: list[Pane]
    camera: Any
    looks: Looks
    follow: bool
    frame_seconds: float
    draw_seconds: float
    drawn_by: str
    width: int
    height: int

    @property
    def overlay(self) -> Toggles: ...
    def frame_everything(self) -> None: ...
    def ask_for_screenshot(self) -> None: ...
    def close(self) -> bool: ...
    def world_at(self, x: float, y: float) -> int: ...
    def drop_place(self, x: float, y: float) -> tuple[float, float, float]: ...
