"""Roofline: the fraction of the rate of one step per pass over memory that each kernel reaches, and the roof above it.

The bytes and operations of a step per mass are in model/core/plan.py. One step per pass takes at least the bytes over
the copy bandwidth: 100 %. A kernel that does several steps per pass, or keeps the grid on the chip, is limited by the
operations over the arithmetic rate instead: the second roof, which counts every operation, even a square root or a
quotient, as half of a multiply-add. Practice: Williams, Waterman, Patterson, "Roofline", 2009.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from softlab.bench.store.results import Timing
from softlab.model.base.errors import SoftlabError
from softlab.model.core.families import scene_plan
from softlab.model.scene.scene import Scene
from softlab.plots.core.backends import sources_of
from softlab.plots.core.bandwidth import copy_bandwidth, disturbed
from softlab.plots.core.colours import BLACK, GREY
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.ladder import backend_panels, in_order, rung
from softlab.plots.core.style import Drawing, as_figure, draw_times, legend_below, log_axes, plain_ticks


@dataclass(frozen=True)
class Ceilings:
    """Ceilings of one backend, machine, scene and precision.

    `bytes`, `operations` per mass and step; `bandwidth` [B/s]; `rate` [operations/s], None where it was not measured.
    """

    bytes: float
    operations: int
    bandwidth: float
    rate: float | None

    @property
    def pass_seconds(self) -> float:
        """Time per mass and step at the copy bandwidth, one step per pass [s]."""
        return self.bytes / self.bandwidth

    @property
    def arithmetic_seconds(self) -> float | None:
        """Time per mass and step at the arithmetic rate [s]."""
        return self.operations / self.rate if self.rate else None

    @property
    def arithmetic_fraction(self) -> float | None:
        """Arithmetic roof as a fraction of the one-step-per-pass roof."""
        return self.pass_seconds / self.arithmetic_seconds if self.arithmetic_seconds else None

    def fraction(self, timing: Timing, seconds: float | None = None) -> float:
        """Return the fraction of the one-step-per-pass roof that a timing reaches."""
        return self.pass_seconds * timing.particles / (timing.median if seconds is None else seconds)


def ceilings(source: Source, backend: str, precision: str = "float32") -> Ceilings | None:
    """Return the ceilings of a machine's kernels, or None if bandwidth or scene are unknown."""
    bandwidth = copy_bandwidth(source, backend)
    sample = next(
        (t for t in source.kernels if (t.backend, t.precision) == (backend, precision) and t.bytes_per_step), None
    )
    if not bandwidth or sample is None or not sample.bytes_per_step:
        return None
    try:
        grid = {"rows": sample.rows, "columns": sample.columns}
        scene = Scene.stored({name: table | (grid if name == "grid" else {}) for name, table in source.scene.items()})
        operations = scene_plan(scene).operations
    except SoftlabError:  # a scene of another version of the lab
        return None
    rates = source.machine.record.get("gpu_arithmetic" if backend == "gpu" else "arithmetic") or {}
    return Ceilings(sample.bytes_per_step / sample.particles, operations, bandwidth, rates.get(precision))


@as_figure("roofline", "Roofline", "the kernels were not timed one by one, or no copy bandwidth was measured")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    figure, chosen = backend_panels(results, lambda source, backend: ceilings(source, backend) is not None)
    times: list[Timing] = []
    words = []
    for ax, backend, source in chosen:
        roofs = needed(ceilings(source, backend))
        for kernel, timings in in_order(source.ladder(backend)):
            draw_times(ax, timings, rung(kernel), _percent(roofs))
            times += timings
        ax.axhline(100, color=GREY, linewidth=1.2, zorder=1, label="one step per pass")
        doubt = ", beside other programs" if disturbed(source) else ""
        if roofs.arithmetic_fraction and roofs.rate:
            ax.axhline(
                100 * roofs.arithmetic_fraction, color=BLACK, linestyle="--", linewidth=1, zorder=1, label="arithmetic"
            )
            words.append(
                f"{backend.upper()} {roofs.bandwidth / 1e9:.0f} GB/s and {roofs.rate / 1e9:.0f} G operations/s{doubt}"
            )
        else:
            words.append(
                f"{backend.upper()} {roofs.bandwidth / 1e9:.0f} GB/s{doubt} (its arithmetic rate was not measured)"
            )
        log_axes(ax)
        operations, moved = roofs.operations, roofs.bytes
    plain_ticks(chosen[0][0].yaxis)
    chosen[0][0].set_ylabel("share of one step per pass / %")
    legend_below(figure, [ax for ax, *_ in chosen], times)
    caption = (
        f"What each kernel reaches, float32, of one step per pass over memory ({moved:g} bytes a mass and step at the "
        f"copy bandwidth: 100\N{NO-BREAK SPACE}%), and the roof that the arithmetic sets ({operations} operations a mass "
        f"and step, each as half of a multiply-add: a bound that no kernel with quotients and roots can reach). "
        f"Measured limits: {', '.join(words)}."
    )
    return Drawing(figure, caption, sources_of(chosen))


def _percent(roofs: Ceilings) -> Callable[[Timing, float], float]:
    return lambda timing, seconds: 100 * roofs.fraction(timing, seconds)
