"""Figure of the cost of `softlab bar`: error of sag and frequency against the time of a frame, by method."""

from __future__ import annotations

from softlab.bench.experiments.bar_costs import CLOSE, Cost, costs
from softlab.plots.core.backends import name_of, on_backends, sources_of
from softlab.plots.core.colours import BLACK, GREY
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_figure
from softlab.plots.figures.bar import CURVES, MISSING

PARTS = {"sag off a rod's": lambda cost: cost.sag, "first frequency off a rod's": lambda cost: cost.frequency}
LINES = {"cpu": "--", "gpu": "-"}
LEAST = 1e-4  # lower end of the axis; smaller errors are drawn there


def on(source: Source, backend: str) -> list[Cost]:
    """Return the costs that were timed on a backend."""
    return [cost for cost in costs(source.measures) if cost.backend == backend]


def judged(source: Source, backend: str) -> list[Cost]:
    """Return the costs whose errors are known, too."""
    return [cost for cost in on(source, backend) if None not in (cost.sag, cost.frequency)]


@as_figure("bar-costs", "One bar: error against time", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none.

    A panel for each of PARTS, a line per method over its substeps, dashed on the CPU.
    """
    chosen = needed(on_backends(results, judged))
    figure, axes = new_figure(len(PARTS), 2.4, sharey=False)
    for ax, (name, part) in zip(axes, PARTS.items(), strict=True):
        for backend, _, methods in chosen:
            for solver, (label, colour, marker, _) in CURVES.items():
                points = [
                    (cost.frame, value)
                    for cost in methods
                    if cost.solver == solver and (value := part(cost)) is not None
                ]
                if points:
                    x, y = [1e3 * frame for frame, _ in points], [max(abs(value), LEAST) for _, value in points]
                    once = backend == chosen[0][0]
                    ax.plot(
                        x, y, LINES[backend], color=colour, marker=marker, markersize=4, label=label if once else None
                    )
        ax.axhline(CLOSE, color=BLACK, linewidth=0.7, zorder=1)
        log_axes(ax, x_label="time of a frame / ms", plain=True)
        ax.set_ylabel(name)
    for backend, source, _ in chosen:
        axes[0].plot([], [], LINES[backend], color=GREY, label=name_of(backend, source))
    legend_below(figure, axes, columns=3)
    errors = [
        value
        for _, _, methods in chosen
        for cost in methods
        for part in PARTS.values()
        if (value := part(cost)) is not None
    ]
    clipped = f" Errors under {LEAST:g} are drawn there." if any(abs(value) < LEAST for value in errors) else ""
    counts = ", ".join(str(n) for n in sorted({cost.substeps for _, _, methods in chosen for cost in methods}))
    caption = (
        f"The bar by each method, {counts} substeps of a frame of 1/60 s along each line: how far it is off the "
        f"closed form of a rod of its material. Black: {CLOSE:.0%}. float64, exact math.{clipped}"
    )
    return Drawing(figure, caption, sources_of(chosen))
