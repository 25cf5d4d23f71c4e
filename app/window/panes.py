"""Scenes side by side: which can be combined, their titles, and their panes of the window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, sqrt

from softlab.model.base.errors import SceneError
from softlab.model.scene.members import members_of
from softlab.model.scene.scene import Scene
from softlab.model.tables.bodies import BODY_KINDS

MAX_WORLDS = 9
IN_A_ROW = 3  # as many stand beside each other; more in as many columns as rows
GAP = 2  # pixels between two


def check_alike(scenes: Sequence[Scene]) -> None:
    """Raise SceneError if the scenes cannot be shown side by side with one camera and one mouse."""
    if not 1 <= len(scenes) <= MAX_WORLDS:
        raise SceneError("SCENE", f"{len(scenes)} scenes", f"1 to {MAX_WORLDS} scenes fit side by side; name fewer")
    first = view_kind(scenes[0])
    for scene in scenes:
        if view_kind(scene) != first:
            raise SceneError(
                "SCENE",
                scene.name,
                f"cannot be shown beside {scenes[0].name}: it shows {view_kind(scene)}, and {scenes[0].name} shows {first}; "
                "choose scenes of one kind",
            )


def view_kind(scene: Scene) -> str:
    """Return the kind of a scene, in words. Scenes side by side must be of one kind."""
    return kind_of_tables(scene.kinds, scene.dimensions)


def kind_of_tables(kinds: Mapping[str, str], fluid_dimensions: int = 3) -> str:
    """Return the kind of a scene from the kinds of its tables by name, without reading its meshes."""
    used = set(kinds.values())
    if used & set(BODY_KINDS) and not members_of(kinds):
        return "bodies"
    if "fluid" in used and not members_of(kinds):
        return f"a fluid in {fluid_dimensions} dimensions"
    return "masses in a plane" if "grid" in used else "masses in space"


def titles_of(scenes: Sequence[Scene]) -> list[str]:
    """Return the titles of scenes side by side, numbered if several are the same."""
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
        """Return the distance in pixels from a place in the window, the larger of both axes; 0 inside."""
        return max(self.left - x, x - self.left - self.width, self.bottom - y, y - self.bottom - self.height, 0.0)


def panes(count: int, width: int, height: int) -> list[Pane]:
    """Return equal rectangles for `count` worlds in this part of a window, in rows from the upper left."""
    columns = count if count <= IN_A_ROW else ceil(sqrt(count))
    rows = ceil(count / columns)
    wide, high = (width - GAP * (columns - 1)) // columns, (height - GAP * (rows - 1)) // rows
    return [
        Pane(ceil(column * (width + GAP) / columns), height - high - ceil(row * (height + GAP) / rows), wide, high)
        for row, column in (divmod(number, columns) for number in range(count))
    ]
