"""Still pictures: title, figures, the table of answers."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from itertools import repeat

import numpy as np
from PIL import Image

from softlab.app.output.offscreen import OffscreenRenderer
from softlab.labbook.answer import HEAD, winner_tables
from softlab.labbook.film.canvas import BAND, CPU, FAINT, FOOT, GPU, INK, LINE, MARGIN, Area
from softlab.labbook.film.judged import Judged
from softlab.model.base.errors import SoftlabError
from softlab.plots.core.data import Results
from softlab.plots.core.files import lay_out
from softlab.plots.core.style import Drawing, settings
from softlab.plots.draw import FIGURES

TITLE = "Soft-body lab"
ROW = 31.0  # pixels
TABLE_SIZE = 18.0
COLUMNS = ("Scene", "Masses", "Error at most", "Method", "Step", "Processor", "Error", "One run", "Tie")  # of the table
PLACES = [HEAD.index(name) for name in COLUMNS]
PROCESSOR = COLUMNS.index("Processor")
ROWS = 15
UNITS = "Error in spacings; time of one run, with its launch and the copy of its end state."


def repeated(image: Image.Image, count: int) -> Iterator[Image.Image]:
    """Repeat one picture that many times."""
    return repeat(image, count)


def draw_title(comparison: Judged, results: Results, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield the title with the machines, next to a curtain that is released."""
    states = comparison.states["velocity-verlet"]
    side = area.pixels(area.height / area.scale - 2 * MARGIN)
    machines = list(dict.fromkeys(source.provenance for source in results.sources))
    with OffscreenRenderer(comparison.scene, side, side, legend=False) as renderer:
        for position in (states[0], states[-1]):
            renderer.fit(position)
        for frame in range(count):
            canvas = area.canvas()
            x = canvas.width - side / area.scale - MARGIN
            renderer.draw(states[min(len(states) - 1, frame)])
            canvas.paste(renderer.image(), x, MARGIN)
            canvas.text(2 * MARGIN, 60, TITLE, 58, bold=True)
            canvas.box(2 * MARGIN, 140, 130, 6, CPU)
            canvas.box(2 * MARGIN + 130, 140, 130, 6, GPU)
            y = 186.0
            for number, line in enumerate(machines):
                texts = canvas.balanced(line, x - 3 * MARGIN, 21)
                rest = len(machines) - number
                if y + 30 * len(texts) + (44 if rest > 1 else 0) > canvas.height:  # space for a line is left
                    canvas.text(2 * MARGIN, y, f"and {rest} more, which the lab book names", 21, FAINT)
                    break
                for text in texts:
                    canvas.text(2 * MARGIN, y, text, 21, FAINT)
                    y += 30
                y += 14
            yield canvas.image


def figure_of(results: Results, name: str) -> Drawing | None:
    """Return a figure of plots/, if the results have its data."""
    with settings():
        drawn = FIGURES[name](results)
    return None if isinstance(drawn, str) else drawn


def draw_figure(results: Results, name: str, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield the figure as large as it fits, with machine, commit and date below."""
    canvas = area.canvas()
    with settings():
        drawn = FIGURES[name](results)
        if isinstance(drawn, str):
            raise SoftlabError(drawn)
        lay_out(drawn.figure)
        wide, tall = drawn.figure.get_size_inches()
        lines = drawn.provenance
        foot = 22.0 * len(lines) + FOOT / 2
        dpi = min(area.width / wide, (area.height - foot * area.scale) / tall)
        file = io.BytesIO()
        drawn.figure.savefig(file, format="png", dpi=dpi)
    picture = Image.open(file).convert("RGB")
    x = (area.width - picture.width) / 2 / area.scale
    canvas.paste(np.asarray(picture), x, 0)
    for number, line in enumerate(reversed(lines)):
        text = canvas.shortened(line, canvas.width - 2 * MARGIN, 15)
        canvas.text(canvas.width / 2, canvas.height - FOOT - 22 * number, text, 15, FAINT, anchor="mm")
    return repeated(canvas.image, count)


def answers(results: Results) -> tuple[list[list[str]], str]:
    """Return (the rows of the book's first table, with the scene in each, the machine that they were measured on)."""
    rows, scene, whose = [], ["", ""], ""
    for table in winner_tables(results)[:1]:
        whose = table["title"].rpartition(". ")[2]
        for row in table["rows"]:
            scene = list(row[:2]) if row[0] else scene
            whole = [*scene, *row[2:]]
            rows.append([whole[place] for place in PLACES])
    return rows, whose


def draw_answers(results: Results, area: Area, count: int, fps: int) -> Iterator[Image.Image]:
    """Yield the rows one after another, in the first half of the time."""
    rows, whose = answers(results)
    rows = rows if len(rows) <= ROWS else [row for row in rows if not row[0].endswith(("(S1-16)", "(S1-64)"))][:ROWS]
    image, shown = None, 0
    for frame in range(count):
        until = min(len(rows), 1 + int(2.2 * len(rows) * frame / count))
        if image is None or until != shown:
            shown = until
            image = _table(rows, shown, f"{UNITS} {whose}", area)
        yield image


def _table(rows: Sequence[Sequence[str]], shown: int, origin: str, area: Area) -> Image.Image:
    canvas = area.canvas()
    size = TABLE_SIZE
    gap = 16.0
    while True:
        widths = [
            max(canvas.wide(row[k], size, row is COLUMNS) for row in (COLUMNS, *rows)) for k in range(len(COLUMNS))
        ]
        if sum(widths) + gap * (len(widths) - 1) <= canvas.width - 2 * MARGIN or size <= 9:
            break
        size -= 0.5
    row_height = min(ROW, (canvas.height - 42) / (len(rows) + 1))
    y = 6.0
    canvas.box(0, y, canvas.width, row_height, BAND)
    before = None
    for number, row in enumerate((COLUMNS, *rows[:shown])):
        x = MARGIN * 1.0
        colour = (
            (255, 255, 255) if number == 0 else {"GPU": GPU, "CPU": CPU}.get(row[PROCESSOR].partition(",")[0], FAINT)
        )
        for k, text in enumerate(row):
            hidden = number > 1 and k < 2 and row[0] == before
            ink = colour if number == 0 or k == PROCESSOR else INK
            if not hidden:
                canvas.text(x, y + row_height / 2, text, size, ink, bold=number == 0, anchor="lm")
            x += widths[k] + gap
        if number > 0 and row[0] != before:
            canvas.box(MARGIN, y, canvas.width - 2 * MARGIN, 1, LINE)
        before = row[0]
        y += row_height
    origin = canvas.shortened(origin, canvas.width - 2 * MARGIN, 15)
    canvas.text(canvas.width / 2, canvas.height - FOOT, origin, 15, FAINT, anchor="mm")
    return canvas.image
