"""Figure of energy: joules per million mass-steps of every kernel, where the machine counts them."""

from __future__ import annotations

from softlab.bench.store.results import Timing
from softlab.plots.core.backends import sources_of
from softlab.plots.core.data import Results, Source
from softlab.plots.core.ladder import backend_panels, in_order, rung
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, plain_ticks

MILLION = 1e6


def joules(source: Source, timing: Timing) -> float | None:
    """Return joules per million mass-steps [J] of a forced kernel's configuration; None where they were not counted."""
    sample = source.energies.get(timing.configuration)
    if sample is None or sample.joules_per_step is None:
        return None
    return MILLION * sample.joules_per_step / timing.particles


def watts(source: Source, timing: Timing) -> float | None:
    """Return the mean power [W] during the energy measurement."""
    sample = source.energies.get(timing.configuration)
    if sample is None or sample.joules_per_step is None:
        return None
    return sample.joules_per_step / sample.median


def counted_joules(source: Source, backend: str) -> list[tuple[Timing, float]]:
    """Return the timings of a backend's kernels with their joules, where they have them."""
    every = (t for times in source.ladder(backend).values() for t in times)
    return [(t, j) for t in every if (j := joules(source, t)) is not None]


NOT_COUNTED = (
    "no joules were counted: the machine has no energy counter that may be read, or the kernels were not timed"
)


@as_figure("joules", "Energy of every kernel", NOT_COUNTED)
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    figure, chosen = backend_panels(results, lambda source, backend: bool(counted_joules(source, backend)))
    for ax, backend, source in chosen:
        for kernel, timings in in_order(source.ladder(backend)):
            points = [(t.particles, j) for t in timings if (j := joules(source, t)) is not None]
            curve = rung(kernel)
            if points:
                x, y = [n for n, _ in points], [j for _, j in points]
                ax.plot(x, y, linestyle=curve.line, color=curve.colour, marker=curve.marker, label=curve.label)
        log_axes(ax)
    plain_ticks(chosen[0][0].yaxis)
    chosen[0][0].set_ylabel("J per million mass-steps")
    legend_below(figure, [ax for ax, *_ in chosen])
    caption = (
        "Energy of a million mass-steps with each kernel, float32, over about a second of stepping, by the device's own "
        "counter. It includes the idle power, so that a slow kernel pays for the time it takes."
    )
    return Drawing(figure, caption, sources_of(chosen))
