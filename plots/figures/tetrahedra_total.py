"""Figure of a bar's total error, of mesh and solver, against the time of a frame, for each mesh and Young's modulus."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from softlab.bench.experiments.tetrahedral.bars import Bar, bars, of_one_version
from softlab.bench.experiments.tetrahedral.decides import moves
from softlab.plots.core.backends import name_of, on_backends, sources_of
from softlab.plots.core.colours import BLUE, GREEN, ORANGE, PURPLE
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, log_axes, new_grid
from softlab.plots.figures.tetrahedra import MISSING
from softlab.plots.figures.tetrahedra_decides import STYLES, frontier, kind_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MESHES = {50: ORANGE, 400: PURPLE, 3200: BLUE, 25600: GREEN}  # tetrahedra -> colour
MOST = 10.0  # larger errors are drawn there


def on(source: Source, backend: str) -> list[Bar]:
    """Return the bars of a backend with an error at rest, of one version of the kernels."""
    measured = of_one_version([b for b in bars(source.measures) if b.backend == backend])
    return [b for b in measured if isfinite(b.solver_error) and moves(b) and not b.wrong]


@as_figure("tetrahedra-total", "Total error of a bar of tetrahedra against the time of a frame")
def draw(results: Results) -> Drawing:
    """Return the figure, a row per backend and a column per Young's modulus, or the reason why there is none."""
    chosen = on_backends(results, on)
    moduli = sorted(needed({bar.young for _, _, measured in chosen for bar in measured}, MISSING))
    figure, rows = new_grid(len(chosen), len(moduli), 1.0 + 1.2 * len(chosen))
    drawn: list[Bar] = []
    for axes, (backend, _, measured) in zip(rows, chosen, strict=True):
        for ax, young in zip(axes, moduli, strict=True):
            here = [bar for bar in measured if bar.young == young]
            drawn += _panel(ax, here)
            if not here:
                ax.tick_params(bottom=False, labelbottom=False, which="both")
                ax.text(0.5, 0.5, "not measured", transform=ax.transAxes, ha="center", fontsize=8)
            ax.set_title(f"E = {young:.0e} Pa, {backend.upper()}".replace("e+0", "e"), fontsize=8)
        axes[0].set_ylabel("mesh + solver")
    for ax in rows[-1]:
        ax.set_xlabel("time of a frame / ms")
    first = rows[0][0]
    for elements, colour in MESHES.items():
        if any(bar.elements == elements for bar in drawn):
            first.plot([], [], color=colour, label=f"{elements} tetrahedra")
    for solver, (label, _, marker) in STYLES.items():
        if any(kind_of(bar) == solver for bar in drawn):
            first.plot([], [], marker, color="#555555", label=label)
    legend_below(figure, rows[0], columns=3)
    clipped = any(bar.total_error > MOST for bar in drawn)
    caption = (
        "The clamped bar at rest: largest error of its sag against the continuum, of the mesh and of the solver (the sum of "
        "their magnitudes), against the time of a frame of 1/60 s. A colour is a mesh, a marker a solver; for each "
        "mesh the settings of its Pareto front, of one version of the kernels on each processor. "
        f"{f'Errors over {MOST:g} are drawn there. ' if clipped else ''}"
        f"{'; '.join(name_of(backend, source) for backend, source, _ in chosen)}."
    )
    return Drawing(figure, caption, sources_of(chosen))


def _panel(ax: Axes, measured: list[Bar]) -> list[Bar]:
    """Draw the frontiers of a panel, and return their bars."""
    drawn = []
    for elements, colour in MESHES.items():
        front = frontier([bar for bar in measured if bar.elements == elements], lambda bar: bar.total_error)
        drawn += front
        x, y = [1e3 * b.seconds for b in front], [min(b.total_error, MOST) for b in front]
        ax.plot(x, y, color=colour, linewidth=0.9)
        for bar in front:
            marker = STYLES[kind_of(bar)][2]
            ax.plot(1e3 * bar.seconds, min(bar.total_error, MOST), marker, color=colour, markersize=3.5)
    log_axes(ax, x_label="", plain=True)
    return drawn
