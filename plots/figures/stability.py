"""Figures of the stability of each integrator: outcomes over step size and stiffness, and over step size and damping."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from softlab.bench.experiments.stability.points import (
    DAMPING,
    NAMES,
    STIFFNESS,
    Edge,
    MapPoint,
    stability_of,
)
from softlab.bench.experiments.stability.runs import END, OUTCOMES
from softlab.model.core.integrators import INTEGRATORS
from softlab.plots.core.colours import BLACK, ORANGE, SKY, YELLOW
from softlab.plots.core.data import Results, Source, judgements, needed
from softlab.plots.core.style import LONG_LABEL, Drawing, as_figure, new_sheet, plain_ticks

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#BFE3D6", SKY, YELLOW, ORANGE)  # of OUTCOMES
WORDS = ("settles", "bounded, still moving", "grows", "diverged")
HEIGHT = 3.05  # inch
NO_MAP = "the stability runs hold no map"
SHOWN = (("cpu", "float64"), ("gpu", "float64"), ("cpu", "float32"), ("gpu", "float32"))  # in order of preference


@as_figure("stability-stiffness", "Where each integrator breaks: stiffness")
def draw_stiffness(results: Results) -> Drawing:
    """Return the outcomes over (dt, stiffness), one panel per integrator, or the reason why there is no figure."""
    return _draw(results, "stiffness")


@as_figure("stability-damping", "Where each integrator breaks: damping")
def draw_damping(results: Results) -> Drawing:
    """Return the outcomes over (dt, damping), one panel per integrator, or the reason why there is no figure."""
    return _draw(results, "damping")


@lru_cache(maxsize=4)  # every claim and table calls it
def stability_runs(results: Results) -> tuple[list[MapPoint], list[Edge], tuple[Source, ...]]:
    """Return the map, the edges and their sources: featured ones first, those of each backend from one machine."""
    selected, sources = judgements(results, lambda measure: measure.name in NAMES)
    return *stability_of(selected), sources


def shown(points: Sequence[MapPoint]) -> tuple[str, str] | None:
    """Return the backend and precision of the figures."""
    here = {(p.place.backend, p.place.precision) for p in points}
    return next((pair for pair in SHOWN if pair in here), None)


def row_points(points: Sequence[MapPoint], axis: str) -> list[MapPoint]:
    """Return the points of one map: those with the ordinary value of the other quantity."""
    return [
        p for p in points if (p.place.damping == DAMPING if axis == "stiffness" else p.place.stiffness == STIFFNESS)
    ]


def _draw(results: Results, axis: str) -> Drawing:
    points, edges, sources = stability_runs(results)
    needed(sources, "no stability runs were made")
    pair = needed(shown(points), NO_MAP)
    map_points = [p for p in row_points(points, axis) if (p.place.backend, p.place.precision) == pair]
    needed(len({p.place.dt for p in map_points}) > 1, NO_MAP)
    figure = new_sheet(HEIGHT)
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    sheet_edges = [e for e in edges if not e.place.chain and (e.place.backend, e.place.precision) == pair]
    marks = [
        e
        for e in sheet_edges
        if (e.place.damping == DAMPING if axis == "stiffness" else e.place.stiffness == STIFFNESS)
    ]
    for ax, name in zip(axes.flat, INTEGRATORS, strict=True):
        cells = [p for p in map_points if p.place.integrator == name]
        _draw_panel(ax, cells, [e for e in marks if e.place.integrator == name], axis)
        ax.set_title(name, fontsize=8)
    for ax in axes.flat:
        ax.set_xlabel("step size / s" if ax in axes[-1] else " ")
    for row in axes:
        row[0].set_ylabel("stiffness / (N/m)" if axis == "stiffness" else "damping / (N s/m)", fontsize=LONG_LABEL)
    _legend(figure)
    return Drawing(figure, _caption(pair, axis), sources)


def _draw_panel(ax: Axes, points: Sequence[MapPoint], edges: Sequence[Edge], axis: str) -> None:
    from matplotlib.colors import BoundaryNorm, ListedColormap

    steps = sorted({p.place.dt for p in points})
    values = sorted({getattr(p.place, axis) for p in points})
    cells = np.full((len(values), len(steps)), np.nan)
    for p in points:
        cells[values.index(getattr(p.place, axis)), steps.index(p.place.dt)] = p.code
    ax.grid(False)
    ax.set_xscale("log")
    if not steps:
        return
    norm = BoundaryNorm(np.arange(len(OUTCOMES) + 1) - 0.5, len(OUTCOMES))
    places = np.arange(len(values) + 1) - 0.5  # rows at equal distances, because damping has a zero
    ax.pcolormesh(
        _between(steps), places, np.ma.masked_invalid(cells), cmap=ListedColormap(COLOURS), norm=norm,
        edgecolors="white", linewidth=0.4, rasterized=False,
    )  # fmt: skip
    limits = {getattr(p.place, axis): p.place.limit for p in points}
    line = [(limits[value], k) for k, value in enumerate(values) if limits[value] > 0]
    ax.plot([x for x, _ in line], [k for _, k in line], "-", color=BLACK, linewidth=1.3, marker=".", markersize=3)
    known = [(e.measured, values.index(getattr(e.place, axis))) for e in edges if getattr(e.place, axis) in values]
    ax.plot([x for x, _ in known], [k for _, k in known], "D", color=BLACK, markerfacecolor="white", markersize=4.5)
    ax.set_xlim(_between(steps)[0], _between(steps)[-1])
    ax.set_ylim(places[0], places[-1])
    ax.set_yticks(range(len(values)), [f"{value:g}" for value in values])
    plain_ticks(ax.xaxis)


def _between(steps: Sequence[float]) -> np.ndarray:
    """Return the borders of cells around `steps`, halfway on a logarithmic axis."""
    logs = np.log(np.asarray(steps))
    middle = (logs[1:] + logs[:-1]) / 2
    return np.exp(np.concatenate([[2 * logs[0] - middle[0]], middle, [2 * logs[-1] - middle[-1]]]))


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [Patch(color=colour, label=word) for colour, word in zip(COLOURS, WORDS, strict=True)]
    handles.append(Line2D([], [], color=BLACK, marker=".", markersize=3, label="analytic limit"))
    handles.append(
        Line2D(
            [], [], color=BLACK, marker="D", markerfacecolor="white", linestyle="", label="measured edge, linear net"
        )
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=3)


def _caption(pair: tuple[str, str], axis: str) -> str:
    backend, precision = pair
    fixed = f"damping {DAMPING:g} N s/m" if axis == "stiffness" else f"stiffness {STIFFNESS:g} N/m"
    return (
        f"Outcome after {END:g} s (longer for what grows) of an 8 x 8 curtain ({fixed}; {backend.upper()}, {precision}). "
        "Line: the analytic limit for any state of the grid; none where there is no stable step size. Diamonds: the edge "
        "found by bisection on the same grid without rest lengths, where the equation is linear. Springs near their rest "
        "length are stable beyond it."
    )
