"""Drawing of a frame: the picture of a shot between its heading and its caption. Pixels from the top left corner."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

INK, FAINT, WHITE = (26, 31, 38), (97, 105, 117), (255, 255, 255)
BAND, LINE = (20, 26, 36), (214, 218, 224)
CPU, GPU, WARNING = (0, 114, 178), (0, 158, 115), (178, 31, 0)  # the figures' blue and green
TALL = 720  # height in pixels of the frame that sizes refer to
HEADING, CAPTION = 58, 112  # heights of the bands of heading and caption
CAPTION_SIZE, CAPTION_LINES = 27, 2
MARGIN = 20
READABLE = 10  # true pixels: smallest size of text
FOOT = 16  # distance of the middle of the last line of a picture from its lower edge, in a frame TALL high
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Format:
    """Kind of film.

    `least`, `most`: its length [s]; `masses`: of the largest grid that is computed for it; `everything`: include shots
    that take long to compute; `rank`: sentences of a higher rank are left out; `curtain`: rows and columns of the
    curtain of the comparison (None: its own).
    """

    width: int
    height: int
    fps: int
    least: float
    most: float
    masses: int
    everything: bool = True
    rank: int = 9
    curtain: int | None = None


FULL = Format(1280, 720, 30, 110.0, 138.0, 1024**2)
QUICK = Format(640, 360, 15, 12.0, 40.0, 64**2, False, 0)


@lru_cache(maxsize=64)
def font(size: int, bold: bool = False) -> Any:
    """Return DejaVu Sans, which matplotlib contains."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


class Canvas:
    """A white picture; sizes and positions are in pixels of a frame TALL pixels high, which `scale` converts to actual
    ones."""

    def __init__(self, width: int, height: int, scale: float):
        self.scale = scale
        self.width, self.height = width / scale, height / scale
        self.image = Image.new("RGB", (width, height), WHITE)
        self.draw = ImageDraw.Draw(self.image)

    def text(
        self, x: float, y: float, text: str, size: float = 20, colour: Colour = INK, *, bold: bool = False,
        anchor: str = "la",
    ) -> None:  # fmt: skip
        """Draw a line of text; `anchor` as in Pillow (la: its top left corner is at x, y)."""
        place = x * self.scale, y * self.scale
        self.draw.text(place, text, fill=colour, font=self._font(size, bold), anchor=anchor)

    def wide(self, text: str, size: float = 20, bold: bool = False) -> float:
        """Return the width of a line of text."""
        return float(self._font(size, bold).getlength(text)) / self.scale

    def _font(self, size: float, bold: bool) -> Any:
        return font(max(round(size * self.scale), READABLE), bold)

    def wrapped(self, text: str, width: float, size: float = 20, bold: bool = False) -> list[str]:
        """Return the text in lines of at most that width."""
        return wrap(text, width, lambda line: self.wide(line, size, bold))

    def balanced(self, text: str, width: float, size: float = 20, bold: bool = False) -> list[str]:
        """Return the text in the same number of lines, of similar width."""
        lines = self.wrapped(text, width, size, bold)
        narrow, wide = width / max(1, len(lines)) / 1.1, width
        while wide - narrow > 4:
            middle = (narrow + wide) / 2
            if len(self.wrapped(text, middle, size, bold)) > len(lines):
                narrow = middle
            else:
                wide = middle
        return self.wrapped(text, wide, size, bold)

    def shortened(self, text: str, width: float, size: float = 20, bold: bool = False) -> str:
        """Return the text, or as much of its beginning as fits that width."""
        if self.wide(text, size, bold) <= width:
            return text
        while text and self.wide(text + ELLIPSIS, size, bold) > width:
            text = text[:-1]
        return text.rstrip() + ELLIPSIS

    def fitting(self, texts: Sequence[str], width: float, size: float = 20, bold: bool = False) -> str:
        """Return the first of the texts, ordered from long to short, that fits that width; else the last one,
        shortened.
        """
        longest = next((text for text in texts if self.wide(text, size, bold) <= width), texts[-1])
        return self.shortened(longest, width, size, bold)

    def paste(self, pixels: np.ndarray, x: float, y: float) -> None:
        """Draw (height, width, 3 or 4) uint8 true pixels, with their top left corner at x, y."""
        picture = Image.fromarray(np.ascontiguousarray(pixels[:, :, :3]))
        self.image.paste(picture, (round(x * self.scale), round(y * self.scale)))

    def box(self, x: float, y: float, width: float, height: float, colour: Colour) -> None:
        """Draw a filled rectangle, at least one actual pixel thick."""
        left, top = round(x * self.scale), round(y * self.scale)
        right, bottom = round((x + width) * self.scale) - 1, round((y + height) * self.scale) - 1
        self.draw.rectangle((left, top, max(left, right), max(top, bottom)), fill=colour)

    def path(self, points: Sequence[tuple[float, float]], colour: Colour, width: float = 2) -> None:
        """Draw a line through the points."""
        if len(points) > 1:
            places = [(x * self.scale, y * self.scale) for x, y in points]
            self.draw.line(places, fill=colour, width=max(1, round(width * self.scale)), joint="curve")


def wrap(text: str, width: float, wide: Callable[[str], float]) -> list[str]:
    """Return the text in lines of at most `width` by the measure `wide`, broken at plain spaces; a longer word gets a
    line of its own.
    """
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and wide(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


@dataclass(frozen=True)
class Area:
    """Region of a shot in true pixels, and the scale."""

    width: int
    height: int
    scale: float

    def canvas(self) -> Canvas:
        return Canvas(self.width, self.height, self.scale)

    def pixels(self, length: float) -> int:
        """Return a length in true pixels, an even number."""
        return max(16, round(length * self.scale) & ~1)


Picture = Callable[[Area, int, int], Iterator[Image.Image]]  # (area, number of frames, frames per second)


class Stage:
    """Composes frames: heading, picture, caption, and the progress of the film."""

    def __init__(self, form: Format):
        self.form = form
        self.scale = form.height / TALL
        self.top, self.bottom = round(HEADING * self.scale), round(CAPTION * self.scale)
        self._last: tuple[Image.Image, str, str, np.ndarray] | None = None
        self.area = Area(form.width, form.height - self.top - self.bottom, self.scale)

    def captions(self, text: str) -> list[str]:
        """Return a sentence in pieces that fit a caption, broken at natural pauses."""
        canvas = Canvas(1, 1, self.scale)
        width = self.form.width / self.scale - 3 * MARGIN
        count = 1
        while True:
            pieces = divided(text, count)
            lines = [canvas.balanced(piece, width, CAPTION_SIZE) for piece in pieces]
            if max(map(len, lines)) <= CAPTION_LINES or count >= len(text.split(" ")):
                return ["\n".join(piece_lines) for piece_lines in lines]
            count += 1

    def frame(self, heading: str, picture: Image.Image, caption: str, progress: float) -> np.ndarray:
        """Return the frame (height, width, 3) uint8; `progress`: fraction of the film that is over."""
        if self._last is None or self._last[0] is not picture or self._last[1:3] != (heading, caption):
            self._last = (picture, heading, caption, self._composed(heading, picture, caption))
        pixels = self._last[3].copy()
        high = self.form.height - self.bottom
        pixels[high : high + max(2, round(4 * self.scale)), : round(progress * self.form.width)] = GPU
        return pixels

    def _composed(self, heading: str, picture: Image.Image, caption: str) -> np.ndarray:
        canvas = Canvas(self.form.width, self.form.height, self.scale)
        canvas.text(MARGIN, HEADING / 2, heading, 27, bold=True, anchor="lm")
        canvas.image.paste(picture, (0, self.top))
        high = TALL - CAPTION
        canvas.box(0, high, canvas.width, CAPTION, BAND)
        lines = caption.split("\n") if caption else []
        for number, line in enumerate(lines):
            y = high + CAPTION / 2 + (number - (len(lines) - 1) / 2) * 1.42 * CAPTION_SIZE
            canvas.text(canvas.width / 2, y, line, CAPTION_SIZE, WHITE, anchor="mm")
        return np.asarray(canvas.image)


def divided(text: str, count: int) -> list[str]:
    """Return a sentence in `count` pieces of similar length, each ending after a punctuation mark if one is near."""
    pieces: list[str] = []
    words = text.split(" ")
    for left in range(count, 1, -1):
        wanted = len(" ".join(words)) / left

        def off(end: int, words: list[str] = words, wanted: float = wanted) -> float:
            length = len(" ".join(words[:end]))
            return abs(length - wanted) / wanted - (0.3 if words[end - 1].endswith((",", ":", ";", ".")) else 0.0)

        end = min(range(1, max(2, len(words) - left + 2)), key=off)
        pieces.append(" ".join(words[:end]))
        words = words[end:]
    return [*pieces, " ".join(words)]
