"""Figure of the crossover: the best CPU time over the GPU's, against masses, on one machine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from softlab.bench.store.results import Timing
from softlab.plots.core.apart import apart
from softlab.plots.core.colours import BLACK, GREEN, GREY, PURPLE
from softlab.plots.core.data import Results, Source, is_suspect, is_wrong, needed, sound
from softlab.plots.core.style import Drawing, as_figure, log_axes, new_figure, plain_ticks

MISSING = "no machine in the data has timed both a GPU and a CPU at one size with one version of the code"


@dataclass(frozen=True)
class Pair:
    """Fastest CPU timing and the GPU's, of one size.

    `ratio`: CPU time over GPU time; `low`, `high`: the smallest and largest that the repeats allow; `clear`: the times
    differ.
    """

    cpu: Timing
    gpu: Timing

    @property
    def ratio(self) -> float:
        return self.cpu.median / self.gpu.median

    @property
    def low(self) -> float:
        return self.cpu.low / self.gpu.high

    @property
    def high(self) -> float:
        return self.cpu.high / self.gpu.low

    @property
    def clear(self) -> bool:
        return apart(self.cpu, self.gpu) != 0


def pairs(source: Source, precision: str = "float32", *, graphics: bool = False) -> list[Pair]:
    """Return (fastest thread count of the CPU, GPU) at every square that both were timed at.

    Configurations with a wrong result do not compete.
    """
    best: dict[int, Timing] = {}
    for timing in source.timings:
        chosen = timing.backend == "cpu" and timing.precision == precision and timing.graphics == graphics
        if chosen and timing.rows == timing.columns and not is_wrong(timing):
            fastest = best.get(timing.particles)
            best[timing.particles] = timing if fastest is None or timing.median < fastest.median else fastest
    on_gpu = sound(source.select("gpu", None, precision, graphics=graphics))
    return [Pair(best[t.particles], t) for t in on_gpu if t.particles in best]


def crossing(compared: list[Pair]) -> float | None:
    """Return the masses at which the ratio last rises above 1, interpolated between two sizes; None if it does not."""
    result = None
    for left, right in pairwise(compared):
        if left.ratio < 1 <= right.ratio:
            fraction = math.log(1 / left.ratio) / math.log(right.ratio / left.ratio)
            result = left.gpu.particles * (right.gpu.particles / left.gpu.particles) ** fraction
    return result


@as_figure("crossover", "Where the GPU overtakes", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    source = needed(results.first(pairs))
    figure, (ax,) = new_figure(1, 2.1)
    for precision, colour, marker in (("float32", GREEN, "D"), ("float64", PURPLE, "P")):
        compared = pairs(source, precision)
        if not compared:
            continue
        x = [pair.gpu.particles for pair in compared]
        ax.fill_between(x, [p.low for p in compared], [p.high for p in compared], color=colour, alpha=0.18, linewidth=0)
        ax.plot(x, [p.ratio for p in compared], marker=marker, color=colour, label=precision)
        hollow = [p for p in compared if is_suspect(p.cpu) or is_suspect(p.gpu)]
        ax.plot(
            [p.gpu.particles for p in hollow], [p.ratio for p in hollow], marker, markerfacecolor="white",
            markeredgecolor=colour, label="suspect" if hollow and precision == "float32" else None,
        )  # fmt: skip
        where = crossing(compared)
        if where and precision == "float32":
            ax.plot([where], [1], "o", color=BLACK, zorder=5)
            ax.annotate(
                f"the GPU overtakes at about {float(f'{where:.1e}'):,.0f} masses".replace(",", " "), (where, 1), (10, -14),
                textcoords="offset points", fontsize=8,
            )  # fmt: skip
        elif precision == "float32":
            side = "faster" if compared[-1].ratio >= 1 else "slower"
            ax.set_title(
                f"no crossing: the GPU is {side} from the smallest size to the largest", loc="right", fontsize=8
            )
    ax.axhline(1, color=GREY, linewidth=1, zorder=1)
    log_axes(ax, "CPU time / GPU time")
    plain_ticks(ax.yaxis)
    ax.legend(loc="upper left")
    caption = (
        "Time of a step with the fastest of the CPU's thread counts over the GPU's, square grids without graphics; "
        "above 1 the GPU is faster."
    )
    return Drawing(figure, caption, (source,))
