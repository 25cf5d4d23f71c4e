"""Figure of speed against error: the cost of a simulated second with each method, precision and backend."""

from __future__ import annotations

from math import log10
from typing import TYPE_CHECKING

import numpy as np

from softlab.bench.experiments.accuracy.methods import admitted
from softlab.bench.experiments.accuracy.points import CLOTHS, pareto_front
from softlab.bench.experiments.accuracy.points import SCENES as GRIDS
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import Point, points
from softlab.plots.core.colours import BLACK, GREY, METHODS
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import LONG_LABEL, Drawing, PointStyle, as_figure, legend_below, log_axes, new_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BROWN, PINK, VIOLET = "#7A5230", "#B0305C", "#5E3C99"
NAMES = GRIDS | CLOTHS  # label -> scene
SCENES = ("S1", "S2", "S4", "S5", "S6", "S6-still")
PREFERRED = (
    "S1",
    "S4",
    "S5",
    "S6",
    "S2",
    "S6-still",
)  # smooth, stiff, with contacts, a stiff rope: MOST of those that were timed
MOST = 4
MIN_FRACTION = 0.6  # of the methods of the machine that timed most
INTEGRATORS = {  # colour, marker
    name: (METHODS[name], marker)
    for name, marker in {
        "lab": "X", "semi-implicit-euler": "s", "velocity-verlet": "o", "rk4": "D", "explicit-euler": "v", "taylor": "P",
    }.items()
}  # fmt: skip
IMPLICIT = {  # of cloths
    name: (METHODS[name], marker) for name, marker in {"implicit-euler": "^", "implicit-euler-linear": "<"}.items()
}
XPBD = {  # in the work-precision diagram the markers are the iterations
    name: (METHODS[name], marker)
    for name, marker in {"xpbd gauss-seidel": "o", "xpbd jacobi": "s", "xpbd averaged-jacobi": "X"}.items()
}
DRAWN_XPBD = ("xpbd gauss-seidel", "xpbd jacobi")
DIGIT: PointStyle = {"markersize": 6.0, "markeredgewidth": 0.4}  # a number as a marker, legible
LINES = {"cpu": "-", "gpu": "--"}
NEAR = (0.4, 0.25)  # decades of error and of time: width and height of a label
PALE = 0.35  # opacity of a marker whose time is suspect
PANEL_HEIGHT = 1.4  # inch
# spacings: a larger error is drawn as if the run had diverged, since the other points would share a corner otherwise
LOST = 100.0
EDGE = 3.0  # times the largest error that is not lost: place of diverged runs


@as_figure("work-precision", "Work-precision diagram", "no accuracy runs were measured")
def draw(results: Results) -> Drawing:
    """Return the figure of the first featured machine with accuracy runs, or the reason why there is none.

    A row per scene, a column per precision.
    """
    source = needed(accurate_source(results))
    timed = {scene: [p for p in points(source, scene) if p.seconds is not None] for scene in SCENES}
    rows = [scene for scene in SCENES if scene in [name for name in PREFERRED if timed[name]][:MOST]]
    columns = [name for name in PRECISIONS if any(p.precision == name for scene in rows for p in timed[scene])]
    needed(rows, "the accuracy runs were not timed")
    figure, axes = new_grid(len(rows), len(columns), 1.3 + PANEL_HEIGHT * len(rows))
    for across, scene in zip(axes, rows, strict=True):
        for ax, precision in zip(across, columns, strict=True):
            _draw_panel(ax, [p for p in timed[scene] if p.precision == precision], f"{scene}, {precision}")
        across[0].set_ylabel("wall s / simulated s", fontsize=LONG_LABEL)
    for ax in axes[-1]:
        ax.set_xlabel("error / grid spacing h")
    _add_line_keys(axes[0][0], [p for scene in rows for p in timed[scene]])
    legend_below(figure, [ax for across in axes for ax in across], columns=4)
    shown = [p for scene in rows for p in timed[scene]]
    positions = any(p.integrator in DRAWN_XPBD for p in shown)
    caption = (
        "Work-precision diagram: cost of a simulated second against the error of its end state (root mean square distance "
        "of the free masses to the reference data, over the grid spacing h). A line is a method on one processor, a marker "
        f"a step size{'; digits: iterations of the position-based methods' if positions else ''}. Grey band: the Pareto "
        "front, its step sizes in ms. Hollow: not resolved by the reference data. Right edge: runs that diverged, or are "
        f"off by more than {LOST:g} h. Bars: fastest to slowest repeat."
        + "".join(f" {scene}: {text}." for scene in rows if (text := admitted(load_scene(NAMES[scene]))))
        + (" Pale: the time is suspect." if any(p.suspect for p in shown) else "")
    )
    return Drawing(figure, caption, (source,))


def accurate_source(results: Results) -> Source | None:
    """Return the first source that timed S1 with most of the methods, else the first with any accuracy runs.

    Featured ones first.
    """
    return answering(results, "S1") or results.first(points)


def answering(results: Results, label: str) -> Source | None:
    """Return the first source that timed a scene with most of the methods that any source did, featured ones first.

    With few methods one would be the fastest only because others are missing.
    """
    methods = [(source, {p.integrator for p in points(source, label) if p.seconds}) for source in results.everyone]
    most = max((len(timed) for _, timed in methods), default=0)
    return next((source for source, timed in methods if timed and len(timed) >= MIN_FRACTION * most), None)


def _draw_panel(ax: Axes, runs: list[Point], title: str) -> None:
    edge = EDGE * max((p.error for p in runs if not _lost(p) and p.error > 0), default=1.0)
    for name, iterations, colour, marker in _curves(runs):
        for backend, line in LINES.items():
            curve = [p for p in runs if (p.integrator, p.iterations, p.backend) == (name, iterations, backend)]
            sound = [p for p in curve if not _lost(p) and p.error > 0]
            ax.plot([p.error for p in sound], _seconds(sound), line, color=colour, linewidth=0.9, zorder=2,
                    alpha=PALE if any(p.suspect for p in sound) else 1.0)  # fmt: skip
            for p in curve:
                x = edge if _lost(p) else p.error
                face = colour if p.resolved or _lost(p) else "white"
                alpha = PALE if p.suspect else 1.0
                if p.low is not None and p.high is not None:
                    ax.plot([x, x], [p.low, p.high], color=colour, linewidth=0.8, zorder=2, alpha=alpha)
                how: PointStyle = {"marker": marker, "linestyle": "", "color": colour, "markerfacecolor": face}
                how.update(DIGIT if iterations is not None else {"markersize": 3.5})
                ax.plot([x], _seconds([p]), **how, zorder=3, clip_on=False, alpha=alpha)
        if iterations in (None, min((p.iterations or 0 for p in runs if p.integrator == name), default=None)):
            ax.plot([], [], marker if iterations is None else "-", color=colour, label=name)
    _draw_front(ax, pareto_front(runs))
    log_axes(ax, x_label="")
    if any(_lost(p) for p in runs):
        ax.axvline(edge, color=GREY, linestyle=":", linewidth=1)
        ax.annotate("diverged", (edge, 1), (-3, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
                    fontsize=7, color="#555555", va="top", ha="right", rotation=90)  # fmt: skip
    ax.margins(0.08, 0.12)  # space for the labels of the front
    ax.set_title(title)


def _seconds(runs: list[Point]) -> np.ndarray:
    """Return the times of points, NaN of those that were not timed."""
    return np.array([p.seconds for p in runs], float)


def _draw_front(ax: Axes, front: list[Point]) -> None:
    """Draw the Pareto front with its step sizes; neighbours with one step size get one label."""
    ax.plot([p.error for p in front], _seconds(front), "-", color=BLACK, linewidth=3.2, alpha=0.25, zorder=1)
    if front:
        ax.plot([], [], "-", color=BLACK, linewidth=3.2, alpha=0.25, label="Pareto front")
    labelled = [p for before, p in zip([None, *front], front, strict=False) if before is None or before.dt != p.dt]
    under: list[Point] = []  # points with a label below their left; those near one of them have it above their right
    for p in labelled:
        above = any(_near(p, other) for other in under)
        under += [] if above else [p]
        ax.annotate(f"{1000 * p.dt:.3g}", (p.error, p.seconds), (3, 3) if above else (-2, -8), textcoords="offset points",
                    fontsize=7, color="#555555", ha="left" if above else "right")  # fmt: skip


def _near(one: Point, other: Point) -> bool:
    """True if the labels of two points would overlap."""
    pairs = ((one.error, other.error), (one.seconds or 0.0, other.seconds or 0.0))
    return all(a > 0 < b and abs(log10(a / b)) < wide for (a, b), wide in zip(pairs, NEAR, strict=True))


def _lost(p: Point) -> bool:
    return p.diverged or p.error > LOST


def _curves(runs: list[Point]) -> list[tuple[str, int | None, str, str]]:
    """Return (method, iterations, colour, marker) of each curve of a panel; integrators have no iterations."""
    integrators = {p.integrator for p in runs}
    curves: list[tuple[str, int | None, str, str]] = [
        (name, None, colour, marker)
        for name, (colour, marker) in (INTEGRATORS | IMPLICIT).items()
        if name in integrators
    ]
    for name in DRAWN_XPBD:
        counts = sorted({p.iterations for p in runs if p.integrator == name and p.iterations})
        curves += [(name, n, XPBD[name][0], f"${n}$") for n in counts]
    return curves


def _add_line_keys(ax: Axes, runs: list[Point]) -> None:
    """Add the line styles to the legend."""
    for backend, line in LINES.items():
        if any(p.backend == backend for p in runs):
            ax.plot([], [], line, color="#555555", linewidth=0.9, label=backend.upper())
