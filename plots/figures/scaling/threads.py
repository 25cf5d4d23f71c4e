"""Figure of thread scaling: speed-up of more threads over one, or over as many as cores."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from softlab.bench.store.results import Timing
from softlab.plots.core.colours import GREY
from softlab.plots.core.data import THREAD_WORDS, Results, Source, sound
from softlab.plots.core.style import (
    THREADS,
    Drawing,
    as_figure,
    draw_times,
    legend_below,
    log_axes,
    panels,
    plain_ticks,
)


def baseline(source: Source) -> str | None:
    """Return the thread count of comparison: one thread if it was timed, else 1x; None if neither was."""
    return next((word for word in ("1", "1x") if source.select("cpu", word)), None)


@as_figure("thread-scaling", "Thread scaling", "fewer than two thread counts were timed")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""

    def compares(source: Source) -> bool:
        base = baseline(source)
        return base is not None and any(word != base and source.select("cpu", word) for word in THREAD_WORDS)

    figure, chosen = panels(results, compares)
    times: list[Timing] = []
    words = set()
    for ax, source in chosen:
        base = baseline(source) or "1x"
        words.add("one thread" if base == "1" else "1x threads")
        bases = {(t.rows, t.columns): t for t in sound(source.select("cpu", base))}
        for word in THREAD_WORDS:
            timings = [t for t in source.select("cpu", word) if (t.rows, t.columns) in bases and word != base]
            if timings:
                draw_times(ax, timings, THREADS[word], _speed_up(bases))
                times += timings
        ax.axhline(1, color=GREY, linewidth=1, zorder=1)
        log_axes(ax)
        plain_ticks(ax.yaxis)
    against = " or ".join(sorted(words))
    chosen[0][0].set_ylabel(f"speed-up against {against}")
    legend_below(figure, [ax for ax, _ in chosen], times)
    sources = [source for _, source in chosen]
    cores = ", ".join(sorted({f"{s.machine.record.get('cores')} cores" for s in sources}))
    caption = (
        f"Speed-up of more threads against {against} at the same size, float32, square grids ({cores}); above 1 is "
        f"faster."
    )
    return Drawing(figure, caption, tuple(sources))


def _speed_up(bases: Mapping[tuple[int, int], Timing]) -> Callable[[Timing, float], float]:
    return lambda timing, seconds: bases[timing.rows, timing.columns].median / seconds
