"""Figures of `softlab bar`: sag and first frequency over a rod's, against spacing, substeps and size of the clusters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from softlab.bench.experiments.bar import (
    FINEST,
    SOLVERS,
    SOME_LAYERS,
    SOME_LINKS,
    SOME_OVERLAP,
    SOME_VOXELS,
    TETRAHEDRA,
)
from softlab.bench.experiments.bar_rows import JELLY, Bar, first_backend, is_bar, rows, series
from softlab.bench.experiments.bar_strip import ACROSS, FREQUENCY, SAG
from softlab.plots.core.colours import BLUE, GREEN, GREY, METHODS, ORANGE, PURPLE, SKY, VERMILLION
from softlab.plots.core.data import Results, Source, judgements, needed
from softlab.plots.core.style import (
    LONG_LABEL,
    Drawing,
    PointStyle,
    as_figure,
    legend_below,
    new_figure,
    new_sheet,
    plain_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MISSING = "the bar was not measured (softlab bar)"
CURVES = {  # solver -> label, colour, marker, line
    "mass-spring": ("mass-spring", METHODS["velocity-verlet"], "o", "-"),
    "xpbd, converged": ("XPBD, converged", METHODS["xpbd"], "v", "--"),
    "xpbd": ("XPBD, 1 iteration", METHODS["xpbd"], "s", "-"),
    "shape-matching": ("shape matching, windows of 3 x 3", METHODS["shape-matching"], "^", "-"),
    JELLY: ("shape matching, jelly bar", METHODS["shape-matching"], "D", "--"),
    "tetrahedra, xpbd": ("tetrahedra, XPBD, 1 iteration", METHODS["xpbd"], "P", ":"),
    "tetrahedra, newton": ("tetrahedra, Newton", METHODS["newton"], "x", "--"),
}
# solver -> size, number along the bar
SOME = {JELLY: (SOME_OVERLAP, SOME_LAYERS), **{name: (1.0, SOME_VOXELS) for name in TETRAHEDRA}}
TETRAHEDRAL = tuple(name for name in CURVES if name.startswith("tetrahedra"))
BARS = {  # kind of bar -> its solvers
    "a strip of the lab's grid that hangs, under each solver": (
        "mass-spring",
        "xpbd, converged",
        "xpbd",
        "shape-matching",
    ),
    "a jelly bar of clusters, which stands": (JELLY,),
    "one of tetrahedra that hangs": TETRAHEDRAL,
}
REGIONS = {1: (ORANGE, "^"), 2: (GREEN, "s"), 3: (BLUE, "o"), 4: (PURPLE, "v")}
ROWS = {SAG: "sag / a rod's", FREQUENCY: "first frequency / a rod's"}


def bars(results: Results) -> tuple[list[Bar], tuple[Source, ...]]:
    """Return all rows, those of each backend from one machine, and their sources."""
    selected, sources = judgements(results, is_bar)
    return rows(selected), sources


@as_figure("bar-solvers", "Every method, one bar", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none.

    Sag above, frequency below; against the spacing on the left, against the substeps on the right.
    """
    measured, sources = bars(results)
    needed(any(bar.solver in SOLVERS for bar in measured))
    measured = first_backend(measured)
    figure = new_sheet(3.9)
    axes = figure.subplots(2, 2, sharex="col")
    for row, name in zip(axes, ROWS, strict=True):
        for solver, (label, colour, marker, line) in CURVES.items():
            size, some = SOME.get(solver, (1.0, SOME_LINKS))
            by_spacing = series(measured, solver, _fine, {"substeps": FINEST, "size": size})
            by_substeps = series(measured, solver, _substeps, {"fine": some, "size": size})
            how: PointStyle = {"color": colour, "marker": marker, "linestyle": line, "label": label}
            if solver == "mass-spring":  # drawn below the others, most of which coincide with it
                how.update({"linewidth": 3.5, "markersize": 7.5})
            _curve(row[0], by_spacing, _fine, name, how)
            _curve(row[1], by_substeps, _substeps, name, how)
        row[0].set_ylabel(ROWS[name], fontsize=LONG_LABEL)
        for ax in row:
            ax.axhline(1, color=GREY, linewidth=0.7, zorder=1)
    axes[0][1].set_yscale("log")  # the other has a smaller range
    plain_ticks(axes[0][1].yaxis)
    drawn = [bar for bar in measured if bar.solver in CURVES and not bar.law]
    _doubling(axes[1][0], drawn, _fine, "masses along the bar")
    _doubling(axes[1][1], drawn, _substeps, "substeps of a frame")
    legend_below(figure, list(axes.ravel()), columns=3)
    shown = {bar.solver for bar in drawn}
    titles = [text for text, solvers in BARS.items() if shown & set(solvers)]
    caption = (
        f"One bar of one material: {'; '.join(titles)}. Left: at {FINEST} substeps of a frame of a sixtieth of a second, "
        f"against the masses along it. Right: at {SOME_LINKS} along it"
        f"{f', of tetrahedra {SOME_VOXELS} voxels' if shown & set(TETRAHEDRAL) else ''}, against the "
        "substeps; mass-spring, whose steps are the substeps, is refused where there is no mark. Over "
        "the closed form of a rod of the material (grey); float64, exact math."
    )
    return Drawing(figure, caption, sources)


@as_figure("bar-clusters", "A bar and the size of its clusters", MISSING)
def draw_clusters(results: Results) -> Drawing:
    """Return the figure of windows of the strip and overlap of the jelly bar, or the reason why there is none."""
    measured, sources = bars(results)
    needed(any(bar.solver in ("shape-matching", JELLY) for bar in measured))
    measured = first_backend(measured)
    figure, (left, right) = new_figure(2, 3.4, sharey=False)
    for region, (colour, marker) in REGIONS.items():
        windows = series(measured, "shape-matching", _fine, {"substeps": FINEST, "size": region})
        wide = 2 * region + 1
        style: PointStyle = {"color": colour, "marker": marker}
        _curve(left, windows, _fine, SAG, {**style, "label": f"windows of {wide} x {wide}"})
        _curve(left, windows, _fine, ACROSS, {**style, "linestyle": ":", "markersize": 3})
    across = any(bar.solver == "shape-matching" and ACROSS in bar.values for bar in measured)
    if across:
        left.plot([], [], ":", color=GREY, label="loaded across")
    overlaps = series(measured, JELLY, _size, {"substeps": FINEST, "fine": SOME_LAYERS})
    for name, colour, marker in ((SAG, VERMILLION, "D"), (FREQUENCY, SKY, "v")):
        label = f"jelly bar: {ROWS[name].split(' /')[0]}"
        _curve(right, overlaps, _size, name, {"color": colour, "marker": marker, "label": label})
    for ax in (left, right):
        ax.axhline(1, color=GREY, linewidth=0.7, zorder=1)
    left.set_yscale("log")
    plain_ticks(left.yaxis)
    _doubling(left, [bar for bar in measured if bar.solver == "shape-matching"], _fine, "masses along the strip")
    left.set_ylabel("sag / a rod's")
    right.set_xlabel("overlap: cluster radius / cluster spacing")
    right.set_ylabel("over a rod's")
    legend_below(figure, [left, right], columns=3)
    loads = "that hangs (solid) or is held at its side (dotted, over a beam's)" if across else "that hangs"
    caption = (
        f"Left: the strip's windows, all as stiff in a long even stretch, and the sag of the strip {loads}: windows that the "
        "strip's ends cut off are softer. Right: the jelly bar, "
        "its clusters' stiffness chosen so that the material is one; clusters that hardly overlap do not make it one."
    )
    return Drawing(figure, caption, sources)


def _fine(bar: Bar) -> float:
    return bar.fine


def _substeps(bar: Bar) -> float:
    return bar.substeps


def _size(bar: Bar) -> float:
    return bar.size


def _curve(ax: Axes, measured: Sequence[Bar], where: Callable[[Bar], float], name: str, style: PointStyle) -> None:
    points = [(where(bar), part) for bar in measured if (part := bar.part(name)) is not None]
    if points:
        ax.plot(*zip(*points, strict=True), **style)


def _doubling(ax: Axes, measured: Sequence[Bar], where: Callable[[Bar], float], label: str) -> None:
    """Set a logarithmic x axis with a tick at each measured value."""
    values = sorted({where(bar) for bar in measured})
    ax.set_xscale("log")
    ax.set_xticks(values, [f"{value:g}" for value in values])
    ax.set_xticks([], minor=True)
    ax.set_xlabel(label)
