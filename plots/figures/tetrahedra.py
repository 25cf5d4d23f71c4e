"""Figure of a bar of tetrahedra: error of its solver at rest and in motion on its own mesh, by the time of a frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from softlab.bench.experiments.tetrahedral.bars import Bar, bars
from softlab.bench.experiments.tetrahedral.cantilever import BLOCKS, SECOND
from softlab.plots.core.backends import on_backends
from softlab.plots.core.colours import GREY, METHODS
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MISSING = "no bars of tetrahedra were measured (softlab tetrahedra)"
STYLES = {
    "substeps": ("position-based, one sweep a substep", METHODS["xpbd"], "o"),
    "iterations": ("position-based, several sweeps a substep", METHODS["xpbd"], "s"),
    BLOCKS: ("position-based, the shape as one block", METHODS["xpbd"], "P"),
    "vbd": ("vertex block descent", METHODS["vertex block descent"], "^"),
    "newton": ("newton", METHODS["newton"], "D"),
    SECOND: ("newton of order 2", METHODS["newton of order 2"], "v"),
}
PRECISIONS = {"float64": "-", "float32": ":"}
ERRORS: dict[str, Callable[[Bar], float]] = {
    "error at rest": lambda bar: bar.solver_error,
    "error in motion": lambda bar: bar.motion_error,
}
LEAST = 1e-5  # lower end of the axis; smaller errors are drawn there


def kind_of(bar: Bar) -> str:
    """Return the key of LOOKS of a bar."""
    if bar.solver != "xpbd":
        return bar.solver
    return "substeps" if bar.iterations == 1 else "iterations"


def middle(measured: Sequence[Bar]) -> list[Bar]:
    """Return the bars of the mesh with the most settings; of several such meshes, of the smallest."""
    sizes = [bar.elements for bar in measured]
    chosen = max(set(sizes), key=lambda size: (sizes.count(size), -size), default=0)
    return [bar for bar in measured if bar.elements == chosen]


def on(source: Source, backend: str) -> list[Bar]:
    """Return the bars of one mesh on a backend."""
    return middle([bar for bar in bars(source.measures) if bar.backend == backend])


@as_figure("tetrahedra", "Does E mean E?", MISSING)
def draw(results: Results) -> Drawing:
    """Return the figure, at rest and in motion, a panel per Young's modulus, or the reason why there is none.

    Of the backend with most measurements, the GPU if both have equally many.
    """
    chosen = needed(on_backends(results, on))
    backend, source, measured = max(chosen, key=lambda one: (len({bar.young for bar in one[2]}), one[0] == "gpu"))
    moduli = sorted({bar.young for bar in measured})
    figure, rows = new_grid(len(ERRORS), len(moduli), 3.9)
    for axes, (name, error) in zip(rows, ERRORS.items(), strict=True):
        for ax, young in zip(axes, moduli, strict=True):
            _panel(ax, [bar for bar in measured if bar.young == young], error)
        axes[0].set_ylabel(name)
    for ax, young in zip(rows[0], moduli, strict=True):
        ax.set_title(f"E = {young:.0e} Pa, {backend.upper()}".replace("e+0", "e"), fontsize=8)
    for ax in rows[-1]:
        ax.set_xlabel("time of a frame / ms")
    clipped = any(abs(error(bar)) < LEAST for bar in measured for error in ERRORS.values())
    there = {kind_of(bar) for bar in measured}
    for label, colour, marker in (style for kind, style in STYLES.items() if kind in there):
        rows[0][0].plot([], [], color=colour, marker=marker, label=label)
    rows[0][0].plot([], [], "--", color=GREY, label="error of the mesh")
    legend_below(figure, rows[0], columns=2)
    caption = (
        f"A clamped bar of {measured[0].elements} tetrahedra under its own weight, which grows with Young's modulus, so that "
        "all bars should sag alike, against the time of a frame of 1/60 s. Above: the difference of its sag at rest "
        "from the exact one of the same mesh, over that sag. Below: the error of the displacement of its tip half a "
        "vibration after release. Solid: float64, dotted: float32. Dashed: how far that exact rest is from the "
        "continuum's."
        f"{f' Errors under {LEAST:g} are drawn there.' if clipped else ''}"
    )
    return Drawing(figure, caption, (source,))


def _panel(ax: Axes, measured: Sequence[Bar], error: Callable[[Bar], float]) -> None:
    for precision, line in PRECISIONS.items():
        for kind, (_, colour, marker) in STYLES.items():
            curve = sorted(
                (b for b in measured if (kind_of(b), b.precision) == (kind, precision)), key=lambda b: b.seconds
            )
            if curve:
                x, y = [1e3 * b.seconds for b in curve], [max(abs(error(b)), LEAST) for b in curve]
                ax.plot(x, y, line, color=colour, marker=marker, markersize=3.5)
    if measured:
        ax.axhline(abs(measured[0].mesh_error), linestyle="--", color=GREY, linewidth=1)
    log_axes(ax, x_label="", plain=True)
