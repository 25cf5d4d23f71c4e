"""Figures of the hard cases: a contact sheet of end states, and the table of verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softlab.app.render.camera3d import Camera3D
from softlab.bench.stress.report import table_of
from softlab.bench.stress.results import BODIES, IN_FULL, OF_FLUIDS, OF_TETRAHEDRA, HardRow, rows_of
from softlab.plots.core.colours import BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION
from softlab.plots.core.data import Results, Source, judgements, needed
from softlab.plots.core.style import Drawing, as_figure, legend_below, new_sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACROSS = 6  # panels per row of the contact sheet
PANEL = 1.2  # inch: height of a panel
LINE = 0.112  # inch: height of a row of the verdict table
WIDEST = -3.2  # columns of the table for the titles of the cases
POINT = 1e-12  # m: a smaller shape is drawn as a point
PREFERRED = ("velocity-verlet", "lab", "xpbd gauss-seidel")  # methods whose end states are drawn
NOT_HARD = ""
NOT_OF_SHEETS = {NOT_HARD, *BODIES, *OF_TETRAHEDRA, *OF_FLUIDS}  # those of bodies: plots/figures/hard_bodies.py
SHORT = {" in float32": ", f32", " in float64": ", f64"}  # abbreviations in a cell
COLOURS = {"pass": GREEN, "refused": SKY, "known": ORANGE, "fail": VERMILLION}


def hard_rows(results: Results) -> tuple[list[HardRow], tuple[Source, ...]]:
    """Return the verdicts of sheets, and their sources: featured ones first, those of each backend from one machine."""
    selected, sources = judgements(results, lambda m: m.description.get("hard", NOT_HARD) not in NOT_OF_SHEETS)
    return rows_of(selected), sources


NOT_RUN = "the hard cases were not run"


@as_figure("hard-states", "Final states of the hard cases", NOT_RUN)
def draw_states(results: Results) -> Drawing:
    """Return the contact sheet, or the reason why there is none."""
    rows, sources = hard_rows(results)
    shown = needed(_shown(rows))
    lines = -(-len(shown) // ACROSS)
    figure = new_sheet(PANEL * lines)
    axes = list(figure.subplots(lines, ACROSS, squeeze=False).ravel())
    for ax in axes:
        ax.set_axis_off()
    for ax, row in zip(axes, shown, strict=False):
        _draw_shape(ax, row)
    legend_below(figure, axes)
    words = "; ".join(dict.fromkeys(f"{row.case}: {row.title}" for row in shown))
    caption = (
        f"The last state of each hard case, of {PREFERRED[0]} in float64, or of {PREFERRED[-1]} where constraints "
        "are the case, and one for each reason to fail; large grids are thinned, each panel to its own scale, the first row "
        f"of masses orange; cloths from the right and above. {words}."
    )
    return Drawing(figure, caption, sources)


@as_figure("hard-verdicts", "Verdicts of the hard cases", NOT_RUN)
def draw_verdicts(results: Results) -> Drawing:
    """Return the verdict table, a row per case and a column per method, or the reason why there is none."""
    rows, sources = hard_rows(results)
    names, lines = table_of(needed(rows))
    figure = new_sheet(max(PANEL, LINE * (len(lines) + 3)))
    ax = figure.subplots()
    ax.set_axis_off()
    ax.set_xlim(WIDEST, len(names))
    ax.set_ylim(len(lines), -0.1)
    for y, (case, _, _, cells) in enumerate(lines):
        ax.text(-0.05, y + 0.5, IN_FULL.get(case, case), ha="right", va="center", fontsize=7)
        for x, (verdict, text) in enumerate(cells):
            if not verdict:
                continue
            ax.fill([x + 0.02, x + 0.98, x + 0.98, x + 0.02], [y + 0.05, y + 0.05, y + 0.95, y + 0.95],
                    color=COLOURS[verdict], alpha=0.35, linewidth=0)  # fmt: skip
            for words, letters in SHORT.items():
                text = text.replace(words, letters)
            ax.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=7)
    for x, name in enumerate(names):
        ax.text(x + 0.5, -0.15, name.replace(" ", "\n").replace("-", "-\n"), ha="center", va="bottom", fontsize=7)
    ran = sorted({row.backend.upper() for row in rows})
    caption = (
        f"Verdicts on {' and '.join(ran)}, the worst over backends and precisions. Refused: with a diagnosis, before a step "
        "was done. Fails: implied by the method, with what it costs in the text; f32: in float32 alone. A failure in "
        "capitals is a bug of this lab."
    )
    return Drawing(figure, caption, sources)


def _shown(rows: Sequence[HardRow]) -> list[HardRow]:
    """Return a row per case, of the preferred integrator; and for each reason to fail the last case with it."""
    failing = [row for row in rows if row.shape and row.verdict in ("fail", "known")]
    failing.sort(key=lambda row: row.precision, reverse=True)  # float32, where more is visible, wins
    by_diagnosis = {row.diagnosis: row for row in failing}
    shown = []
    for case in dict.fromkeys(row.case for row in rows):
        drawn = [row for row in rows if row.case == case and row.shape]
        right = [row for name in PREFERRED for row in drawn
                 if row.integrator == name and row.verdict in ("pass", "refused")]  # fmt: skip
        shown += [*right[:1], *(row for row in by_diagnosis.values() if row.case == case)]
    return shown


def as_seen(position: np.ndarray) -> np.ndarray:
    """Return positions in the picture (..., 2) [m]: a grid unchanged, a cloth in the view of off-screen pictures.

    Without perspective.
    """
    return position if position.shape[-1] == 2 else position @ Camera3D(1, 1).axes[:2].T


def _draw_shape(ax: Axes, row: HardRow) -> None:
    assert row.shape is not None
    grid = as_seen(np.array(row.shape.position, dtype=float))
    centre, extent = framed(grid.reshape(-1, 2))
    grid = (grid - centre) / extent if extent > POINT else np.zeros_like(grid)
    colour, meaning = (VERMILLION, "fails") if row.verdict in ("fail", "known") else (BLUE, "passes, or is refused")
    for line in (*grid, *np.moveaxis(grid, 1, 0)):
        ax.plot(line[:, 0], line[:, 1], color=colour, linewidth=0.5, marker=".", markersize=1.2, label=meaning)
    ax.plot(grid[0, :, 0], grid[0, :, 1], linestyle="", marker=".", color=ORANGE, markersize=2.5,
            label="first row of masses")  # fmt: skip
    finish_panel(ax, row, extent)


def framed(flat: np.ndarray) -> tuple[np.ndarray, float]:
    """Return (centre, longest side) [m] of points (n, 2)."""
    return (flat.min(axis=0) + flat.max(axis=0)) / 2, float(np.ptp(flat, axis=0).max())


def finish_panel(ax: Axes, row: HardRow, extent: float) -> None:
    """Finish a panel of side 1 about the origin, with its name, scale, and failure."""
    ax.set_xlim(-0.6, 0.6)
    ax.set_ylim(-0.6, 0.6)
    ax.set_aspect("equal")
    scale = f"{extent:.3g} m" if extent > POINT else "a point"
    fails = row.verdict in ("fail", "known")
    words = f"{row.integrator}, {row.precision}: fails\n" if fails else ""
    ax.set_title(f"{row.case}\n{words}", fontsize=7.5, pad=1, color=VERMILLION if fails else "black")
    ax.text(0.5, -0.02, scale, transform=ax.transAxes, fontsize=7, color=GREY, ha="center", va="top")
