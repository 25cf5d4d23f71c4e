"""Figures on disk: as vectors for books and as pixels for screens, written completely or not at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softlab.model.base.files import replacing
from softlab.plots.core import figure_cache
from softlab.plots.core.style import FOOTER_SIZE, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PNG_DPI = 160
SUFFIXES = ("svg", "png")  # for books and for screens
RAISED = str.maketrans(
    "-\N{MINUS SIGN}0123456789", "\u207b\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)


def lay_out(figure: Figure) -> None:
    """Compute the layout once: half of the cost of a figure, which each format would repeat.

    Powers of ten are written as text (10²), not as formulas, which would be parsed label by label.
    """
    from matplotlib.ticker import LogFormatterSciNotation

    class Powers(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return plain_power(super().__call__(x, pos))

    engine = figure.get_layout_engine()
    if engine is None:
        return
    for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
        if type(axis.get_major_formatter()) is LogFormatterSciNotation:
            axis.set_major_formatter(Powers())
        if type(axis.get_minor_formatter()) is LogFormatterSciNotation:
            axis.set_minor_formatter(Powers())
    figure.set_dpi(PNG_DPI)
    engine.execute(figure)
    figure.set_layout_engine(None)


def plain_power(formula: str) -> str:
    r"""Return `$\mathdefault{2\times10^{-3}}$`, matplotlib's label of an axis, as text."""
    match = re.fullmatch(r"\$\\mathdefault\{(.*)\}\$", formula)
    if match is None:
        return formula
    return re.sub(r"\^\{(.*?)\}", lambda power: power[1].translate(RAISED), match[1]).replace(
        r"\times", "\N{MULTIPLICATION SIGN}"
    )


def save(
    drawing: Drawing,
    folder: Path,
    name: str,
    *,
    footer: bool = False,
    suffixes: Sequence[str] = SUFFIXES,
) -> list[Path]:
    """Write NAME.svg and NAME.png into an existing folder, completely or not at all. Raises InputError.

    `footer`: with machine, commit and date in a strip above the figure (see `without_footer`).
    """
    from matplotlib.transforms import Bbox

    figure = drawing.figure
    key = figure_cache.key_of(figure, (drawing.title, drawing.caption, footer))
    width, height = figure.get_size_inches()
    above = 0.0
    if footer:
        text = "\n".join(drawing.footer)
        figure.text(0.995, 1.0, text, fontsize=FOOTER_SIZE, color="#555555", ha="right", va="bottom")
        above = drawing.footer_height / 72
    written = []
    for suffix in suffixes:
        path = folder / f"{name}.{suffix}"
        metadata: dict[str, str | None] = {"Title": drawing.title}
        metadata |= {"pdf": {"Subject": drawing.caption, "CreationDate": None}}.get(
            suffix, {"Description": drawing.caption}
        )
        if suffix == "svg":
            metadata["Date"] = None  # a date would make equal figures differ
        with replacing(path) as temporary:
            if not figure_cache.fetch(key, suffix, temporary):
                lay_out(figure)
                figure.savefig(
                    temporary, format=suffix, dpi=PNG_DPI, metadata=metadata,
                    bbox_inches=Bbox.from_bounds(0, 0, width, height + above),
                )  # fmt: skip
                figure_cache.store(key, suffix, temporary)
        written.append(path)
    return written


def without_footer(svg: str, height: float) -> str:
    """Return a figure from `save`, .svg, without the strip of that many points above it, by its view box."""

    def lower(match: re.Match[str]) -> str:
        width, tall = float(match[1]), float(match[2]) - height
        return f'width="{width:g}pt" height="{tall:g}pt" viewBox="0 {height:g} {width:g} {tall:g}"'

    return re.sub(r'width="([0-9.]+)pt" height="([0-9.]+)pt" viewBox="0 0 [0-9. ]+"', lower, svg, count=1)
