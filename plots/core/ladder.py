"""Common parts of the figures of kernels: the machine of a backend, the style of a kernel, switches of the default."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

from softlab.bench.measure.cases import LADDER
from softlab.bench.store.results import Timing
from softlab.plots.core.backends import name_of, on_backends
from softlab.plots.core.colours import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, VIOLET
from softlab.plots.core.data import Results, Source, is_wrong, needed
from softlab.plots.core.style import Curve, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RUNGS = {
    "stages": Curve("stages", GREY, "v"),
    "launch": Curve("launch", PURPLE, "^"),
    "graph": Curve("graph", ORANGE, "s"),
    "one-block": Curve("one-block", VERMILLION, "P"),
    "resident": Curve("resident", GREEN, "D"),
    "tiles": Curve("tiles", BLUE, "o"),
    "fused": Curve("fused", SKY, "X"),
    "tiled": Curve("tiled", VIOLET, "<"),
    "team": Curve("team", BROWN, "*"),
}
OTHER = Curve("", BLACK, "h")  # a kernel without a style of its own


def rung(kernel: str) -> Curve:
    """Return the style of a kernel."""
    return RUNGS.get(kernel) or Curve(kernel, OTHER.colour, OTHER.marker)


def in_order(kernels: dict[str, list[Timing]]) -> list[tuple[str, list[Timing]]]:
    """Return the kernels from the plainest on, each with its timings."""
    return sorted(kernels.items(), key=lambda item: LADDER.index(item[0]) if item[0] in LADDER else len(LADDER))


def machine_of(results: Results, backend: str, holds: Callable[[Source], bool] = lambda _: True) -> Source | None:
    """Return the machine whose kernels represent a backend: a featured one, else a committed one."""
    return results.first(lambda s: s.ladder(backend) and holds(s))


def backend_panels(
    results: Results, holds: Callable[[Source, str], bool] = lambda *_: True, sharey: bool = True
) -> tuple[Figure, list[tuple[Axes, str, Source]]]:
    """Return a figure with a panel for each backend whose kernels were timed. Raises NotMeasured if there is none."""
    chosen = needed(on_backends(results, lambda source, backend: source.ladder(backend) and holds(source, backend)))
    figure, axes = new_figure(len(chosen), 2.8, sharey)
    panels = [(ax, backend, source) for ax, (backend, source, _) in zip(axes, chosen, strict=True)]
    for ax, backend, source in panels:
        ax.set_title(title(source, backend), fontsize=8)
    return figure, panels


def title(source: Source, backend: str) -> str:
    """Return e.g. `GPU: NVIDIA H200` or `CPU: Intel Xeon, 2 cores, 1x threads (committed)`."""
    threads = "" if backend == "gpu" else ", 1x threads"
    return f"{name_of(backend, source)}{threads}{source.label and ' (committed)'}"


def threading_words(chosen: list[tuple[Axes, str, Source]]) -> str:
    """Return the threading layer and wait policy of the CPU's panel, for a caption."""
    known = [source.threading for _, backend, source in chosen if backend == "cpu" and source.threading[0]]
    return "".join(f"CPU: threading layer {layer}, wait policy {policy}. " for layer, policy in known)


def defaults(source: Source, backend: str, precision: str = "float32") -> list[Timing]:
    """Return the kernel that the backend chooses at every size, smallest first; sizes without one are left out."""
    kernels = source.ladder(backend, precision)
    chosen = [t for times in kernels.values() for t in times if source.defaults.get(t.configuration)]
    return sorted(chosen, key=lambda t: t.particles)


def fastest(source: Source, backend: str) -> list[Timing]:
    """Return the kernel with the smallest median at every size, among those with a right result."""
    best: dict[int, Timing] = {}
    for times in source.ladder(backend).values():
        for t in times:
            if not is_wrong(t) and (t.particles not in best or t.median < best[t.particles].median):
                best[t.particles] = t
    return [best[n] for n in sorted(best)]


def mark_switches(ax: Axes, source: Source, backend: str) -> bool:
    """Mark where the backend's default kernel changes between two sizes; return False if it never does."""
    choices = defaults(source, backend)
    for left, right in pairwise(choices):
        if left.kernel != right.kernel:
            where = (left.particles * right.particles) ** 0.5
            ax.axvline(where, color=BLACK, linestyle=":", linewidth=0.8, zorder=1)
            for name, side, shift in ((left.kernel, "right", -2), (right.kernel, "left", 2)):
                ax.annotate(
                    name, (where, 1), (shift, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
                    fontsize=7, color="#555555", ha=side, va="top", rotation=90,
                )  # fmt: skip
    return len({t.kernel for t in choices}) > 1
