"""Figure of tetrahedra without a solver: the error of a mesh, by its triangulation, and the damping of a step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.bench.experiments.tetrahedral.cantilever import SECOND
from softlab.bench.experiments.tetrahedral.meshes import MESH, STEP, Mesh, Step, meshes, steps
from softlab.plots.core.colours import BLACK, BLUE, GREY, METHODS, ORANGE, VERMILLION
from softlab.plots.core.data import Results, judgements, needed
from softlab.plots.core.style import Drawing, PointStyle, as_figure, legend_below, log_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKERS = {5: ("o", "-"), 6: ("s", ":")}
RATIOS = {0.3: BLUE, 0.45: ORANGE, 0.499: VERMILLION}
SOLVERS = {
    "newton": ("newton", METHODS["newton"], "D"),
    SECOND: ("newton of order 2", METHODS["newton of order 2"], "v"),
    "vbd": ("vertex block descent", METHODS["vertex block descent"], "^"),
    "xpbd": ("position-based, one sweep", METHODS["xpbd"], "o"),
}


@as_figure("tetrahedra-mesh", "Errors of meshes and steps alone")
def draw(results: Results) -> Drawing:
    """Return the figure with meshes on the left and steps on the right, or the reason why there is none."""
    selected, sources = judgements(results, lambda measure: measure.description.get("finding") in (MESH, STEP))
    meshed, stepped = meshes(selected), steps(selected)
    needed(meshed or stepped, "meshes of tetrahedra were not measured (softlab tetrahedra)")
    figure, (left, right) = new_figure(2, 2.9, sharey=False)
    _meshes(left, meshed)
    _steps(right, [step for step in stepped if step.backend == stepped[0].backend])
    legend_below(figure, [left, right], columns=3)
    caption = (
        "Left: the sag of a clamped bar under a tip load, solved to the end on its mesh, over the continuum's (grey), by "
        "voxels across; five tetrahedra to a voxel (solid) and six (dotted). Right: the loss of amplitude of an "
        "undamped oscillation of the bar, against the substep, and the laws of implicit Euler and of order 2 "
        "(dashed); with "
        "too little to do a position-based bar is softer, swings slower and loses less. float64."
    )
    return Drawing(figure, caption, sources)


def _meshes(ax: Axes, all_meshes: list[Mesh]) -> None:
    for cut, (marker, line) in MARKERS.items():
        for ratio, colour in RATIOS.items():
            curve = [mesh for mesh in all_meshes if (mesh.cut, mesh.poisson) == (cut, ratio)]
            if curve:
                how: PointStyle = {"color": colour, "marker": marker, "linestyle": line, "markersize": 4}
                ax.plot(
                    [m.across for m in curve], [m.part for m in curve], label=f"{cut} a voxel, ratio {ratio:g}", **how
                )
    ax.axhline(1, color=GREY, linewidth=0.7, zorder=1)
    ax.set_xscale("log")
    ticks = sorted({mesh.across for mesh in all_meshes})
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("voxels across the bar")
    ax.set_ylabel("sag / the continuum's")


def _steps(ax: Axes, all_steps: list[Step]) -> None:
    for solver, (label, colour, marker) in SOLVERS.items():
        curve = [step for step in all_steps if step.solver == solver and step.decay > 0]
        if curve:
            ax.plot(
                [1e3 * s.h for s in curve],
                [s.decay for s in curve],
                color=colour,
                marker=marker,
                markersize=4,
                label=label,
            )
    laws = [
        sorted({(1e3 * s.h, s.law) for s in all_steps if (s.solver == SECOND) == second}) for second in (False, True)
    ]
    for number, points in enumerate(law for law in laws if law):
        named: PointStyle = {} if number else {"label": "what its scheme should lose"}
        ax.plot(*zip(*points, strict=True), "--", color=BLACK, linewidth=1, **named)
    log_axes(ax, x_label="substep / ms", plain=True)
    ax.set_ylabel("amplitude lost / (1/s)")
