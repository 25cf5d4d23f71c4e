"""Figure of the hard cases of bodies: each measured number over its bound."""

from __future__ import annotations

import numpy as np

from softlab.bench.stress.results import BODIES, HardRow, StoredCheck, rows_of
from softlab.plots.core.colours import BLACK, BLUE, ORANGE, SKY, VERMILLION
from softlab.plots.core.data import Results, Source, judgements, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, new_sheet
from softlab.plots.figures.hard import PANEL

STYLES = {  # backend, precision -> colour, marker
    ("cpu", "float64"): (BLUE, "o"), ("cpu", "float32"): (ORANGE, "s"),
    ("gpu", "float64"): (SKY, "D"), ("gpu", "float32"): (VERMILLION, "^"),
}  # fmt: skip
ROW = 0.16  # inch: height of a row of the figure of bounds
LEAST = 1e-4  # of its bound: smaller values, and 0, are drawn there
OVERSHOT = 10.0  # of its bound: larger values, and values that are not finite, are drawn there


def body_rows(results: Results) -> tuple[list[HardRow], tuple[Source, ...]]:
    """Return the verdicts of bodies, and their sources: featured ones first, those of each backend from one machine."""
    selected, sources = judgements(results, lambda measure: measure.description.get("hard", "") in BODIES)
    return rows_of(selected), sources


def bound_ratio(check: StoredCheck) -> float | None:
    """Return a number over its bound, or the bound over it for a lower bound; None without a bound."""
    relation, _, rest = check.bound.partition(" ")
    if relation not in ("<", ">"):
        return None
    bound = float(rest.split()[0])
    if check.value is None:
        return np.inf
    if relation == "<":
        return max(check.value, 0.0) / bound if bound > 0 else np.inf
    return bound / check.value if check.value > 0 else np.inf


def worst(row: HardRow) -> float | None:
    """Return the largest such ratio of a run."""
    return max((part for check in row.checks if (part := bound_ratio(check)) is not None), default=None)


@as_figure("hard-bodies", "Bodies against their bounds", "the hard cases of bodies were not run")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none; a row per case: the run's number nearest to its bound, over
    that.
    """
    rows, sources = body_rows(results)
    judged = needed([(row, part) for row in rows if (part := worst(row)) is not None])
    names = list(dict.fromkeys(row.case for row, _ in judged))
    titles = {row.case: row.in_full for row, _ in judged}
    figure = new_sheet(max(PANEL, ROW * (len(names) + 6)))
    ax = figure.subplots()
    for (backend, precision), (colour, marker) in STYLES.items():
        points = [
            (names.index(row.case), part)
            for row, part in judged
            if (row.backend, row.precision) == (backend, precision)
        ]
        if points:
            y, x = np.array([place for place, _ in points]), np.array([part for _, part in points])
            label = f"{backend.upper()} {precision}"
            ax.plot(np.clip(x, LEAST, OVERSHOT), y, marker, color=colour, linestyle="", label=label, markersize=4)
    ax.axvline(1.0, color=BLACK, linewidth=0.8)
    ax.set_xscale("log")
    ax.set_xlim(LEAST / 2, 2 * OVERSHOT)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.set_yticks(range(len(names)), [titles[name] for name in names], fontsize=7.5)
    ax.set_xlabel("measured over its bound")
    legend_below(figure, [ax])
    caption = (
        "Of each run, the judged number that comes nearest to its bound, over that; of one that must be more, the bound over "
        "it. Right of the line is a failure. Under 1e-4, or 0: at the left edge; over 10: at the right one."
    )
    return Drawing(figure, caption, sources)
