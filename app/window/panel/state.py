"""State of the panel between two frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from softlab.app.window.panel.history import History
from softlab.app.window.panel.scene_list import Entry

T = TypeVar("T")


@dataclass
class PanelState:
    """`pending`: dotted path -> value that is being changed and is applied to the scene on release; `history`: of
    energy and momentum; `error`: the last message about it; `scene_file`, `state_file`: the typed names of files;
    `places`: (left, top, right, bottom) [pixels] of the widgets of the last layout, by name; `every`: everything is
    open at first; `cancels`: a list of words is to close; `search`: text typed in the open list of scenes, `entries`:
    the scenes that it offers."""

    pending: dict[str, object] = field(default_factory=dict)
    history: History = field(default_factory=History)
    error: str = ""
    scene_file: str = ""
    state_file: str = ""
    every: bool = False
    cancels: bool = False
    search: str = ""
    entries: list[Entry] = field(default_factory=list)
    places: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    _cache: dict[str, tuple[tuple[object, ...], Any]] = field(default_factory=dict)

    def cached(self, name: str, of: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return the result of `make`, recomputed only if one of the objects `of` changed: there are many frames."""
        before, value = self._cache.get(name, ((), None))
        if len(before) != len(of) or any(one is not other for one, other in zip(before, of, strict=True)):
            value = make()
            self._cache[name] = of, value
        return value
