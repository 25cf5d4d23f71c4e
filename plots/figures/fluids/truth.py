"""Figure of error against time of fluids: water at rest in a tank, a dam's front, and the numerical viscosity."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.bench.experiments.fluid_truth import laws
from softlab.bench.experiments.fluid_truth.rows import Judged, rows
from softlab.bench.experiments.fluid_truth.scenes import DAM, DAM_EFFORTS, TANK, VORTICES
from softlab.plots.core.backends import name_of, on_backends, sources_of
from softlab.plots.core.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, PointStyle, as_figure, legend_below, new_figure, plain_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# scheme -> colour, marker; others take the next of OTHERS
COLOURS = {"macklin": (BLUE, "o"), "averaged": (ORANGE, "s")}
OTHERS = ((GREEN, "^"), (VERMILLION, "D"), (PURPLE, "v"))
PEERS = "*P"  # markers
LINES = {"cpu": "--", "gpu": "-"}
WANTED = {TANK: 0.01, DAM: 0.05}  # black lines
CAPTION = (
    "Left: water at rest between four walls, 1000 particles, by 2 x 3 to 8 x 10 substeps x iterations of a frame of 1/60 s; "
    f"black: {WANTED[TANK]:.0%}. Middle: the front of Martin and Moyce's dam at their worst point, 10, 20 and 40 particles "
    f"wide; hollow: without their first point; black: {WANTED[DAM]:.0%}. Right: the viscosity with which Taylor and "
    "Green's vortices decay in a fluid without viscosity. Other programs take their own steps. float32, fast math."
)
LABELS = (
    ("time of a frame / ms", "mean density error"),
    ("time of a frame / ms", "worst error of the front"),
    ("rest distance / m", "viscosity by itself / (m²/s)"),
)


def on(source: Source, backend: str) -> list[Judged]:
    """Return the rows that were measured on a backend."""
    return [row for row in rows(source.measures) if row.backend == backend and row.numbers]


def styles_of(judged: list[Judged]) -> dict[str, tuple[str, str]]:
    """Return scheme or peer -> colour, marker."""
    schemes = list(dict.fromkeys(row.who for row in judged if not row.peer))
    peers = list(dict.fromkeys(row.who for row in judged if row.peer))
    others = iter(OTHERS)
    taken = {who: COLOURS[who] if who in COLOURS else next(others, (GREY, "x")) for who in schemes}
    return taken | {who: (BLACK, PEERS[n % len(PEERS)]) for n, who in enumerate(peers)}


def _points(judged: list[Judged], panel: int, who: str, name: str = laws.FRONT) -> list[tuple[float, float]]:
    """Return (x, y) of one line: the tank over its efforts, the dam (its error `name`) and the vortices over their
    spacings.
    """
    of_program = [row for row in judged if row.who == who]
    if panel == 2:
        selected = [row for row in of_program if row.kind == VORTICES]
        return sorted((row.spacing, row.numbers[laws.VISCOSITY]) for row in selected)
    kind, shown = ((TANK, laws.MEAN), (DAM, name))[panel]
    selected = [row for row in of_program if row.kind == kind and row.frame is not None and shown in row.numbers]
    if kind == DAM:
        selected = [row for row in selected if row.peer or (row.substeps, row.iterations) == DAM_EFFORTS[-1]]
    return sorted((1e3 * (row.frame or 0.0), row.numbers[shown]) for row in selected)


@as_figure("fluids-truth", "Fluids: error against time", "fluids were not judged: softlab fluids --truth")
def draw(results: Results) -> Drawing:
    """Return the figure with a panel each for tank, dam and vortices, or the reason why there is none."""
    chosen = needed(on_backends(results, on))
    figure, axes = new_figure(3, 2.9, sharey=False)
    everything = [row for _, _, judged in chosen for row in judged]
    styles = styles_of(everything)
    for panel, (ax, (x_label, y_label)) in enumerate(zip(axes, LABELS, strict=True)):
        for backend, _, judged in chosen:
            for who, (colour, marker) in styles.items():
                line = "" if colour == BLACK else LINES[backend]
                _line(ax, _points(judged, panel, who), line, colour, marker, colour)
                if panel == 1:
                    _line(ax, _points(judged, panel, who, laws.FRONT_LATER), line, colour, marker, "white")
        ax.set_xscale("log")
        plain_ticks(ax.xaxis)
        if panel != 1:
            ax.set_yscale("log")
            plain_ticks(ax.yaxis)
        ax.set_xlabel(x_label)
        ax.set_ylabel(y_label)
    axes[1].set_ylim(bottom=0.0)
    for ax, wanted in zip(axes, WANTED.values(), strict=False):
        ax.axhline(wanted, color=BLACK, linewidth=0.7, zorder=1)
    for who, (colour, marker) in styles.items():
        axes[0].plot([], [], marker, color=colour, markersize=5, label=who)
    for backend, source, _ in chosen:
        axes[0].plot([], [], LINES[backend], color=GREY, label=name_of(backend, source))
    legend_below(figure, axes, columns=3)
    return Drawing(figure, CAPTION, sources_of(chosen))


def _line(ax: Axes, points: list[tuple[float, float]], line: str, colour: str, marker: str, inside: str) -> None:
    if points:
        style: PointStyle = {"marker": marker, "markersize": 5, "markerfacecolor": inside}
        ax.plot(*zip(*points, strict=True), linestyle=line or "none", color=colour, **style)
