"""Figure of projections per second of the position-based solvers, against the size of the sheet."""

from __future__ import annotations

from functools import partial

from softlab.bench.experiments.projections import points
from softlab.plots.core.backends import draw_rates, name_of, on_backends, sources_of, timed
from softlab.plots.core.colours import BLUE, GREEN, ORANGE, VERMILLION
from softlab.plots.core.data import Results
from softlab.plots.core.style import Drawing, legend_below, log_axes, new_figure

TITLE = "Projections a second"
STYLES = {
    ("gauss-seidel", 4): ("Gauss-Seidel, 4 neighbours", BLUE, "o"),
    ("gauss-seidel", 12): ("Gauss-Seidel, 12 neighbours", GREEN, "D"),
    ("jacobi", 4): ("Jacobi, 4 neighbours", ORANGE, "s"),
    ("jacobi", 12): ("Jacobi, 12 neighbours", VERMILLION, "^"),
}
SUBSTEPS = 10
LINES = {10: "-", 1: "--"}  # by iterations per substep


panels = partial(on_backends, select=timed(points))  # (backend, source, points) of the backends that were timed


def draw(results: Results) -> Drawing | str:
    """Return the figure with a panel per backend, or the reason why there is none."""
    chosen = panels(results)
    if not chosen:
        return "projections were not timed (softlab projections)"
    figure, axes = new_figure(len(chosen), 3.0, sharey=False)
    for ax, (backend, source, measured) in zip(axes, chosen, strict=True):
        squares = [p for p in measured if p.rows == p.columns and p.substeps == SUBSTEPS]
        draw_rates(ax, squares, STYLES, LINES, lambda p: ((p.ordering, p.neighbours), p.iterations))
        log_axes(ax)
        ax.set_title(name_of(backend, source), fontsize=8)
    axes[0].set_ylabel("projections a second")
    legend_below(figure, axes, columns=2)
    caption = (
        "Constraints x iterations x substeps over the time of a step, 10 substeps of 10 iterations (solid) or of one "
        "(dashed), float32: a hanging sheet with the springs of 4 or 12 neighbours, by coloured Gauss-Seidel and by Jacobi. "
        "The whole step is timed, prediction and velocities included."
    )
    return Drawing(figure, TITLE, caption, sources_of(chosen))
