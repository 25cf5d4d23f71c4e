"""Figures of declared experiments (`Lines` of bench/measure/declaration.py), and the rows that figures and sentences use."""

from __future__ import annotations

from typing import Any

from softlab.bench.measure.declaration import Experiment
from softlab.plots.core import colours
from softlab.plots.core.backends import name_of, on_backends, sources_of, timed
from softlab.plots.core.data import Results, Source
from softlab.plots.core.style import Drawing, legend_below, log_axes, new_figure


def panels(experiment: Experiment, results: Results) -> list[tuple[str, Source, list[Any]]]:
    """Return (backend, machine, rows) of the backends that were timed."""
    return on_backends(results, timed(experiment.rows))


def draw(experiment: Experiment, results: Results) -> Drawing | str:
    """Return the figure with a panel per backend, or the reason why there is none."""
    lines, chosen = experiment.figure, panels(experiment, results)
    assert lines is not None
    if not chosen:
        return f"not measured ({experiment.asked_by()})"
    figure, axes = new_figure(len(chosen), 3.0, sharey=False)
    for ax, (backend, source, rows) in zip(axes, chosen, strict=True):
        drawn = [row for row in rows if lines.select(row)]
        for key, (label, colour, marker) in lines.styles.items():
            for dash, line in lines.dashes.items():
                places = [
                    (getattr(row, lines.x), getattr(row, lines.y)) for row in drawn if lines.keys(row) == (key, dash)
                ]
                if places:
                    style = {"color": getattr(colours, colour.upper()), "marker": marker}
                    ax.plot(*zip(*places, strict=True), line, label=label if line == "-" else None, **style)
        log_axes(ax, x_label=lines.x_label)
        ax.set_title(name_of(backend, source), fontsize=8)
    axes[0].set_ylabel(lines.y_label)
    legend_below(figure, axes, columns=2)
    return Drawing(figure, lines.caption, sources_of(chosen), lines.title)
