"""The graph of frame times in the window: the time of the last frames for physics and drawing."""

from __future__ import annotations

import numpy as np

from softlab.app.render import colours

FRAMES = 120  # that are shown
BAR, HEIGHT = 2, 64  # pixels
STICK_OUT = 3  # frames that may be longer than the graph is high: one that compiled something would flatten the others
BUDGET = 1 / 60  # s: a frame's time on most displays, where the line is
WIDTH = FRAMES * BAR


class FrameTimes:
    """The seconds of the last FRAMES frames, the newest last: `seconds` (frames, 2), physics and drawing."""

    def __init__(self) -> None:
        self.seconds = np.zeros((FRAMES, 2))

    def add(self, physics: float, drawing: float) -> None:
        """Append one frame."""
        self.seconds[:-1] = self.seconds[1:]
        self.seconds[-1] = physics, drawing

    @property
    def range(self) -> float:
        """Seconds from the bottom to the top of the graph: two frames' time times a power of two, so that the line is
        at a half, a quarter ..., and all but STICK_OUT of the frames fit."""
        longest = float(np.sort(self.seconds.sum(axis=1))[-1 - STICK_OUT])
        return 2 * BUDGET * 2.0 ** max(0, int(np.ceil(np.log2(max(longest, BUDGET) / (2 * BUDGET)))))

    def image(self) -> np.ndarray:
        """Return the graph, (HEIGHT, WIDTH, 4) uint8, the lowest row first: a bar per frame, time of drawing on top of
        time of physics, under the line."""
        picture = np.full((HEIGHT, WIDTH, 4), (255, 255, 255, 225), np.uint8)
        tops = np.repeat(np.cumsum(self.seconds, axis=1) / self.range * HEIGHT, BAR, axis=0)
        rows = np.arange(HEIGHT)[:, None] + 0.5
        picture[rows < tops[:, 1]] = _opaque(colours.DRAWING)
        picture[rows < tops[:, 0]] = _opaque(colours.PHYSICS)
        picture[round(BUDGET / self.range * HEIGHT) - 1] = _opaque(colours.WARNING)
        return picture


def _opaque(colour: tuple[float, float, float]) -> tuple[int, ...]:
    return (*(round(255 * part) for part in colour), 255)


class FrameGraph:
    """The graph at the lower left. Made once; `draw` for each frame."""

    def __init__(self) -> None:
        import pyglet

        from softlab.app.render.panels import FONTS, rgba

        self._batch = pyglet.graphics.Batch()
        behind, before = pyglet.graphics.Group(0), pyglet.graphics.Group(1)
        self._back = pyglet.shapes.BorderedRectangle(
            0, 0, WIDTH + 76, HEIGHT + 34, border=1, color=(255, 255, 255, 232), border_color=(190, 195, 203, 232),
            batch=self._batch, group=behind,
        )  # fmt: skip
        self._texture = pyglet.image.Texture.create(WIDTH, HEIGHT)
        self._sprite = pyglet.sprite.Sprite(self._texture, batch=self._batch, group=before)

        def label(text: str, colour: tuple[float, float, float]) -> pyglet.text.Label:
            return pyglet.text.Label(
                text, font_name=FONTS, font_size=9, color=rgba(colour), batch=self._batch, group=before
            )

        self._budget = label(f"{1e3 * BUDGET:.1f} ms", colours.WARNING)
        self._top = label("", colours.INK)
        self._heads = [
            label("ms/frame:", colours.INK),
            label("physics", colours.PHYSICS),
            label("drawing", colours.DRAWING),
        ]
        self.height = HEIGHT + 34

    def draw(self, times: FrameTimes, above: int) -> None:
        """Draw it, `above` pixels over the window's lower edge."""
        import pyglet

        left, bottom = 16, above + 16
        self._texture.blit_into(pyglet.image.ImageData(WIDTH, HEIGHT, "RGBA", times.image().tobytes()), 0, 0, 0)
        self._back.position = (left - 8, bottom - 8)
        self._sprite.position = (left, bottom, 0)
        self._top.text = f"{1e3 * times.range:.0f} ms"
        self._top.position = (left + WIDTH + 6, bottom + HEIGHT - 8, 0)
        self._budget.position = (left + WIDTH + 6, bottom + HEIGHT * BUDGET / times.range - 4, 0)
        for x, head in zip((0, 78, 132), self._heads, strict=True):
            head.position = (left + x, bottom + HEIGHT + 8, 0)
        self._batch.draw()
