"""Figure of the tip's error against the time of a frame, for each solver, Young's modulus and size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from softlab.bench.experiments.tetrahedral.bars import Bar, bars, of_one_version
from softlab.bench.experiments.tetrahedral.cantilever import SECOND
from softlab.bench.experiments.tetrahedral.decides import positional
from softlab.bench.experiments.tetrahedral.promised import WITHIN
from softlab.plots.core.backends import name_of, on_backends, sources_of
from softlab.plots.core.colours import BLACK, GREY, METHODS
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_grid
from softlab.plots.figures.tetrahedra import MISSING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES = {
    "xpbd": ("position-based", METHODS["xpbd"], "o"),
    "vbd": ("vertex block descent", METHODS["vertex block descent"], "^"),
    "newton": ("newton", METHODS["newton"], "D"),
    SECOND: ("newton of order 2", METHODS["newton of order 2"], "v"),
}
LINES = {"cpu": "--", "gpu": "-"}
LEAST = 1e-4  # lower end of the axis; smaller errors are drawn there
SIZES = (400, 3200, 25600)
ACROSS = 3  # panels per row


def on(source: Source, backend: str) -> list[Bar]:
    """Return the bars of a backend, of SIZES."""
    return [bar for bar in bars(source.measures) if bar.backend == backend and bar.elements in SIZES]


def kind_of(bar: Bar) -> str:
    """Return the key of LOOKS of a bar."""
    return "xpbd" if positional(bar) else bar.solver


def frontier(measured: Sequence[Bar], error: Callable[[Bar], float] = lambda bar: abs(bar.motion_error)) -> list[Bar]:
    """Return the bars that no other beats in both time and error, fastest first."""
    front: list[Bar] = []
    for bar in sorted(measured, key=lambda b: b.seconds):
        if not front or error(bar) < error(front[-1]):
            front.append(bar)
    return front


@as_figure("tetrahedra-decides", "The error of the tip against the time of a frame")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none.

    A panel per size and Young's modulus, ACROSS per row, both backends.
    """
    chosen = on_backends(results, on)
    measured = needed([bar for _, _, of_panel in chosen for bar in of_panel], MISSING)
    panels = sorted({(b.elements, b.young) for b in measured})
    count = -(-len(panels) // ACROSS)
    figure, rows = new_grid(count, min(ACROSS, len(panels)), 1.0 + 1.15 * count)
    every = [ax for axes in rows for ax in axes]
    usual = {b.version for _, _, of_panel in chosen for b in of_one_version(of_panel)}
    other = False
    for ax, (size, young) in zip(every, panels, strict=False):
        of_panel = [b for b in measured if (b.elements, b.young) == (size, young)]
        mark = "*" if any(b.version not in usual for b in of_panel) else ""
        other = other or bool(mark)
        _panel(ax, of_panel)
        ax.set_title(f"{size} tetrahedra, E = {young:.0e} Pa{mark}".replace("e+0", "e"), fontsize=8)
    for ax in every[len(panels) :]:
        ax.set_axis_off()
    for axes in rows:
        axes[0].set_ylabel("error in motion")
    for ax in every[max(0, len(panels) - ACROSS) : len(panels)]:  # the lowest of each column
        ax.set_xlabel("time of a frame / ms")
    plot = partial(rows[0][0].plot, [], [])
    for solver, (label, colour, marker) in STYLES.items():
        if any(kind_of(b) == solver for b in measured):
            plot(color=colour, marker=marker, label=label)
    for backend, source, _ in chosen:
        plot(LINES[backend], color=GREY, label=name_of(backend, source))
    legend_below(figure, rows[0], columns=3)
    caption = (
        "The clamped bar released from its unloaded shape: the difference of the displacement of its tip after half a "
        "vibration from the modes of the same mesh, against the time of a frame of 1/60 s; for each solver the "
        f"settings of its Pareto front, in either precision. Black: {WITHIN:.0%}."
        f"{f' Errors under {LEAST:g} are drawn there.' if any(abs(b.motion_error) < LEAST for b in measured) else ''}"
        f"{' *: with times of another version of the kernels than the other panels.' if other else ''}"
    )
    return Drawing(figure, caption, sources_of(chosen))


def _panel(ax: Axes, measured: Sequence[Bar]) -> None:
    for solver, (_, colour, marker) in STYLES.items():
        for backend, line in LINES.items():
            front = frontier([b for b in measured if (kind_of(b), b.backend) == (solver, backend)])
            x, y = [1e3 * b.seconds for b in front], [max(abs(b.motion_error), LEAST) for b in front]
            if front:
                ax.plot(x, y, line, color=colour, marker=marker, markersize=3.5)
    ax.axhline(WITHIN, color=BLACK, linewidth=0.7, zorder=1)
    log_axes(ax, x_label="", plain=True)
