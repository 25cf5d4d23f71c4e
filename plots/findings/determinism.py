"""Figure of the cost of determinism: gathering in a fixed order compared with scattering."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.bench.experiments.findings.determinism import DETERMINISM
from softlab.plots.core.backends import on_backends, sources_of
from softlab.plots.core.colours import BLUE, GREEN, GREY, ORANGE, VERMILLION
from softlab.plots.core.data import Results, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_figure, plain_ticks
from softlab.plots.findings.points import Cost, costs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES = {  # backend, variant -> label, colour, marker
    ("cpu", "colours"): ("CPU, scatter in colours", BLUE, "o"),
    ("cpu", "twice"): ("CPU, gather, each spring twice", ORANGE, "^"),
    ("gpu", "atomics"): ("GPU, scatter with atomics", VERMILLION, "X"),
    ("gpu", "colours"): ("GPU, scatter in colours", GREEN, "D"),
}
LINES = {"float32": "-", "float64": "--"}
NAMES = {"cpu": "CPU, over the kernel fused", "gpu": "GPU, over the kernel graph"}


@as_figure("findings-determinism", "What determinism costs", "gather and scatter were not timed side by side")
def draw(results: Results) -> Drawing:
    """Return the figure with a panel per backend, or the reason why there is none."""
    chosen = needed(on_backends(results, lambda source, backend: costs(source, DETERMINISM, backend)))
    figure, axes = new_figure(len(chosen), 3.0, sharey=False)
    for ax, (backend, _, measured) in zip(axes, chosen, strict=True):
        _panel(ax, backend, measured)
    axes[0].set_ylabel("time / time of the lab's gather")
    legend_below(figure, axes, columns=2)
    caption = (
        "Time of a step when each spring adds its pull to both of its masses (scatter), or when each mass evaluates all of "
        "its springs itself, over that of the lab's kernel of one pass a step, sampled in turn. Over 1: the lab's gather "
        "is faster. All but the atomic additions repeat bit for bit. Solid: float32, dashed: float64. Bars: extremes."
    )
    return Drawing(figure, caption, sources_of(chosen))


def _panel(ax: Axes, backend: str, measured: list[Cost]) -> None:
    for (its, variant), (label, colour, marker) in STYLES.items():
        for precision, line in LINES.items():
            curve = [c for c in measured if (c.backend, c.variant, c.precision) == (its, variant, precision)]
            if not curve:
                continue
            ax.plot(
                [c.particles for c in curve], [c.ratio for c in curve], line, marker=marker, color=colour,
                label=f"{label}, {precision}",
            )  # fmt: skip
            for c in curve:
                ax.plot([c.particles] * 2, [c.least, c.most], color=colour, linewidth=0.8)
    ax.axhline(1, color=GREY, linewidth=1, zorder=1)
    log_axes(ax)
    plain_ticks(ax.yaxis)
    ax.set_title(NAMES[backend])
