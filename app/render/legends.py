"""The legends of colours at the lower right of a picture: of strains, of levels, of names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.render import colours
from softlab.app.render.panels import FONTS, rgba
from softlab.app.render.view import View
from softlab.model.core.build import pinned_indices
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    from pyglet.text import Label

MINUS = "\N{MINUS SIGN}"
STRAIN_TITLE = f"strain of a spring: (length {MINUS} rest) / rest"
EDGE_TITLE = f"strain of an edge: (length {MINUS} rest) / rest"
ZERO_REST_TITLE = "strain of a spring: length / spacing"
AT_MOST, AT_LEAST = "\N{LESS-THAN OR EQUAL TO}", "\N{GREATER-THAN OR EQUAL TO}"  # what is beyond an end has its colour
LEGEND_WIDTH, LEGEND_HEIGHT, LEGEND_PARTS = 260, 14, 64  # pixels, pixels, rectangles
LEGEND_SPACE = 72  # pixels, that a bar of colours takes
ROW, CHIP = 18, 12  # pixels, of a legend of names
Named = Sequence[tuple[str, tuple[float, float, float]]]  # a name and its colour


class Legend:
    """The colour bar with its numbers at the lower right corner: of strains, from minus to plus the range, or, with
    `levels`, from 0. Created once; `place` and `draw` are called for each frame."""

    def __init__(self, has_pins: bool, title: str = STRAIN_TITLE, levels: bool = False) -> None:
        import pyglet

        self._batch = pyglet.graphics.Batch()
        self._shown: tuple[int, float, str] | None = None
        self._levels = levels
        middles = (np.arange(LEGEND_PARTS) + 0.5) / LEGEND_PARTS
        shown = colours.level_colours(middles, 1.0) if levels else colours.strain_colours(2 * middles - 1, 1.0)
        part = LEGEND_WIDTH / LEGEND_PARTS
        self._back = pyglet.shapes.Rectangle(
            0, 0, LEGEND_WIDTH + 60, 84 if has_pins else 64, (255, 255, 255, 225), batch=self._batch
        )
        self._bars = [
            pyglet.shapes.Rectangle(0, 0, part + 0.5, LEGEND_HEIGHT, rgba(tuple(colour)), batch=self._batch)
            for colour in shown
        ]
        self._title = self._label(title, "center")
        self._numbers = [self._label("", "center") for _ in range(5)]
        self._pin_mark = pyglet.shapes.Rectangle(0, 0, 8, 8, rgba(colours.PIN), batch=self._batch) if has_pins else None
        self._pin_text = self._label("pinned mass", "left") if has_pins else None

    def _label(self, text: str, anchor: Literal["left", "center", "right"]) -> Label:
        import pyglet

        return pyglet.text.Label(
            text, font_name=FONTS, font_size=9, color=rgba(colours.INK), anchor_x=anchor, batch=self._batch
        )

    def place(self, width: int, most: float, title: str = "") -> None:
        """Place the bar at the lower right of a window of `width` pixels, for strains from `-most` or levels from 0 to
        `most`."""
        if self._shown == (width, most, title):
            return
        self._shown = (width, most, title)
        self._title.text = title or self._title.text
        left, bottom = width - LEGEND_WIDTH - 42, 28
        self._back.position = (left - 30, bottom - 22)
        for k, bar in enumerate(self._bars):
            bar.position = (left + k * LEGEND_WIDTH / LEGEND_PARTS, bottom)
        numbers = range_texts(most, self._levels)
        for k, (label, number) in enumerate(zip(self._numbers, numbers, strict=True)):
            label.text = number
            label.position = (left + k * LEGEND_WIDTH / 4, bottom - 14, 0)
        self._title.position = (left + LEGEND_WIDTH / 2, bottom + LEGEND_HEIGHT + 8, 0)
        if self._pin_mark is not None and self._pin_text is not None:
            self._pin_mark.position = (left + LEGEND_WIDTH / 2 - 44, bottom + LEGEND_HEIGHT + 27)
            self._pin_text.position = (left + LEGEND_WIDTH / 2 - 30, bottom + LEGEND_HEIGHT + 27, 0)

    def draw(self) -> None:
        """Draw it."""
        self._batch.draw()


def range_texts(most: float, levels: bool) -> list[str]:
    """Return five numbers along a bar of colours: of strains from `-most`, of `levels` from 0, to `most`. Values beyond
    the ends have the colour of the end."""
    values = [most * (k / 4 if levels else (k - 2) / 2) for k in range(5)]
    texts = ["0" if v == 0 else f"{v:.3g}" if levels else f"{v:+.3g}".replace("-", MINUS) for v in values]
    return [texts[0] if levels else f"{AT_MOST} {texts[0]}", *texts[1:-1], f"{AT_LEAST} {texts[-1]}"]


class NameLegend:
    """A legend with one row per name, a patch of colour and the name, at the lower right corner. `named`: the names and
    colours."""

    def __init__(self, named: Named) -> None:
        import pyglet

        self.named, self._batch = named, pyglet.graphics.Batch()
        self._shown: tuple[int, int] | None = None
        self._back = pyglet.shapes.Rectangle(0, 0, 10, ROW * len(named) + 12, (255, 255, 255, 225), batch=self._batch)
        self._edges = [pyglet.shapes.Rectangle(0, 0, CHIP, CHIP, rgba(colours.FAINT), batch=self._batch) for _ in named]
        self._chips = [
            pyglet.shapes.Rectangle(0, 0, CHIP - 2, CHIP - 2, rgba(colour), batch=self._batch) for _, colour in named
        ]
        self._labels = [
            pyglet.text.Label(name, font_name=FONTS, font_size=9, color=rgba(colours.INK), batch=self._batch)
            for name, _ in named
        ]

    def place(self, width: int, above: int) -> None:
        """Place the legend at the lower right of a window of `width` pixels, `above` pixels higher than its corner."""
        if self._shown == (width, above):
            return
        self._shown = (width, above)
        wide = max(label.content_width for label in self._labels) + CHIP + 26
        left, bottom = width - wide - 8, 8 + above
        self._back.position, self._back.width = (left, bottom), wide
        rows = zip(self._edges, self._chips, self._labels, strict=True)
        for number, (edge, chip, label) in enumerate(rows):
            y = bottom + 8 + ROW * (len(self.named) - 1 - number)
            edge.position, chip.position, label.position = (
                (left + 9, y),
                (left + 10, y + 1),
                (left + 16 + CHIP, y + 2, 0),
            )

    def draw(self) -> None:
        """Draw it."""
        self._batch.draw()


class Legends:
    """The legends that a scene may need: of the strain of what is drawn as lines, of levels, and of names."""

    def __init__(self, scene: Scene) -> None:
        self._strain = legend_of(scene)
        self._names: NameLegend | None = None
        self._levels = (
            Legend(len(pinned_indices(scene.grid)) > 0, levels=True) if presentation_of(scene).levels else None
        )

    def needed(self, view: View) -> bool:
        """Return True if a legend belongs to what a view shows, or will show once it has a state."""
        return view.shows_levels or self._chosen(view) is not None or bool(view.name_legend())

    def _chosen(self, view: View) -> Legend | None:
        if self._levels is not None and view.level_legend() is not None:
            return self._levels
        return self._strain if view.lines else None

    def _draw_names(self, named: Named, width: int, above: int) -> None:
        if not named:
            return
        if self._names is None or self._names.named != named:
            self._names = NameLegend(named)
        self._names.place(width, above)
        self._names.draw()

    def draw(self, view: View, width: int, strain_range: float) -> None:
        """Draw the legends of a view, if any, in a window `width` pixels wide."""
        chosen = self._chosen(view)
        self._draw_names(view.name_legend(), width, 0 if chosen is None else LEGEND_SPACE)
        if chosen is None:
            return
        levels = view.level_legend()
        if levels is None:
            chosen.place(width, strain_range)
        else:
            chosen.place(width, levels[1], levels[0])
        chosen.draw()


def legend_of(scene: Scene) -> Legend | None:
    """Return the legend of strains that a scene needs; None without strains."""
    title = presentation_of(scene).legend(scene)
    return None if title is None else Legend(len(pinned_indices(scene.grid)) > 0, title)
