"""Speed against error: what a simulated second costs with each method, precision and backend."""

from __future__ import annotations

from typing import Any

from bench.experiments.accuracy.experiment import pareto_front
from plots.core.accuracy_points import Point, observed_order, order_points, points
from plots.core.data import Results, Source
from plots.core.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    Drawing,
    legend_below,
    new_figure,
)

TITLE = "Speed against error"
BROWN, PINK, VIOLET, OLIVE = "#7A5230", "#B0305C", "#5E3C99", "#7F7F00"
SCENES = ("S1", "S2", "S4", "S5", "S6", "S6-still")
INTEGRATORS = {  # colour, marker
    "lab": (VERMILLION, "X"),
    "semi-implicit-euler": (ORANGE, "s"),
    "velocity-verlet": (BLUE, "o"),
    "rk4": (GREEN, "D"),
    "explicit-euler": (PURPLE, "v"),
    "taylor": (SKY, "P"),
}
IMPLICIT = {"implicit-euler": (VIOLET, "^"), "implicit-euler-linear": (OLIVE, "<")}  # the same, of cloths
XPBD = {  # the same; in the speed diagram the markers are the iterations
    "xpbd gauss-seidel": (BLACK, "o"),
    "xpbd jacobi": (BROWN, "s"),
    "xpbd averaged-jacobi": (PINK, "X"),
}
DRAWN_XPBD = ("xpbd gauss-seidel", "xpbd jacobi")
DIGIT = {"markersize": 6.0, "markeredgewidth": 0.4}  # a number as a marker, legible
LINES = {("cpu", "float32"): "-", ("cpu", "float64"): "--", ("gpu", "float32"): "-.", ("gpu", "float64"): ":"}
ACROSS = 2  # panels in a row
FLAT = 0.3  # an observed order under it: the error does not fall with the step size
LOST = 100.0  # spacings: an error beyond it is drawn as if the run had diverged, or the others would share a corner
EDGE = 3.0  # times the largest error that is not lost: where diverged runs are put


def draw(results: Results) -> Drawing | str:
    """The figure (one panel a scene) of the first featured machine that has accuracy runs, or why there is none."""
    source = accurate_source(results)
    if source is None:
        return "no accuracy runs were measured"
    here = [scene for scene in SCENES if any(p.seconds for p in points(source, scene))]
    if not here:
        return "the accuracy runs were not timed"
    figure, axes = scene_panels(len(here), 4.4)
    for ax, scene in zip(axes, here, strict=True):
        _draw_panel(ax, [p for p in points(source, scene) if p.seconds is not None], scene)
    for ax in axes[::ACROSS]:
        ax.set_ylabel("wall time per simulated second / s")
    _add_line_keys(axes[0], [p for scene in here for p in points(source, scene) if p.seconds is not None])
    legend_below(figure, axes, columns=4)
    caption = (
        "Cost of a simulated second against the error of its end state (root mean square over the free masses, in spacings, "
        "against the converged reference), one line a method, precision and backend, a marker a step size; of position-based "
        "methods the marker is the number of iterations. Grey: the Pareto front. Hollow: below what the reference resolves. "
        f"At the right edge: runs that diverged, or are off by over {LOST:g} spacings. Bars: least to greatest repeat. The "
        "hand-out's step (lab) solves the equation with half the acceleration."
    )
    return Drawing(figure, TITLE, caption, (source,))


def scene_panels(count: int, height: float) -> tuple[Any, list[Any]]:
    """A figure with a panel for each scene, ACROSS in a row, each row of such a `height` [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if count <= ACROSS:
        return new_figure(count, height)
    rows = -(-count // ACROSS)
    figure = Figure(figsize=(WIDTH, 0.8 * rows * height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(rows, ACROSS, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.remove()
    return figure, axes[:count]


def accurate_source(results: Results) -> Source | None:
    """The first source with accuracy runs, featured ones first."""
    return next((s for s in (*results.featured, *results.background) if points(s)), None)


def _draw_panel(ax: Any, found: list[Point], scene: str) -> None:
    edge = EDGE * max((p.error for p in found if not _lost(p) and p.error > 0), default=1.0)
    for name, iterations, colour, marker in _curves(found):
        for (backend, precision), line in LINES.items():
            mine = [p for p in found if (p.integrator, p.iterations) == (name, iterations)
                    and (p.backend, p.precision) == (backend, precision)]  # fmt: skip
            if not mine:
                continue
            sound = [p for p in mine if not _lost(p) and p.error > 0]
            ax.plot([p.error for p in sound], [p.seconds for p in sound], line, color=colour, linewidth=1.1, zorder=2)
            for p in mine:
                x = edge if _lost(p) else p.error
                face = colour if p.resolved and not _lost(p) else "white"
                if p.low is not None and p.high is not None:
                    ax.plot([x, x], [p.low, p.high], color=colour, linewidth=0.8, zorder=2)
                how: dict[str, Any] = {"marker": marker, "linestyle": "", "color": colour, "markerfacecolor": face}
                how |= DIGIT if iterations is not None else {}
                ax.plot([x], [p.seconds], **how, zorder=3, clip_on=False)
        if iterations in (None, min((p.iterations or 0 for p in found if p.integrator == name), default=None)):
            ax.plot([], [], marker if iterations is None else "-", color=colour, label=name)
    front = pareto_front(found)
    ax.plot([p.error for p in front], [p.seconds for p in front], "-", color=BLACK, linewidth=3.2, alpha=0.25, zorder=1)
    if front:
        ax.plot([], [], "-", color=BLACK, linewidth=3.2, alpha=0.25, label="Pareto front")
    ax.set_xscale("log")
    ax.set_yscale("log")
    if any(_lost(p) for p in found):
        ax.axvline(edge, color=GREY, linestyle=":", linewidth=1)
        ax.annotate("diverged", (edge, 1), (-3, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
                    fontsize=7, color="#555555", va="top", ha="right", rotation=90)  # fmt: skip
    lab = [p for p in found if p.integrator == "lab" and not p.diverged]
    order = observed_order([(p.dt, p.error) for p in order_points(found, "lab")])
    if lab and order is not None and order < FLAT:
        ax.annotate("lab solves half the acceleration", (lab[0].error, 0), (5, 3), xycoords=("data", "axes fraction"),
                    textcoords="offset points", fontsize=7, color=VERMILLION, ha="right", va="bottom")  # fmt: skip
        ax.margins(y=0.12)
    ax.set_title(scene)
    ax.set_xlabel("error / spacings")


def _lost(p: Point) -> bool:
    return p.diverged or p.error > LOST


def _curves(found: list[Point]) -> list[tuple[str, int | None, str, str]]:
    """(method, iterations, colour, marker) of each curve of a panel; integrators have no iterations."""
    held = {p.integrator for p in found}
    curves: list[tuple[str, int | None, str, str]] = [
        (name, None, colour, marker) for name, (colour, marker) in (INTEGRATORS | IMPLICIT).items() if name in held
    ]
    for name in DRAWN_XPBD:
        counts = sorted({p.iterations for p in found if p.integrator == name and p.iterations})
        curves += [(name, n, XPBD[name][0], f"${n}$") for n in counts]
    return curves


def _add_line_keys(ax: Any, found: list[Point]) -> None:
    """What the line styles mean, for the legend."""
    for (backend, precision), line in LINES.items():
        if any((p.backend, p.precision) == (backend, precision) for p in found):
            ax.plot([], [], line, color="#555555", linewidth=1.1, label=f"{backend.upper()}, {precision}")
