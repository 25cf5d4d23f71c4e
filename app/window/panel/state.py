"""What the panel remembers between two frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from app.window.panel.history import History


@dataclass
class PanelState:
    """`pending`: dotted path -> value of what is being changed and is given to the scene when it is let go; `history`: of
    energy and momentum; `error`: what was told of it last; `scene_file`, `state_file`: what is typed as the names of
    files; `places`: (left, top, right, bottom) [pixels] of what was laid out last, by name; `every`:
    whether what can be opened is open at first; `cancels`: a list of words is to close."""

    pending: dict[str, Any] = field(default_factory=dict)
    history: History = field(default_factory=History)
    error: str = ""
    scene_file: str = ""
    state_file: str = ""
    every: bool = False
    cancels: bool = False
    places: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
