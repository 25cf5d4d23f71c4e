"""Figure of the convergence of the orderings of a position-based solver, by iterations and by time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from softlab.bench.experiments.accuracy.methods import XPBD
from softlab.bench.experiments.convergence import BEFORE, CONVERGENCE, RESIDUAL, colours
from softlab.bench.measure.costs_timing import LEAST, MOST, RATIO, SECONDS
from softlab.bench.store.method_name import name_of
from softlab.bench.store.results import Result, results_of
from softlab.plots.core.colours import GREY
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_figure
from softlab.plots.figures.work_precision import XPBD as CURVES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MISSING = "the orderings of position-based solvers were not timed with several numbers of iterations"
LINES = ("-", "--", "-.", ":")  # line styles of the sizes, small ones first


@dataclass(frozen=True)
class Converging:
    """One ordering, by `name`, after that many iterations on a sheet of `side` x `side` masses. `left`: the residual
    relative to the start; `seconds`: per step; `ratio`, `least`, `most`: of its time over that of Gauss-Seidel with as
    many iterations.
    """

    name: str
    backend: str
    side: int
    iterations: int
    left: float
    seconds: float
    ratio: float
    least: float
    most: float
    suspect: bool


def converging(source: Source, backend: str | None = None) -> list[Converging]:
    """Return all of a source (and backend), by ordering, size and iterations."""
    results = results_of(source.measures, CONVERGENCE, backend)
    entries = [_entry(one) for one in results if one.values.keys() >= {RESIDUAL, BEFORE, SECONDS, RATIO, LEAST, MOST}]
    return sorted(entries, key=lambda e: (e.backend, XPBD.index(e.name), e.side, e.iterations))


def lines(source: Source, backend: str | None = None) -> bool:
    """True if any ordering was run with several numbers of iterations: one point is no line."""
    runs = [(e.backend, e.name, e.side) for e in converging(source, backend)]
    return len(set(runs)) < len(runs)


def _entry(one: Result) -> Converging:
    value, tables = one.values, one.tables
    method, grid = tables["method"], next(table for table in tables.values() if "rows" in table)
    return Converging(
        name_of(method), one.description["backend"], grid["rows"], method["iterations"], value[RESIDUAL] / value[BEFORE],
        value[SECONDS], value[RATIO], value[LEAST], value[MOST], one.is_suspect(RATIO),
    )  # fmt: skip


@as_figure("convergence", "Convergence of the orderings", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure, by iterations and by time on each backend, or the reason why there is none."""
    source = needed(results.first(lambda s: lines(s, "gpu")) or results.first(lines))
    backends = [name for name in ("cpu", "gpu") if lines(source, name)]
    figure, axes = new_figure(1 + len(backends), 3.8)
    _panel(axes[0], converging(source, backends[0]), lambda entry: entry.iterations)
    axes[0].set_xlabel("iterations of a step")
    axes[0].set_title("by iterations")
    for ax, backend in zip(axes[1:], backends, strict=True):
        _panel(ax, converging(source, backend), lambda entry: 1e3 * entry.seconds)
        ax.set_xlabel("time of the step / ms")
        ax.set_title(f"by time, {backend.upper()}")
    axes[0].set_ylabel("stretch left / stretch at the start")
    sides = sorted({entry.side for entry in converging(source, backends[0])})
    for side, line in zip(_shown(sides), LINES, strict=False):
        axes[0].plot([], [], line, color=GREY, label=f"{side} x {side}")
    legend_below(figure, axes, columns=4)
    caption = (
        "What one step leaves of the stretch of a cloth hung by two corners, drawn out and rippled by a hundredth, whose "
        f"structural and shear springs do not give (root mean square); Gauss-Seidel in {colours()} colours. Averaged Jacobi "
        "is right here, where the compliance is 0; with compliance it converges to another stiffness."
    )
    return Drawing(figure, caption, (source,))


def _shown(sides: list[int]) -> list[int]:
    """Return at most as many sizes as there are line styles, with the smallest and the largest."""
    if len(sides) <= len(LINES):
        return sides
    return [*sides[: len(LINES) - 1], sides[-1]]


def _panel(ax: Axes, entries: list[Converging], where: Callable[[Converging], float]) -> None:
    sides = _shown(sorted({entry.side for entry in entries}))
    for name, (colour, marker) in CURVES.items():
        for side, line in zip(sides, LINES, strict=False):
            curve = [entry for entry in entries if (entry.name, entry.side) == (name, side)]
            if curve:
                ax.plot(
                    [where(e) for e in curve], [e.left for e in curve], line, marker=marker, color=colour, markersize=3
                )
        if any(entry.name == name for entry in entries):
            ax.plot([], [], marker=marker, color=colour, label=name)
    log_axes(ax, x_label="")
