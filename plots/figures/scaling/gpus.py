"""Figure of the speed-up of several GPUs over one, with the model, and of the energy of a step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from softlab.bench.experiments.scaling.experiment import BY_TURNS, Scaling, speedups, weak_efficiencies
from softlab.bench.measure.case_timing import Row
from softlab.bench.store.results import Measure
from softlab.plots.core.backends import timed
from softlab.plots.core.colours import BLUE, GREY, ORANGE, PURPLE, VERMILLION
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import LONG_LABEL, Drawing, as_figure, legend_below, log_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINKS = {"flags": (BLUE, "o"), "nccl": (ORANGE, "s")}
PER_MILLION = 1e9  # mJ per million mass-steps over J per mass-step


def shared(measures: Iterable[Measure]) -> list[Row]:
    """Return the points of sheets on several GPUs, and of one GPU with them; empty if there are no several GPUs."""
    scaled = Scaling().rows(measures)
    return scaled if any(p.gpus > 1 and not p.link.endswith(BY_TURNS) for p in scaled) else []


timed_shared = timed(shared)


def masses(p: Row) -> int:
    """Return the masses of the sheet."""
    return p.rows * p.columns


def on_several_gpus(results: Results) -> list[tuple[Source, list[Row]]]:
    """Return the machines that distributed a sheet among GPUs and their points: the reader's first, then those with most
    points. Raises NotMeasured."""
    machines = [(source, timed_shared(source, "gpu")) for source in results.everyone]
    return sorted(needed([one for one in machines if one[1]]), key=lambda one: (not one[0].by_user, -len(one[1])))


@as_figure("gpus", "Several GPUs", "no sheet was timed on several GPUs (softlab sweep --gpus 2)")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    source, measured = on_several_gpus(results)[0]
    figure, (faster, joules) = new_figure(2, 2.2, sharey=False)
    _draw_faster(faster, measured)
    for gpus, colour in ((1, GREY), *((n, BLUE) for n in sorted({p.gpus for p in measured} - {1}))):
        runs = [p for p in measured if p.gpus == gpus and p.sheet == "grid" and p.link in ("", "flags") and p.joules]
        if runs:
            each = sorted((masses(p), PER_MILLION * p.joules / masses(p)) for p in runs if p.joules)
            joules.plot(*zip(*each, strict=True), "-", color=colour, marker="o", label="one GPU" if gpus == 1 else None)
    joules.set_xscale("log")
    joules.set_xlabel("masses")
    joules.set_ylim(0, 1.1 * joules.get_ylim()[1])  # otherwise the uppermost marker is cut
    joules.set_ylabel("mJ / million mass-steps", fontsize=LONG_LABEL)
    legend_below(figure, [faster, joules], columns=4)
    caption = (
        "Left: how many times as fast as one GPU several step the same sheet, float32: a grid, by how its borders travel; a "
        "cloth of constraints (XPBD by colours); and one grid per GPU (weak scaling), over one GPU's rate with one. "
        "Dashed: the model. Right: their total energy (grey: one GPU)."
    )
    return Drawing(figure, caption, (source,))


def _draw_faster(ax: Axes, measured: Sequence[Row]) -> None:
    over_one, weak = speedups(measured), weak_efficiencies(measured)
    counts = sorted({p.gpus for p in measured} - {1})
    for gpus in counts:
        for link, (colour, marker) in LINKS.items():
            curve = [
                (masses(p), faster) for p, faster, _ in over_one if (p.gpus, p.link, p.sheet) == (gpus, link, "grid")
            ]
            if curve:
                ax.plot(*zip(*curve, strict=True), "-", color=colour, marker=marker, label=f"{gpus} GPUs, {link}")
        by_model = [(masses(p), model) for p, _, model in over_one if model and (p.gpus, p.link) == (gpus, "flags")]
        if by_model:
            ax.plot(*zip(*by_model, strict=True), "--", color=BLUE, label=f"{gpus} GPUs, model")
        cloth = [
            (masses(p), faster)
            for p, faster, _ in over_one
            if p.gpus == gpus and p.sheet == "xpbd" and p.link == "flags"
        ]
        if cloth:
            ax.plot(*zip(*cloth, strict=True), linestyle="", color=PURPLE, marker="D", label=f"{gpus} GPUs, cloth")
        grids = [
            (masses(p), gpus * weak[id(p)]) for p in measured if id(p) in weak and p.gpus == gpus and p.link == "flags"
        ]
        if grids:
            label = f"{gpus} GPUs, a grid each"
            ax.plot(*zip(*grids, strict=True), linestyle="", color=VERMILLION, marker="v", label=label)
        ax.axhline(gpus, color=GREY, linewidth=1, zorder=1)
    log_axes(ax)
    ax.set_yscale("linear")
    ax.set_ylim(0, 1.2 * max(counts))
    ax.set_ylabel("times one GPU")
