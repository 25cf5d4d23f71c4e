"""Figure of the fastest method and processor at each error, by the size of the grid, and GPU compared with CPU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from softlab.bench.experiments.accuracy.equal_error import equal_error
from softlab.bench.experiments.accuracy.points import SIZES
from softlab.plots.core.accuracy_points import SIDE, Point, points
from softlab.plots.core.colours import BLUE, GREEN, GREY
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import HEIGHT, Drawing, as_figure, log_axes, new_figure, plain_ticks
from softlab.plots.figures.work_precision import INTEGRATORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

MISSING = "no machine in the data has timed a GPU and a CPU at equal error and several sizes"
SCENE = "S1"  # the scene that is measured at several sizes
SHORT = {"semi-implicit-euler": "semi-implicit", "velocity-verlet": "Verlet", "explicit-euler": "explicit"}
PROCESSORS = {"cpu": ("CPU", BLUE), "gpu": ("GPU", GREEN)}
MOST = 6  # decades of error
SCATTER = 1.15  # a smaller lead is none: the cell belongs to both


def sizes(source: Source) -> dict[int, list[Point]]:
    """Return {masses: timed runs of SCENE in fast math}, smallest grid first, of sizes that both backends were timed
    at.
    """
    labels = {SIZES[label][1] ** 2 if label in SIZES else SIDE**2: label for label in (SCENE, *SIZES)}
    by_size = {
        masses: [p for p in points(source, labels[masses]) if p.seconds is not None] for masses in sorted(labels)
    }
    return {masses: runs for masses, runs in by_size.items() if {p.backend for p in runs} == set(PROCESSORS)}


def targets(runs: Sequence[Point]) -> list[float]:
    """Return the decades of error [spacings] from 0.1 down to the smallest that a run reached, at most MOST."""
    least = min((p.error for p in runs if p.error > 0), default=1.0)
    return [10.0**-n for n in range(1, 1 + min(MOST, math.floor(-math.log10(least))))]


@as_figure("regimes", "Who reaches an error fastest", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure of the first machine that timed both processors at several sizes, or the reason why there is
    none.
    """
    source = needed(results.first(lambda s: len(sizes(s)) > 1))
    figure, (left, right) = new_figure(2, HEIGHT, sharey=False)
    grid = left.get_gridspec()
    assert grid is not None
    grid.set_width_ratios((5, 2))
    by_size = sizes(source)
    _map(left, by_size)
    _ratios(right, by_size)
    caption = (
        "Left: the method, step size and processor that reach an error fastest in the lab curtain (S1), by its number of "
        "masses. In brackets: the time of the other processor's fastest over this one. Grey: a lead under "
        f"{SCATTER:g}. Right: CPU time over GPU time, each by that method's fastest run with an error of at most 0.01 h; "
        "above 1 the GPU is faster. Without the copy of the end state. ?: the time is suspect."
    )
    return Drawing(figure, caption, (source,))


def _map(ax: Axes, by_size: dict[int, list[Point]]) -> None:
    wanted = targets([p for runs in by_size.values() for p in runs])
    for row, runs in enumerate(by_size.values()):
        for column, fastest in enumerate(equal_error(runs, wanted)):
            best = fastest.best
            if best is None:
                continue
            lead = max(fastest.speed_up, 1 / fastest.speed_up) if fastest.speed_up else None
            even = lead is not None and lead < SCATTER
            name, colour = PROCESSORS[best.backend]
            ax.add_patch(_cell(column, row, GREY if even else colour))
            lines = [SHORT.get(best.integrator, best.integrator), f"{1000 * best.dt:g} ms", best.precision]
            lines.append("GPU = CPU" if even else f"{name} ({lead:.2g}x)" if lead else f"{name} alone")
            lines[-1] += "?" * any(one is not None and one.suspect for one in (fastest.cpu, fastest.gpu))
            ax.text(column, row, "\n".join(lines), ha="center", va="center", fontsize=7)
    ax.set_xlim(-0.5, len(wanted) - 0.5)
    ax.set_ylim(-0.5, len(by_size) - 0.5)
    ax.set_xticks(range(len(wanted)), [f"{target:g}" for target in wanted])
    ax.set_yticks(range(len(by_size)), [str(masses) for masses in by_size])
    ax.set_xlabel("error / grid spacing h")
    ax.set_ylabel("masses")
    ax.grid(visible=False)


def _cell(column: int, row: int, colour: str) -> Patch:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.48, row - 0.47), 0.96, 0.94, color=colour, alpha=0.3, linewidth=0)


def _ratios(ax: Axes, by_size: dict[int, list[Point]], target: float = 1e-2) -> None:
    for name, (colour, marker) in INTEGRATORS.items():
        ratios = {}
        for masses, runs in by_size.items():
            (fastest,) = equal_error([p for p in runs if p.integrator == name], [target])
            if fastest.speed_up:
                ratios[masses] = fastest.speed_up
        if len(ratios) > 1:
            ax.plot(list(ratios), list(ratios.values()), marker=marker, color=colour, label=name)
    ax.axhline(1, color=GREY, linewidth=1, zorder=1)
    log_axes(ax, "CPU time / GPU time")
    ax.set_xticks(list(by_size), [str(masses) for masses in by_size])
    ax.minorticks_off()
    plain_ticks(ax.yaxis)
    ax.legend(fontsize=7)
