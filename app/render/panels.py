"""What lies over the picture: the legend of strain, panels of text, an arrow for a force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from app.render import colours
from model.core.build import pinned_indices
from model.scene.scene import Scene

FONTS = ["DejaVu Sans", "Helvetica Neue", "Segoe UI", "Arial"]
MONOSPACED = ["DejaVu Sans Mono", "Menlo", "Consolas", "Courier New"]
MINUS = "\N{MINUS SIGN}"
STRAIN_TITLE = f"strain of a spring: (length {MINUS} rest) / rest"
EDGE_TITLE = f"strain of an edge: (length {MINUS} rest) / rest"
ZERO_REST_TITLE = "strain of a spring: length / spacing"
Pair = tuple[float, float]
TIP_GAP = 18.0  # pixels from an arrow's tip, where the pointer is, to its label
EDGE = (0.75, 0.77, 0.80)
LEGEND_WIDTH, LEGEND_HEIGHT, LEGEND_PARTS = 260, 14, 64  # pixels, pixels, rectangles


def rgba(colour: tuple[float, float, float], alpha: int = 255) -> tuple[int, int, int, int]:
    """A colour of app/render/colours.py as pyglet takes it."""
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue, alpha


class Legend:
    """The bar of colours with its numbers, at the lower right corner: of strains, from minus the range to it, or, where
    `levels`, of what has no sign. Made once; `place` and `draw` for each frame."""

    def __init__(self, has_pins: bool, title: str = STRAIN_TITLE, levels: bool = False) -> None:
        import pyglet

        self._batch = pyglet.graphics.Batch()
        self._shown: tuple[int, float, str] | None = None
        self._levels = levels
        middles = (np.arange(LEGEND_PARTS) + 0.5) / LEGEND_PARTS
        shown = colours.level_colours(middles, 1.0) if levels else colours.strain_colours(2 * middles - 1, 1.0)
        part = LEGEND_WIDTH / LEGEND_PARTS
        self._back = pyglet.shapes.Rectangle(
            0, 0, LEGEND_WIDTH + 44, 84 if has_pins else 64, (255, 255, 255, 225), batch=self._batch
        )
        self._bars = [
            pyglet.shapes.Rectangle(0, 0, part + 0.5, LEGEND_HEIGHT, rgba(tuple(colour)), batch=self._batch)
            for colour in shown
        ]
        self._title = self._label(title, "center")
        self._numbers = [self._label("", "center") for _ in range(5)]
        self._pin_mark = pyglet.shapes.Rectangle(0, 0, 8, 8, rgba(colours.PIN), batch=self._batch) if has_pins else None
        self._pin_text = self._label("pinned mass", "left") if has_pins else None

    def _label(self, text: str, anchor: Any) -> Any:
        import pyglet

        return pyglet.text.Label(
            text, font_name=FONTS, font_size=9, color=rgba(colours.INK), anchor_x=anchor, batch=self._batch
        )

    def place(self, width: int, most: float, title: str = "") -> None:
        """Put it at the lower right of a window `width` pixels wide, with this range at its ends; under a `title`, if any."""
        if self._shown == (width, most, title):
            return
        self._shown = (width, most, title)
        self._title.text = title or self._title.text
        left, bottom = width - LEGEND_WIDTH - 34, 28
        self._back.position = (left - 22, bottom - 22)
        for k, bar in enumerate(self._bars):
            bar.position = (left + k * LEGEND_WIDTH / LEGEND_PARTS, bottom)
        for k, label in enumerate(self._numbers):
            value = most * (k / 4 if self._levels else (k - 2) / 2)
            label.text = "0" if value == 0 else f"{value:.3g}" if self._levels else f"{value:+.3g}".replace("-", MINUS)
            label.position = (left + k * LEGEND_WIDTH / 4, bottom - 14, 0)
        self._title.position = (left + LEGEND_WIDTH / 2, bottom + LEGEND_HEIGHT + 8, 0)
        if self._pin_mark is not None and self._pin_text is not None:
            self._pin_mark.position = (left + LEGEND_WIDTH / 2 - 44, bottom + LEGEND_HEIGHT + 27)
            self._pin_text.position = (left + LEGEND_WIDTH / 2 - 30, bottom + LEGEND_HEIGHT + 27, 0)

    def draw(self) -> None:
        """Draw it."""
        self._batch.draw()


class Legends:
    """The legends that a scene may need: of the strain of what is drawn as lines, and of levels."""

    def __init__(self, scene: Scene) -> None:
        self._strain = legend_of(scene)
        self._levels = (
            Legend(len(pinned_indices(scene.grid)) > 0, levels=True) if scene.tetrahedra or scene.fluids else None
        )

    def needed(self, view: Any) -> bool:
        """Whether one goes with what a view shows."""
        return self._chosen(view) is not None

    def _chosen(self, view: Any) -> Legend | None:
        if self._levels is not None and view.level_legend() is not None:
            return self._levels
        return self._strain if view.lines else None

    def draw(self, view: Any, width: int, strain_range: float) -> None:
        """The one that goes with what a view shows, if any, in a window `width` pixels wide."""
        chosen = self._chosen(view)
        if chosen is None:
            return
        levels = view.level_legend()
        if levels is None:
            chosen.place(width, strain_range)
        else:
            chosen.place(width, levels[1], levels[0])
        chosen.draw()


def legend_of(scene: Scene) -> Legend | None:
    """The legend of strains that a scene needs; None without springs and tetrahedra."""
    if scene.tetrahedra:
        return Legend(len(pinned_indices(scene.grid)) > 0, EDGE_TITLE)
    if not scene.springs and not scene.cloth_springs:
        return None
    title = ZERO_REST_TITLE if scene.springs and not scene.springs.rest_length else STRAIN_TITLE
    return Legend(len(pinned_indices(scene.grid)) > 0, title)


@dataclass(frozen=True)
class Style:
    """How text looks: its size in points, its colour."""

    size: int = 10
    bold: bool = False
    monospaced: bool = True
    colour: tuple[float, float, float] = colours.INK


class Panel:
    """Lines of text on a light ground. `corner`: where in the window, `top-left`, `bottom-left` or `centre`. `styles`: of the
    first line, the next ...; all lines that are left over have the last."""

    def __init__(self, corner: str, *styles: Style, edge: tuple[float, float, float] = EDGE) -> None:
        import pyglet

        self.corner = corner
        self._batch = pyglet.graphics.Batch()
        self._back = pyglet.shapes.BorderedRectangle(
            0, 0, 10, 10, border=1, color=(255, 255, 255, 232), border_color=rgba(edge, 232), batch=self._batch
        )
        self._labels = [
            pyglet.text.Label(
                "", font_name=MONOSPACED if style.monospaced else FONTS, font_size=style.size, color=rgba(style.colour),
                weight="bold" if style.bold else "normal", multiline=True, width=100, anchor_x="left", anchor_y="top",
                batch=self._batch,
            )
            for style in styles or (Style(),)
        ]  # fmt: skip
        self._shown: tuple[str, int, int, int] | None = None
        self.height = 0

    def place(self, text: str, width: int, height: int, below: int = 0, beside: int = 0) -> None:
        """Lay out `text` in a window of this size, `below` pixels lower than its corner and `beside` to the right of it. Free
        if nothing changed."""
        if self._shown == (text, width, height - below, beside):
            return
        self._shown = (text, width, height - below, beside)
        for label, part in zip(self._labels, divided(text, len(self._labels)), strict=True):
            label.begin_update()
            label.width = max(width - 40, 80)  # longer lines are wrapped
            label.text = part
            label.end_update()
        heights = [label.content_height if label.text else 0 for label in self._labels]
        wide, high = max(label.content_width for label in self._labels), sum(heights)
        left = 8 if self.corner.endswith("left") else (width - wide) // 2 - 8  # whole pixels, or its border blurs
        if self.corner == "bottom-left":
            top = high + 20
        elif self.corner == "centre":
            top = (height + high) // 2 + 8
        else:
            top = height - 8 - below
        left += beside
        self._back.position = (left, top - high - 12)
        self._back.width, self._back.height = wide + 16, high + 12
        for number, label in enumerate(self._labels):
            label.position = (left + 8, top - 6 - sum(heights[:number]), 0)
        self.height = int(high + 12)

    def draw(self) -> None:
        """Draw it."""
        self._batch.draw()


def divided(text: str, parts: int) -> list[str]:
    """Its lines, one a part, all that are left over in the last."""
    lines = text.split("\n", parts - 1)
    return lines + [""] * (parts - len(lines))


def beside_tip(start: Pair, end: Pair, size: Pair, window: Pair) -> Pair:
    """The lower left corner of a label of `size` for an arrow from `start` to `end` in a `window` (all pixels): beyond the
    tip, clear of it and of the pointer there; where that is outside of the window, beside the arrow, behind its tip; inside
    of it in any case."""
    half, middle = np.asarray(size) / 2, np.asarray(end, dtype=float)
    along = np.subtract(end, start) / max(float(np.hypot(*np.subtract(end, start))), 1e-9)
    across = np.array([-along[1], along[0]])
    ahead, aside = (float(np.abs(way) @ half) for way in (along, across))  # how far the label reaches from its middle
    beside = [-ahead * along + side * (TIP_GAP + aside) * across for side in (1, -1)]
    places: list[Pair] = []
    for away in ((TIP_GAP + ahead) * along, *beside):
        x, y = (middle + away - half).tolist()
        places.append((x, y))
    inside = (p for p in places if all(0 <= p[k] <= window[k] - size[k] for k in (0, 1)))
    left, bottom = (min(max(places[1][k], 0.0), window[k] - size[k]) for k in (0, 1))
    return next(inside, (left, bottom))


class Arrow:
    """The poke: an arrow from the mass with the force beside it."""

    def __init__(self) -> None:
        import pyglet

        self._batch = pyglet.graphics.Batch()
        colour = rgba(colours.POKE)
        self._line = pyglet.shapes.Line(0, 0, 1, 1, 3, colour, batch=self._batch)
        self._head = pyglet.shapes.Triangle(0, 0, 1, 0, 0, 1, colour, batch=self._batch)
        self._label = pyglet.text.Label(
            "", font_name=FONTS, font_size=10, color=colour, batch=self._batch, weight="bold", anchor_y="bottom"
        )

    def draw(self, start: Pair, end: Pair, text: str, window: Pair) -> None:
        """Draw it from `start` to `end` in a `window` (pixels)."""
        along = np.subtract(end, start)
        size = float(np.hypot(*along))
        if not 1 < size < 1e5:
            return
        along = along / size
        side = np.array([-along[1], along[0]])
        neck = np.asarray(end) - along * min(12.0, size)
        self._line.position = start
        self._line.x2, self._line.y2 = neck
        tips = [np.asarray(end, dtype=float), neck + 6 * side, neck - 6 * side]
        self._head.x, self._head.y = tips[0]
        self._head.x2, self._head.y2 = tips[1]
        self._head.x3, self._head.y3 = tips[2]
        if self._label.text != text:
            self._label.text = text
        text_size = self._label.content_width, self._label.content_height
        self._label.position = (*beside_tip(start, end, text_size, window), 0)
        self._batch.draw()
