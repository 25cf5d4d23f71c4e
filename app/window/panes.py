"""Scenes side by side: which can be, what each is called, and where in the window it is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, sqrt

from model.core.errors import SceneError
from model.scene.scene import Scene

MAX_WORLDS = 9
IN_A_ROW = 3  # as many stand beside each other; more in as many columns as rows
GAP = 2  # pixels between two


def check_alike(scenes: Sequence[Scene]) -> None:
    """Raises SceneError if scenes cannot be shown side by side: one camera and one hand are to do for all of them."""
    if not 1 <= len(scenes) <= MAX_WORLDS:
        raise SceneError("SCENE", f"{len(scenes)} scenes", f"side by side can be 1 to {MAX_WORLDS}")
    first = _look(scenes[0])
    for scene in scenes:
        if _look(scene) != first:
            raise SceneError(
                "SCENE",
                scene.name,
                f"side by side with {scenes[0].name} must be {first}; {scene.name} is {_look(scene)}",
            )


def _look(scene: Scene) -> str:
    if scene.bodies:
        return "bodies"
    if scene.fluids:
        return f"a fluid in {scene.dimensions} dimensions"
    return "masses in a plane" if scene.dimensions == 2 else "masses in space"


def titles_of(scenes: Sequence[Scene]) -> list[str]:
    """What scenes are called side by side: their titles, numbered where several have the same."""
    titles = [scene.title for scene in scenes]
    return [
        title if titles.count(title) == 1 else f"{title} ({titles[: place + 1].count(title)})"
        for place, title in enumerate(titles)
    ]


@dataclass(frozen=True)
class Pane:
    """A rectangle of the window, in frame-buffer pixels; `left` and `bottom` from its lower left corner."""

    left: int
    bottom: int
    width: int
    height: int

    def away(self, x: float, y: float) -> float:
        """Pixels from a place in the window, the larger of across and up; 0 inside."""
        return max(self.left - x, x - self.left - self.width, self.bottom - y, y - self.bottom - self.height, 0.0)


def panes(count: int, width: int, height: int) -> list[Pane]:
    """Equal rectangles for so many worlds in this part of a window, from its lower edge, in rows from the upper left."""
    columns = count if count <= IN_A_ROW else ceil(sqrt(count))
    rows = ceil(count / columns)
    wide, high = (width - GAP * (columns - 1)) // columns, (height - GAP * (rows - 1)) // rows
    return [
        Pane(ceil(column * (width + GAP) / columns), height - high - ceil(row * (height + GAP) / rows), wide, high)
        for row, column in (divmod(number, columns) for number in range(count))
    ]
