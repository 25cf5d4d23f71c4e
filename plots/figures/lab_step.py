"""Figure of the error of the hand-out's step, and of the orders of the other integrators.

Its error against Newton's law does not fall with the step size; that against half the acceleration falls in proportion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softlab.plots.core.accuracy_points import Point, order_points, points
from softlab.plots.core.colours import GREY, VERMILLION
from softlab.plots.core.data import Results, needed
from softlab.plots.core.style import HEIGHT, LONG_LABEL, Drawing, as_figure, legend_below, log_axes, new_grid
from softlab.plots.figures.work_precision import INTEGRATORS, SCENES, accurate_source

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACROSS = 2  # panels per row


@as_figure("lab-step", "What the hand-out's step converges to", "no accuracy runs were measured")
def draw(results: Results) -> Drawing:
    """Return the figure, one panel per scene, or the reason why there is none."""
    source = needed(accurate_source(results))
    here = [scene for scene in SCENES if order_points(points(source, scene), "lab")]
    needed(here, "the hand-out's step was not among the accuracy runs in float64")
    figure, rows = new_grid(-(-len(here) // ACROSS), min(ACROSS, len(here)), HEIGHT if len(here) <= ACROSS else 3.9)
    axes = [ax for row in rows for ax in row]
    for ax in axes[len(here) :]:
        ax.remove()
    del axes[len(here) :]
    for ax, scene in zip(axes, here, strict=True):
        _draw_panel(ax, [p for p in points(source, scene) if p.integrator in INTEGRATORS])
        ax.set_title(scene)
    for ax in axes[::ACROSS]:
        ax.set_ylabel("error / grid spacing h", fontsize=LONG_LABEL)
    legend_below(figure, axes, columns=3)
    caption = (
        "Error in float64 against step size: every integrator against the reference data of Newton's law, and the "
        "hand-out's step (lab) also against those of the equation with half the acceleration. Thin lines: slopes of order "
        "1, 2 and 4. Hollow: not resolved by the reference data."
    )
    return Drawing(figure, caption, (source,))


def _draw_panel(ax: Axes, runs: list[Point]) -> None:
    for name, (colour, marker) in INTEGRATORS.items():
        curve = [p for p in order_points(runs, name) if p.error > 0]
        if not curve:
            continue
        label = "lab, against Newton's law" if name == "lab" else name
        ax.plot([p.dt for p in curve], [p.error for p in curve], marker=marker, color=colour, label=label)
        hollow = [p for p in curve if not p.resolved]
        ax.plot([p.dt for p in hollow], [p.error for p in hollow], marker, color=colour, markerfacecolor="white")
    halves = [p for p in order_points(runs, "lab") if p.half]
    if halves:
        x, y, label = [p.dt for p in halves], [p.half for p in halves], "lab, against half the acceleration"
        ax.plot(x, np.array(y, float), "--", marker="*", color=VERMILLION, label=label)
    log_axes(ax, x_label="step size / ms")
    steps = sorted({p.dt for p in runs if not p.diverged})
    _draw_slopes(ax, runs, steps)
    ax.set_xticks(steps, [f"{1000 * dt:g}" for dt in steps])
    ax.set_xticks([], minor=True)
    ax.margins(y=0.1)


def _draw_slopes(ax: Axes, runs: list[Point], steps: list[float]) -> None:
    """Draw thin lines of order 1, 2 and 4, slightly below the integrator that should have that order."""
    for name, order in (("semi-implicit-euler", 1), ("velocity-verlet", 2), ("rk4", 4)):
        curve = order_points(runs, name)
        if len(curve) < 2 or not steps:
            continue
        anchor = max(curve, key=lambda p: p.dt)
        ax.plot(
            steps, [0.6 * anchor.error * (dt / anchor.dt) ** order for dt in steps], color=GREY, linewidth=0.7, zorder=1
        )
        ax.annotate(f"order {order}", (steps[0], 0.6 * anchor.error * (steps[0] / anchor.dt) ** order), (0, -3),
                    textcoords="offset points", fontsize=7, color="#555555", ha="left", va="top")  # fmt: skip
