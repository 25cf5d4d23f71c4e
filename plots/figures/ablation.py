"""Figure of `softlab ablate`: the change and the saving when one thing at a time is left out of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.bench.experiments.advise.ablation_results import GAINS, NEEDED, NOT_NEEDED, Ablated, AblationRow, tables_of
from softlab.plots.core.colours import BLUE, GREEN, GREY, SKY, VERMILLION
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, new_sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 4  # panels: the scenes and backends that were measured last
LINE = 0.2  # inch per row
LEAST = 1e-16  # spacings: lower end of the axis; smaller changes are drawn there
SHOWN = {NEEDED: (VERMILLION, "o"), NOT_NEEDED: (GREEN, "s"), GAINS: (SKY, "D")}  # verdict -> colour, marker


def quotable_tables(results: Results) -> tuple[Source | None, list[Ablated]]:
    """Return the first source with ablations of motions that are not chaotic, and the last of each scene and backend."""
    for source in results.everyone:
        newest = {
            (table.title, table.backend): table
            for table in tables_of(source.measures)
            if table.rows and table.full.seconds and not table.full.chaotic
        }
        if newest:
            return source, list(newest.values())[-MOST:]
    return None, []


@as_figure("ablation", "What the scenes need", "no scene was taken apart (softlab ablate)")
def draw(results: Results) -> Drawing:
    """Return the figure, or the reason why there is none."""
    source, tables = quotable_tables(results)
    lines = [len(table.rows) + 2 for table in needed(tables)]
    figure = new_sheet(LINE * sum(lines) + 0.9)
    axes = figure.subplots(len(tables), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": lines})[:, 0]
    low = min(max(LEAST, row.change) for table in tables for row in table.rows) / 3
    high = max(row.change for table in tables for row in (*table.rows, table.full) if not row.broke)
    high = 10 * max(high, *(table.floor for table in tables))
    for ax, table in zip(axes, tables, strict=True):
        _panel(ax, table, low, high)
    axes[-1].set_xlabel("change at the end, root mean square, in spacings")
    _legend(figure)
    small = any(row.change < LEAST for table in tables for row in table.rows)
    clipped = f" Changes under {LEAST:g} are drawn there." if small else ""
    caption = (
        "How far the end of a run moves when one thing is left out of a scene, in float64 and exact math, against the "
        "method's own error at the scene's step size (grey line): what changes less is not needed there. At the right how "
        "many times as fast the run becomes, timed side by side with the full scene; diverged runs stand at the edge."
        f"{clipped}"
    )
    return Drawing(figure, caption, (needed(source),))


def _panel(ax: Axes, table: Ablated, low: float, high: float) -> None:
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ax.axvline(max(low, table.floor), color=GREY, linewidth=1, zorder=1)
    for y, row in enumerate(table.rows):
        _row(ax, table, row, y, high)
    ax.set_yticks(range(len(table.rows)), [row.name for row in table.rows])
    ax.set_ylim(len(table.rows) - 0.5, -0.5)
    ax.set_title(
        f"{table.title}, {table.integrator}, dt {table.dt:g} s, {table.backend.upper()}", fontsize=8, loc="left"
    )
    ax.text(1.01, 1.02, "times as fast", transform=ax.transAxes, fontsize=7, ha="left", va="bottom")


def _row(ax: Axes, table: Ablated, row: AblationRow, y: int, high: float) -> None:
    colour, marker = SHOWN[table.verdict(row)]
    if row.broke:
        ax.plot([high], [y], ">", color=colour, clip_on=False)
    else:
        ax.plot([max(LEAST, row.change)], [y], marker, color=colour, zorder=3)
    saving = table.saving(row)
    if saving is not None:
        ax.text(1.02, y, f"{saving:.2f}", transform=ax.get_yaxis_transform(), fontsize=7, va="center",
                color=BLUE if row.suspect is None else GREY)  # fmt: skip


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, marker=marker, linestyle="") for colour, marker in SHOWN.values()]
    handles.append(Line2D([], [], color=GREY, linewidth=1))
    names = [*SHOWN, "the method's own error"]
    names[names.index(GAINS)] = "a finer step, which gains"
    figure.legend(handles, names, loc="outside lower center", ncols=len(names))
