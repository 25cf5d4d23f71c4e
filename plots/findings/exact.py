"""The finding about `exact` math: what the same bits everywhere cost."""

from __future__ import annotations

from plots.core.data import Results
from plots.core.style import BLUE, GREEN, GREY, Drawing, legend_below, log_axes, new_figure, plain_ticks
from plots.findings.points import exact_pairs, source_with

TITLE = "What exact math costs"
CURVES = {  # backend, precision: label, colour, marker, line
    ("cpu", "float32"): ("CPU, float32", BLUE, "o", "-"),
    ("cpu", "float64"): ("CPU, float64", BLUE, "s", "--"),
    ("gpu", "float32"): ("GPU, float32", GREEN, "D", "-"),
    ("gpu", "float64"): ("GPU, float64", GREEN, "v", "--"),
}


def draw(results: Results) -> Drawing | str:
    """The figure, or why there is none."""
    source = source_with(results, lambda s: any(exact_pairs(s, *key) for key in CURVES))
    if source is None:
        return "exact and fast math were not both timed"
    figure, (ax,) = new_figure()
    for key, (label, colour, marker, line) in CURVES.items():
        pairs = exact_pairs(source, *key)
        if not pairs:
            continue
        x = [fast.particles for fast, _ in pairs]
        ax.plot(
            x, [exact.median / fast.median for fast, exact in pairs], line, marker=marker, color=colour, label=label
        )
        for n, (fast, exact) in zip(x, pairs, strict=True):
            ax.plot([n, n], [exact.low / fast.high, exact.high / fast.low], color=colour, linewidth=0.8)
    ax.axhline(1, color=GREY, linewidth=1, zorder=1)
    log_axes(ax, "time in exact / time in fast math")
    plain_ticks(ax.yaxis)
    legend_below(figure, [ax])
    caption = (
        "Time of a step of velocity Verlet in exact math (nothing contracted, approximated or reordered: the same bits for "
        "every thread count, kernel and backend) over that in fast math, side by side. Bars: the repeats' extremes."
    )
    return Drawing(figure, TITLE, caption, (source,))
