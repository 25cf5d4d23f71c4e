"""Fluids at rest: energy and rms speed of a still tank, and of a repeating box, over a minute."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from softlab.bench.experiments.fluid_rest import (
    BOX,
    DEPTH,
    DISTURBANCE,
    ENERGY_BOUND,
    SPACINGS,
    SPEED_BOUND,
    SUBSTEPS,
    TANK,
    VISCOSITIES,
    Still,
    rows,
)
from softlab.bench.experiments.fluid_truth.scenes import SCHEMES
from softlab.plots.core.backends import on_backends, sources_of
from softlab.plots.core.colours import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILLION
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import LONG_LABEL, Drawing, as_figure, legend_below, new_grid, plain_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = dict(zip(SUBSTEPS, (BLUE, GREEN, ORANGE, VERMILLION, PURPLE), strict=True))
LABELS = (("", "tank: rms / √(g H)"), ("", "tank: gain / g H"), ("time / s", "box: rms / √(g H)"))
CAPTION = (
    f"Rms speed and gain of energy of water {DEPTH:g} m deep between five planes (tank), and rms speed in a repeating box "
    f"whose particles begin {1e6 * DISTURBANCE:g} µm off their lattice; {100 * SPACINGS[0]:g} cm between particles, no "
    "viscosity, by substeps of a frame of 1/60 s with 10 iterations each. A point is the largest value since the one before. "
    f"Dotted: what is allowed, {100 * SPEED_BOUND:g} % and {ENERGY_BOUND:g}; black: DFSPH of SPlisHSPlasH in the same tank, "
    "by its own steps."
)


def on(source: Source, backend: str) -> list[Still]:
    """Return the runs on a backend at the first spacing and viscosity."""
    return [
        row
        for row in rows(source.measures)
        if row.backend == backend and row.speed and (row.spacing, row.viscosity) == (SPACINGS[0], VISCOSITIES[0])
    ]


@as_figure("fluids-rest", "Fluids at rest", "fluids at rest were not measured: softlab fluids --rest")
def draw(results: Results) -> Drawing:
    """Draw a column for each scheme: speeds and energies of the tank, speeds of the box; or return why not."""
    chosen = needed(on_backends(results, on)[:1])
    (_, _, still), *_ = chosen
    figure, axes = new_grid(3, len(SCHEMES), 4.4)
    for column, scheme in enumerate(SCHEMES):
        speed, energy, box = (row[column] for row in axes)
        speed.set_title(scheme)
        of_scheme = [row for row in still if row.peer or row.who == scheme]
        for row in of_scheme:
            colour = BLACK if row.peer else COLOURS[row.substeps]
            if row.kind == TANK:
                _line(speed, row.speed.items(), colour)
                _line(energy, row.energy.items(), colour)
            elif row.kind == BOX:
                _line(box, row.speed.items(), colour)
        for ax, bound in ((speed, SPEED_BOUND), (energy, ENERGY_BOUND), (box, SPEED_BOUND)):
            ax.axhline(bound, color=BLACK, linewidth=0.8, linestyle=":", zorder=1)
        for ax, (x_label, y_label) in zip((speed, energy, box), LABELS, strict=True):
            ax.set_xscale("log")
            plain_ticks(ax.xaxis)
            ax.set_xlabel(x_label)
            ax.set_ylabel(y_label if column == 0 else "", fontsize=LONG_LABEL)
        for ax in (speed, box):
            ax.set_yscale("log")
        energy.set_yscale("symlog", linthresh=ENERGY_BOUND)
    first = axes[0][0]
    for substeps, colour in COLOURS.items():
        first.plot([], [], color=colour, label=f"{substeps} substep{'s' * (substeps > 1)}")
    first.plot([], [], color=BLACK, label="SPlisHSPlasH DFSPH")
    legend_below(figure, [first], columns=3)
    return Drawing(figure, CAPTION, sources_of(chosen))


def _line(ax: Axes, points: Iterable[tuple[float, float]], colour: str) -> None:
    ax.plot(*zip(*sorted(points), strict=True), marker=".", markersize=3, linewidth=1, color=colour)
