"""Figure of every kernel of each backend: time per step against masses, and the limit of one step per pass over memory."""

from __future__ import annotations

from softlab.bench.store.results import Timing
from softlab.plots.core.backends import sources_of
from softlab.plots.core.bandwidth import copy_bandwidth, disturbed
from softlab.plots.core.colours import BLACK
from softlab.plots.core.data import Results
from softlab.plots.core.ladder import backend_panels, in_order, mark_switches, rung, threading_words
from softlab.plots.core.style import Drawing, as_figure, draw_times, legend_below, log_axes, time_ticks


@as_figure("kernels", "Every kernel", "the kernels were not timed one by one (softlab sweep --kernels)")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    figure, chosen = backend_panels(results, sharey=False)
    times: list[Timing] = []
    switches = False
    for ax, backend, source in chosen:
        for kernel, timings in in_order(source.ladder(backend)):
            draw_times(ax, timings, rung(kernel))
            times += timings
        bandwidth = copy_bandwidth(source, backend)
        sizes = {
            t.particles: t.bytes_per_step for t in source.kernels if t.backend == backend and t.precision == "float32"
        }
        roof = [(n, moved / bandwidth) for n, moved in sorted(sizes.items()) if moved and bandwidth]
        log_axes(ax)
        low, high = ax.get_ylim()
        x, y = [n for n, _ in roof], [seconds for _, seconds in roof]
        ax.plot(x, y, "--", color=BLACK, linewidth=1, label="one step per pass", zorder=2)
        ax.set_ylim(low, high)  # at small sizes the roof lies far below every time
        time_ticks(ax.yaxis)
        switches = mark_switches(ax, source, backend) or switches
    chosen[0][0].set_ylabel("time per step")
    legend_below(figure, [ax for ax, *_ in chosen], times)
    marks = "Dotted lines: where the kernel changes that the backend chooses by itself. " if switches else ""
    doubted = [backend.upper() for _, backend, source in chosen if disturbed(source)]
    doubt = f" (of the {' and the '.join(doubted)} beside other programs: too slow)" if doubted else ""
    caption = (
        "Time of one step of the square grid with each kernel, float32: medians, and bands from the least to the "
        f"greatest repeat. Dashed: what one step per pass over memory takes at the measured copy bandwidth{doubt}; kernels "
        f"that do several steps per pass, or stay on the chip, go below it. {marks}{threading_words(chosen)}"
    )
    return Drawing(figure, caption, sources_of(chosen))
