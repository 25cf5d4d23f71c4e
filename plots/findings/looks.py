"""The finding about looking for a diverged state: what it costs beside the steps."""

from __future__ import annotations

from bench.experiments.findings_costs import LOOKS
from plots.core.costs_points import look_costs, source_of
from plots.core.data import Results
from plots.core.style import GREY, Drawing, legend_below, log_axes, new_figure
from plots.findings.exact import CURVES

TITLE = "What looking for a diverged state costs"
BOUND = 1.0  # per cent


def draw(results: Results) -> Drawing | str:
    """The figure: a look's share, and the times with looks over those without; or why there is none."""
    source = source_of(results, LOOKS, "gpu") or source_of(results, LOOKS)
    if source is None:
        return "looking for a diverged state was not timed"
    figure, axes = new_figure(2, 3.8, share_y=False)
    for k, ((backend, precision), (label, colour, marker, line)) in enumerate(CURVES.items()):
        found = [cost for cost in look_costs(source, backend) if cost.precision == precision]
        if not found:
            continue
        style = {"marker": marker, "color": colour, "label": label}
        axes[0].plot([c.particles for c in found], [100 * (c.share or 0) for c in found], line, **style)
        beside = [c.particles * 1.06 ** (k - 1.5) for c in found]  # so that the bars stand side by side
        axes[1].plot(beside, [100 * (c.ratio - 1) for c in found], linestyle="none", **style)
        for x, c in zip(beside, found, strict=True):
            axes[1].plot([x, x], [100 * (c.least - 1), 100 * (c.most - 1)], color=colour, linewidth=0.8)
    for ax, label in zip(
        axes, ("time of a look / time between two (%)", "with looks, more than without (%)"), strict=True
    ):
        log_axes(ax, label, log_y=ax is axes[0])
        ax.axhline(BOUND, color=GREY, linewidth=1, zorder=1)
    axes[0].set_title("a look by itself")
    axes[1].set_title("the same steps with and without")
    legend_below(figure, axes)
    caption = (
        "The state is looked at on its device every so many steps. Left: the time of a look, over that of the steps between "
        "two at their quickest. Right: the same steps with looks over those without any, sampled in turn; bars: the pairs' "
        f"extremes. Line: {BOUND:g} %."
    )
    return Drawing(figure, TITLE, caption, (source,))
