"""What float64 costs against float32."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bench.store.results import Timing
from plots.core.data import Results, Source, is_wrong
from plots.core.style import (
    BLUE,
    GPU,
    GREY,
    Curve,
    Drawing,
    draw_times,
    legend_below,
    log_axes,
    panels,
    plain_ticks,
)

TITLE = "float64 against float32"
CURVES = (("cpu", "1x", Curve("CPU, 1x threads", BLUE, "o")), ("gpu", None, GPU))


def float64_pairs(source: Source, backend: str, word: str | None) -> list[tuple[Timing, Timing]]:
    """(float32, float64) timings of one size, smallest first, where both gave right answers."""
    single = {(t.rows, t.columns): t for t in source.select(backend, word) if not is_wrong(t)}
    double = [t for t in source.select(backend, word, "float64") if not is_wrong(t)]
    return [(single[t.rows, t.columns], t) for t in double if (t.rows, t.columns) in single]


def draw(results: Results) -> Drawing | str:
    """The figure, or why there is none."""
    figure, chosen = panels(results, lambda s: any(float64_pairs(s, backend, word) for backend, word, _ in CURVES))
    if figure is None:
        return "float64 and float32 were not both timed"
    times: list[Timing] = []
    for ax, source in chosen:
        for backend, word, curve in CURVES:
            both = float64_pairs(source, backend, word)
            single = {t.configuration: s for s, t in both}
            mine = [t for _, t in both]
            if mine:
                draw_times(ax, mine, curve, _against(single))
                times += mine
        for level in (1, 2):
            ax.axhline(level, color=GREY, linewidth=1, linestyle="-" if level == 1 else ":", zorder=1)
        log_axes(ax)
        plain_ticks(ax.yaxis)
    chosen[0][0].set_ylabel("time in float64 / time in float32")
    legend_below(figure, [ax for ax, _ in chosen], times)
    sources = [source for _, source in chosen]
    caption = "Time of a step in float64 over float32 at the same size, square grids. The bytes are in the ratio 2. "
    return Drawing(figure, TITLE, caption, tuple(sources))


def _against(single: Mapping[str, Timing]) -> Callable[[Timing, float], float]:
    """Seconds over those of the float32 timing that belongs to a float64 configuration."""
    return lambda timing, seconds: seconds / single[timing.configuration].median
