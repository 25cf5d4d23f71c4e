"""Figure of time per step against masses: threads at 1x, 2x and 4x of the cores, and the GPU."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from softlab.plots.core.colours import GREY
from softlab.plots.core.data import THREAD_WORDS, Results, Source
from softlab.plots.core.style import (
    GPU,
    GPU_PLAIN,
    THREADS,
    Curve,
    Dash,
    Drawing,
    as_figure,
    draw_times,
    legend_below,
    log_axes,
    panels,
    threading_note,
    time_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAIN = "launch"  # the kernel with one thread per mass and a launch for every step
PLAIN_TEXT = (
    "GPU: the kernel that is chosen by default; one thread per mass: the plain design of the hand-out (launch). "
)


@as_figure("time-per-step", "Time per step against size", "no timings without graphics")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    figure, chosen = panels(results, lambda source: any(not t.graphics for t in source.timings))
    times, plain = [], False
    for ax, source in chosen:
        behind = _draw_background(ax, results)
        for word in ("1", *THREAD_WORDS):
            curve = source.select("cpu", word)
            if curve:
                draw_times(ax, curve, THREADS[word])
                times += curve
        for on_gpu, style in ((source.ladder("gpu").get(PLAIN, []), GPU_PLAIN), (source.select("gpu"), GPU)):
            if on_gpu:
                draw_times(ax, on_gpu, style)
                times += on_gpu
                plain = plain or style is GPU_PLAIN
        log_axes(ax)
    chosen[0][0].set_ylabel("time per step")
    time_ticks(chosen[0][0].yaxis)
    legend_below(figure, [ax for ax, _ in chosen], times)
    sources = [source for _, source in chosen]
    caption = (
        "Time of one step of the square grid without graphics against its number of masses, float32: medians, and bands "
        f"from the fastest to the slowest repeat. {PLAIN_TEXT if plain else ''}{_threads_text(sources)}"
    )
    return Drawing(figure, caption, (*sources, *behind))


def _threads_text(sources: list[Source]) -> str:
    note = threading_note(sources)
    return f"CPU: {note}. " if note else ""


def _draw_background(ax: Axes, results: Results) -> list[Source]:
    """Draw committed curves behind the user's own: the GPU where there is one, and threads at 1x."""
    styles: Iterator[Dash] = iter(("--", ":", "-.", (0, (6, 2, 1, 2, 1, 2))))
    drawn = []
    for source in results.background:
        for backend, word, name in (("gpu", None, source.gpu), ("cpu", "1x", f"{source.processor}, 1x")):
            curve = source.select(backend, word)
            if curve:
                style = next(styles, "-")
                light = Curve(f"committed: {name}", GREY, "", style)
                draw_times(ax, curve, light, light=True)
                drawn.append(source)
    return drawn
