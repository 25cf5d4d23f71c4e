"""Overlays of the picture: panels of text, an arrow for a force. Legends: app/render/legends.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softlab.app.render import colours

FONTS = ["DejaVu Sans", "Helvetica Neue", "Segoe UI", "Arial"]
MONOSPACED = ["DejaVu Sans Mono", "Menlo", "Consolas", "Courier New"]
Pair = tuple[float, float]
TIP_GAP = 18.0  # pixels from an arrow's tip, where the pointer is, to its label
EDGE = (0.75, 0.77, 0.80)


def rgba(colour: tuple[float, float, float], alpha: int = 255) -> tuple[int, int, int, int]:
    """Return a colour of app/render/colours.py in pyglet's form."""
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue, alpha


@dataclass(frozen=True)
class Style:
    """Style of text: its size in points, its colour."""

    size: int = 10
    bold: bool = False
    monospaced: bool = True
    colour: tuple[float, float, float] = colours.INK


class Panel:
    """Lines of text on a light background. `corner`: `top-left`, `bottom-left` or `centre` of the window. `styles`: of
    the first line, the second ...; the last one applies to all further lines."""

    def __init__(
        self, corner: str, styles: Sequence[Style] = (Style(),), edge: tuple[float, float, float] = EDGE
    ) -> None:
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
            for style in styles
        ]  # fmt: skip
        self._shown: tuple[str, int, int, int] | None = None
        self.height = 0

    def place(self, text: str, width: int, height: int, below: int = 0, beside: int = 0) -> None:
        """Lay out `text` in a window of this size, `below` pixels lower than its corner and `beside` to the right of
        it. Does nothing if nothing changed."""
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
    """Return the lines of a text, one per style; the last style gets all remaining lines."""
    lines = text.split("\n", parts - 1)
    return lines + [""] * (parts - len(lines))


def beside_tip(start: Pair, end: Pair, size: Pair, window: Pair) -> Pair:
    """Return the lower left corner of a label of `size` for an arrow from `start` to `end` in a `window` (all pixels).

    The label lies beyond the tip and the pointer; if that is outside the window, beside the arrow behind its tip;
    always inside the window.
    """
    half, middle = np.asarray(size) / 2, np.asarray(end, dtype=float)
    along = np.subtract(end, start) / max(float(np.hypot(*np.subtract(end, start))), 1e-9)
    across = np.array([-along[1], along[0]])
    # half the label's extent along the arrow and across it
    ahead, aside = (float(np.abs(direction) @ half) for direction in (along, across))
    beside = [-ahead * along + side * (TIP_GAP + aside) * across for side in (1, -1)]
    places: list[Pair] = []
    for away in ((TIP_GAP + ahead) * along, *beside):
        x, y = (middle + away - half).tolist()
        places.append((x, y))
    inside = (p for p in places if all(0 <= p[k] <= window[k] - size[k] for k in (0, 1)))
    left, bottom = (min(max(places[1][k], 0.0), window[k] - size[k]) for k in (0, 1))
    return next(inside, (left, bottom))


class Arrow:
    """The arrow of a poke, from the mass, labelled with the force."""

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
