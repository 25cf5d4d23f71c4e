"""Projections a second of the position-based solvers, against the size of the sheet; and published frames beside ours."""

from __future__ import annotations

from functools import partial
from typing import Any

from bench.experiments.projections import ProjectionPoint, points
from plots.core.data import Results
from plots.core.style import BLUE, GREEN, ORANGE, VERMILLION, Drawing, legend_below, log_axes, new_figure
from plots.figures import backends
from plots.figures.backends import name_of, sources_of

TITLE = "Projections a second"
LOOKS = {
    ("gauss-seidel", 4): ("Gauss-Seidel, 4 neighbours", BLUE, "o"),
    ("gauss-seidel", 12): ("Gauss-Seidel, 12 neighbours", GREEN, "D"),
    ("jacobi", 4): ("Jacobi, 4 neighbours", ORANGE, "s"),
    ("jacobi", 12): ("Jacobi, 12 neighbours", VERMILLION, "^"),
}
LINES = {10: "-", 1: "--"}  # by iterations a substep


panels = partial(backends.panels, points=points)  # (backend, source, points) of the backends that were timed


def draw(results: Results) -> Drawing | str:
    """The figure, a panel a backend; or why there is none."""
    chosen = panels(results)
    if not chosen:
        return "projections were not timed (softlab projections)"
    figure, axes = new_figure(len(chosen), 3.8, share_y=False)
    for ax, (backend, source, found) in zip(axes, chosen, strict=True):
        for (ordering, neighbours), (label, colour, marker) in LOOKS.items():
            for iterations, line in LINES.items():
                _curve(ax, found, (ordering, neighbours, iterations), line, colour, marker, label)
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


def _curve(ax: Any, found: list[ProjectionPoint], key: tuple[str, int, int], line: str, *look: str) -> None:
    """One line of squares, with a label where it is the solid one."""
    colour, marker, label = look
    mine = [p for p in found if (p.ordering, p.neighbours, p.iterations) == key and p.rows == p.columns]
    mine = [p for p in mine if p.substeps == 10]
    if mine:
        name = label if line == "-" else None
        ax.plot(
            [p.rows * p.columns for p in mine], [p.rate for p in mine], line, color=colour, marker=marker, label=name
        )
