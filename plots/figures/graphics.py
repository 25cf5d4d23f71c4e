"""Figure of the cost of drawing: time per step with a picture every few steps, and without."""

from __future__ import annotations

from softlab.bench.measure.timing import DRAW_EVERY
from softlab.bench.store.results import Timing
from softlab.plots.core.data import Results, Source
from softlab.plots.core.pairs import at_one_size
from softlab.plots.core.style import (
    GPU,
    THREADS,
    Curve,
    Drawing,
    as_figure,
    draw_times,
    legend_below,
    log_axes,
    panels,
    time_ticks,
)


@as_figure("graphics", "With against without graphics", "nothing was timed with graphics")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    figure, chosen = panels(results, lambda source: any(t.graphics for t in source.timings), skipped_reason(results))
    times: list[Timing] = []
    for ax, source in chosen:
        for backend, word, style in (("cpu", "1x", THREADS["1x"]), ("gpu", None, GPU)):
            name = "CPU, 1x threads" if backend == "cpu" else "GPU"
            without = source.select(backend, word)
            drawn = source.select(backend, word, graphics=True)
            draw_times(ax, without, Curve(f"{name}, without", style.colour, style.marker))
            draw_times(ax, drawn, Curve(f"{name}, with graphics", style.colour, "v" if word else "p", "--"))
            times += [*without, *drawn]
        log_axes(ax)
    chosen[0][0].set_ylabel("time per step")
    time_ticks(chosen[0][0].yaxis)
    legend_below(figure, [ax for ax, _ in chosen], times, columns=2)
    sources = [source for _, source in chosen]
    caption = (
        f"Time of one step alone, and with every {DRAW_EVERY} steps drawn off-screen (each spring a line), float32, "
        f"square grids."
    )
    return Drawing(figure, caption, tuple(sources))


def skipped_reason(results: Results) -> str:
    """Return why the featured machines have no timings with graphics, empty if the sweep did not record it."""
    for source in results.featured:
        for measure in source.measures:
            if measure.name == "skipped" and measure.description.get("graphics"):
                return measure.reason or ""
    return ""


def drawing_costs(source: Source, backend: str, word: str | None) -> list[tuple[Timing, Timing]]:
    """Return pairs (without, with) of one backend, smallest grid first."""
    return at_one_size(source.select(backend, word), source.select(backend, word, graphics=True))
