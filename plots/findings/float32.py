"""Figure of the resolution of float32: smaller steps help until rounding dominates, earlier far from the origin."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from softlab.bench.experiments.findings.experiment import AWAY, FLOOR
from softlab.plots.core.data import Results, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_figure
from softlab.plots.figures.work_precision import INTEGRATORS
from softlab.plots.findings.points import Row, of_finding

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES = {"float32": "-", "float64": "--"}


@as_figure("findings-float32", "Where float32 stops", "the floor of float32 was not measured")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none: error against step size, and against the distance from the
    origin.
    """
    source, floor = of_finding(results, FLOOR)
    _, away = of_finding(results, AWAY)
    figure, axes = new_figure(2, 2.2, sharey=False)
    _draw_floor(axes[0], [row for row in needed(floor) if 0 < row.value < math.inf])
    _draw_away(axes[1], away)
    legend_below(figure, axes, columns=3)
    caption = (
        "Left: error on S1 at ever smaller steps, in float32 and in float64. Right: a ten-link chain let go far from the "
        "origin in float32, the largest distance after 1 s to the same at the origin in float64; the hand-out's step (lab) "
        "takes its velocity from a difference of positions."
    )
    return Drawing(figure, caption, (needed(source),))


def _draw_floor(ax: Axes, measured: list[Row]) -> None:
    for scheme, precision in dict.fromkeys((row.scheme, row.precision) for row in measured):
        colour, marker = INTEGRATORS[scheme]
        curve = [row for row in measured if (row.scheme, row.precision) == (scheme, precision)]
        ax.plot([r.dt for r in curve], [r.value for r in curve], LINES[precision], marker=marker, color=colour,
                label=f"{scheme}, {precision}")  # fmt: skip
    log_axes(ax, "error / grid spacing h", "step size / ms")
    steps = sorted({row.dt for row in measured})[::2]
    ax.set_xticks(steps, [f"{1000 * dt:.2g}" for dt in steps])
    ax.set_xticks([], minor=True)
    ax.set_title("at ever smaller steps")


def _draw_away(ax: Axes, measured: list[Row]) -> None:
    for scheme in dict.fromkeys(row.scheme for row in measured):
        colour, marker = INTEGRATORS[scheme]
        curve = [row for row in measured if row.scheme == scheme and row.value > 0]
        ax.plot(
            [r.offset for r in curve], [r.value for r in curve], marker=marker, color=colour, label=f"{scheme}, float32"
        )
    ax.set_xscale("symlog", linthresh=1e3)
    offsets = sorted({row.offset for row in measured})
    ax.set_xticks(offsets, [f"{offset:.0e}".replace("e+0", "e") if offset else "0" for offset in offsets])
    ax.set_xticks([], minor=True)
    ax.set_yscale("log")
    ax.set_xlabel("distance from the origin / m")
    ax.set_title("far from the origin")
