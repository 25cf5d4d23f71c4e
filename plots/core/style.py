"""Style of every figure: a colour and a marker per curve, legible sizes, and the marks of measured points.

Filled markers: sound. Hollow: suspect (noisy, disturbed, or not checked). A black cross: the result was wrong; it
belongs to no curve. matplotlib is imported where it is used, with its object interface: no window, no global state.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from textwrap import wrap
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from softlab.bench.store.results import Timing
from softlab.plots.core.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from softlab.plots.core.data import NotMeasured, Results, Source, is_suspect, is_wrong, needed, sound

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

WIDTH = 6.3  # inch: text width on A4
HEIGHT = 2.5  # inch
MAX_PANELS = 3
LONG_LABEL = 7.0  # point: size of an axis label that is long beside its panel
LONG = 20  # letters
FOOTER_SIZE = 7  # point
FOOTER_LINE = 1.3 * FOOTER_SIZE  # point
LETTER = 0.6  # width of a letter over its size, in a line with many digits
OLDER = "[older]"  # marks what uses measurements of older code

SETTINGS: dict[str, object] = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.which": "major",
    "axes.axisbelow": True,  # a reference line often lies on one of the grid's
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "svg.hashsalt": "softlab",  # makes equal figures equal files
}


Dash = str | tuple[float, tuple[float, ...]]  # a line style of matplotlib


class PointStyle(TypedDict, total=False):
    """Arguments of matplotlib's `plot` for points and lines."""

    color: str
    marker: str
    linestyle: str
    label: str
    linewidth: float
    markersize: float
    markerfacecolor: str
    markeredgecolor: str
    markeredgewidth: float


@dataclass(frozen=True)
class Curve:
    """Style of one curve."""

    label: str
    colour: str
    marker: str
    line: Dash = "-"


THREADS = {
    "1": Curve("1 thread", BLACK, "v"),
    "1x": Curve("1x threads", BLUE, "o"),
    "2x": Curve("2x threads", ORANGE, "s"),
    "4x": Curve("4x threads", VERMILLION, "^"),
}
GPU = Curve("GPU", GREEN, "D")
GPU_PLAIN = Curve("GPU, one thread per mass", PURPLE, "^")


@dataclass(frozen=True)
class Drawing:
    """A finished figure: `figure` (matplotlib), `text` (its description), the `sources` of its data, and its `title`."""

    figure: Figure
    text: str
    sources: tuple[Source, ...] = ()
    title: str = ""

    @property
    def caption(self) -> str:
        """Description, then machine, commit and date of every source."""
        return " ".join([f"{self.text.strip()}{self._machines}", *(f"{line}." for line in self.provenance)])

    @property
    def _machines(self) -> str:
        """Warning that several machines are side by side, or nothing."""
        several = len({source.machine.key for source in self.sources}) > 1 and re.search(r"[Tt]ime|[Cc]ost", self.text)
        return " Several machines: a time of one does not compare with one of another." if several else ""

    @property
    def short_caption(self) -> str:
        """Description, then the machines, for a book whose first page states commits and dates."""
        places = dict.fromkeys(f"{source.place}{f' {OLDER}' if source.older else ''}" for source in self.sources)
        return f"{self.text.strip()}{self._machines} Measured on: {'; '.join(places)}." if places else self.text.strip()

    @property
    def provenance(self) -> list[str]:
        """Machine, commit and date, one line per source."""
        return list(dict.fromkeys(source.provenance for source in self.sources))

    @property
    def footer(self) -> list[str]:
        """Provenance in lines that are no wider than the figure."""
        fit = int(72 * self.figure.get_size_inches()[0] / (LETTER * FOOTER_SIZE))
        return [line for source in self.provenance for line in wrap(source, fit)]

    @property
    def footer_height(self) -> float:
        """Height in points of the provenance above the figure."""
        return FOOTER_LINE * (len(self.footer) + 0.5) if self.sources else 0.0


Draw = Callable[[Results], Drawing | str]
DRAWN: dict[
    str, tuple[str, Draw]
] = {}  # name of a figure -> its title, and what returns it or the reason why there is none


def as_figure(name: str, title: str, missing: str = "") -> Callable[[Callable[[Results], Drawing]], Draw]:
    """Enter a function as the figure `name`.

    `missing`: the reason if something was not measured (`needed`), unless that gives one of its own.
    """

    def enter(draw: Callable[[Results], Drawing]) -> Draw:
        @wraps(draw)
        def drawn(results: Results) -> Drawing | str:
            try:
                return replace(draw(results), title=title)
            except NotMeasured as reason:
                return str(reason) or missing

        DRAWN[name] = title, drawn
        return drawn

    return enter


@contextmanager
def settings() -> Iterator[None]:
    """Apply matplotlib's settings of the lab while a figure is made and saved."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # a user's own settings would make figures differ between machines
        for name, value in SETTINGS.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]  # typed as one of many literal names
        yield


def new_figure(columns: int = 1, height: float = HEIGHT, sharey: bool = True) -> tuple[Figure, list[Axes]]:
    """Return a figure with a row of axes."""
    figure, (axes,) = new_grid(1, columns, height, sharey)
    return figure, axes


def new_grid(rows: int, columns: int, height: float, sharey: bool = True) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with rows of axes; each row may share its y."""
    figure = new_sheet(height)
    return figure, [
        list(row) for row in figure.subplots(rows, columns, sharey="row" if sharey else False, squeeze=False)
    ]


def new_sheet(height: float) -> Figure:
    """Return an empty figure of that height [inch], on the Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(
    results: Results, holds: Callable[[Source], bool], missing: str = ""
) -> tuple[Figure, list[tuple[Axes, Source]]]:
    """Return a figure with a panel for each featured source that `holds` the data. Raises NotMeasured if none does."""
    chosen = needed([source for source in results.featured if holds(source)][:MAX_PANELS], missing)
    figure, axes = new_figure(len(chosen))
    for ax, source in zip(axes, chosen, strict=True):
        if len(chosen) > 1:
            ax.set_title(source.machine.label.replace("; ", "\n"), fontsize=8)
    return figure, list(zip(axes, chosen, strict=True))


def draw_times(
    ax: Axes,
    times: Sequence[Timing],
    curve: Curve,
    value: Callable[[Timing, float], float] = lambda _, seconds: seconds,
    *,
    light: bool = False,
) -> None:
    """Draw one curve over the number of masses: medians, a band from the smallest to the largest repeat, marks.

    `value(timing, seconds)` converts seconds per step into the unit of the axis. `light`: a committed curve behind
    others.
    """
    right = sound(times)
    x = np.array([timing.particles for timing in right], float)
    y = np.array([value(timing, timing.median) for timing in right])
    if light:
        ax.plot(x, y, linestyle=curve.line, color=curve.colour, linewidth=1.0, label=curve.label, zorder=1)
        return
    ends = np.array([[value(timing, timing.low), value(timing, timing.high)] for timing in right])
    wrong = [(t.particles, value(t, t.median)) for t in times if is_wrong(t)]
    draw_band(ax, (x, y, ends), curve, [is_suspect(timing) for timing in right], wrong)


def draw_band(
    ax: Axes,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    curve: Curve,
    suspect: Sequence[bool],
    wrong: Sequence[tuple[float, float]],
) -> None:
    """Draw a line through `points` (x (n,), y (n,), both ends of each one's band (n, 2)).

    Markers are hollow where `suspect`; each of the `wrong` (x, y) gets a cross.
    """
    x, y, ends = points
    if len(x):
        low, high = ends.min(axis=1), ends.max(axis=1)
        ax.fill_between(x, low, high, color=curve.colour, alpha=0.18, linewidth=0)
        ax.plot(x, y, linestyle=curve.line, color=curve.colour, label=curve.label, marker=curve.marker, zorder=3)
    if any(suspect):
        face: PointStyle = {"markerfacecolor": "white", "markeredgecolor": curve.colour}
        ax.plot(x[np.array(suspect)], y[np.array(suspect)], curve.marker, **face, zorder=4)
    ax.plot([x for x, _ in wrong], [y for _, y in wrong], "x", color=BLACK, zorder=5)


def log_axes(ax: Axes, y_label: str | None = None, x_label: str = "masses", *, plain: bool = False) -> None:
    """Make both axes logarithmic, with their labels; `plain`: that of x has plain ticks."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel(x_label)
    if y_label:
        ax.set_ylabel(y_label, fontsize=LONG_LABEL if len(y_label) > LONG else None)
    if plain:
        plain_ticks(ax.xaxis)


def plain_ticks(axis: Axis) -> None:
    """Use ticks 1, 2, 5, 10 instead of powers, for an axis of a small range."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high < 300 * low else (1.0,)
    axis.set_major_locator(LogLocator(base=10, subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda number, _: f"{number:g}"))
    axis.set_minor_formatter(NullFormatter())


def time_ticks(axis: Axis) -> None:
    """Use seconds with their prefix (20 µs), for a logarithmic axis of times."""
    from matplotlib.ticker import EngFormatter

    plain_ticks(axis)
    axis.set_major_formatter(EngFormatter(unit="s"))


def legend_below(
    figure: Figure, axes: Sequence[Axes], times: Sequence[Timing] = (), columns: int = 4, marks: Iterable[str] = ()
) -> None:
    """Draw one legend below the panels, with every label once. It explains hollow marks and crosses that occur in
    `times` or in `marks` ("suspect", "wrong answer").
    """
    from matplotlib.lines import Line2D

    handles: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if "suspect" in marks or any(is_suspect(timing) and not is_wrong(timing) for timing in times):
        handles["suspect"] = Line2D([], [], color=GREY, marker="o", markerfacecolor="white", linestyle="")
    if "wrong answer" in marks or any(is_wrong(timing) for timing in times):
        handles["wrong answer"] = Line2D([], [], color=BLACK, marker="x", linestyle="")
    if handles:
        longest = max(map(len, handles))
        # otherwise the legend is wider than the page
        columns = min(columns, 4 if longest < 18 else 3 if longest < 26 else 2)
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=min(columns, len(handles))
        )


def threading_note(sources: Sequence[Source]) -> str:
    """Return threading layer and wait policy in words, for captions of CPU times."""
    known = {source.threading for source in sources if source.threading[0]}
    return "; ".join(f"threading layer {layer}, wait policy {policy}" for layer, policy in sorted(known, key=str))
