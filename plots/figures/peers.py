"""Figures of peers: their time over the lab's own, against size."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from softlab.bench.peers.registry import PEERS, label
from softlab.bench.peers.results import Ratio
from softlab.plots.core.backends import name_of, on_backends
from softlab.plots.core.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import (
    Curve,
    Drawing,
    as_figure,
    draw_band,
    legend_below,
    log_axes,
    new_figure,
    plain_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRECISION = "float32"
STYLES = (
    (BLUE, "o"), (ORANGE, "s"), (GREEN, "D"), (VERMILLION, "^"), (PURPLE, "v"), (SKY, "P"), (BLUE, "X"), (ORANGE, "*"),
    (GREEN, "p"),
)  # fmt: skip
SHEETS = {
    "cloth": "cloth of springs",
    "xpbd": "cloth by XPBD",
}  # the words of bench/peers/scenes.py, and a panel's title
Panel = tuple[str, Source, list[Ratio]]  # the title, the machine, its ratios


def square_ratios(source: Source, backend: str, scene: str = "grid") -> list[Ratio]:
    """Return the ratios of one panel of a machine."""
    wanted = (scene, backend, PRECISION)
    return [r for r in source.peers if (r.scene, r.backend, r.precision) == wanted and r.rows == r.columns]


@as_figure("peers", "Other programs side by side")
def draw(results: Results) -> Drawing:
    """Return the figure of the hand-out's grid, or the reason why there is none.

    A panel per backend, each of the first machine that has its data, own ones first.
    """
    chosen = on_backends(results, square_ratios)
    panels = [(_title(backend, source, compared), source, compared) for backend, source, compared in chosen]
    return _draw(panels, ("grid",), "square grids")


@as_figure("peers-sheets", "Cloth: other programs side by side")
def draw_sheets(results: Results) -> Drawing:
    """Return the figure of cloth of springs and cloth by XPBD, like `draw`."""
    panels = [
        (f"{text}\n{name_of(backend, source)}", source, compared)
        for scene, text in SHEETS.items()
        for backend, source, compared in on_backends(results, partial(square_ratios, scene=scene))
    ]
    return _draw(panels, tuple(SHEETS), "square sheets")


def _draw(panels: Sequence[Panel], scenes: Sequence[str], squares: str) -> Drawing:
    needed(panels, "nothing was timed beside peers (softlab sweep --peers)")
    shown = [peer for peer in PEERS if set(scenes) & set(peer.scenes)]
    styles = dict(zip(dict.fromkeys(peer.label for peer in shown), cycle(STYLES), strict=False))  # one line per name
    curves = {peer.name: Curve(peer.label, *styles[peer.label]) for peer in shown}
    figure, axes = new_figure(len(panels), 2.3, sharey=False)
    marks: set[str] = set()
    for ax, (words, _, compared) in zip(axes, panels, strict=True):
        for name in dict.fromkeys(r.peer for r in compared):
            marks |= _draw_peer(
                ax, [r for r in compared if r.peer == name], curves.get(name) or Curve(label(name), GREY, ".")
            )
        ax.axhline(1, color=BLACK, linewidth=1, zorder=1, label="the lab")
        log_axes(ax)
        plain_ticks(ax.yaxis)
        ax.set_title(words, fontsize=8)
    axes[0].set_ylabel("time over the lab's")
    legend_below(figure, axes, columns=3, marks=marks)
    caption = (
        f"Time of a step of other programs over the lab's own, same scene and step, {PRECISION}, {squares}, measured in "
        "turn in one process: medians, and bands from the least to the greatest of paired repeats. Above 1 the lab is "
        "faster. Every state was first compared with the lab's own in float64."
    )
    return Drawing(figure, caption, tuple(dict.fromkeys(source for _, source, _ in panels)))


def _title(backend: str, source: Source, compared: list[Ratio]) -> str:
    threads = max(r.threads or 1 for r in compared)
    return name_of(backend, source) + ("" if backend == "gpu" else f"\n{threads} threads where a peer has threads")


def _draw_peer(ax: Axes, compared: list[Ratio], curve: Curve) -> set[str]:
    """Draw one line; return the marks that it uses: `suspect`, `wrong answer`."""
    sound, wrong = [r for r in compared if not r.wrong], [r for r in compared if r.wrong]
    x, y, *ends = (np.array([getattr(r, name) for r in sound]) for name in ("particles", "ratio", "low", "high"))
    points = x, y, np.stack(ends, axis=1)
    suspect = [bool(r.suspect) for r in sound]
    draw_band(ax, points, curve, suspect, [(r.particles, r.ratio) for r in wrong])
    return {name for name, some in (("suspect", any(suspect)), ("wrong answer", wrong)) if some}
