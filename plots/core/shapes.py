"""Does the shape matter? Long, tall and odd grids against a square of as many masses."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.store.results import Timing
from plots.core.data import Results, Source, is_suspect, is_wrong
from plots.core.style import BLUE, GPU, GREY, Curve, Drawing, legend_below, panels

TITLE = "Shape at equal mass count"
CURVES = (("cpu", "1x", Curve("CPU, 1x threads", BLUE, "o")), ("gpu", None, GPU))


def square_time(squares: Sequence[Timing], particles: int) -> float | None:
    """Seconds a step of a square of `particles` masses: measured, or between its neighbours on log-log scales."""
    below = [t for t in squares if t.particles <= particles]
    above = [t for t in squares if t.particles >= particles]
    if not below or not above:
        return None
    left, right = below[-1], above[0]
    if left.particles == right.particles:
        return left.median
    share = math.log(particles / left.particles) / math.log(right.particles / left.particles)
    return left.median * (right.median / left.median) ** share


def shape_ratios(source: Source, backend: str, word: str | None) -> list[tuple[Timing, float]]:
    """(timing, seconds that a square of as many masses takes) of every grid that is no square of a power of two."""
    everything = [t for t in source.select(backend, word, square=False) if not is_wrong(t)]
    squares = [t for t in everything if t.rows == t.columns and t.rows & (t.rows - 1) == 0]
    result = []
    for timing in everything:
        if timing not in squares:
            seconds = square_time(squares, timing.particles)
            if seconds:
                result.append((timing, seconds))
    return result


def draw(results: Results) -> Drawing | str:
    """The figure, or why there is none."""
    figure, chosen = panels(results, lambda s: any(shape_ratios(s, backend, word) for backend, word, _ in CURVES))
    if figure is None:
        return "only squares were timed"
    times: list[Timing] = []
    for ax, source in chosen:
        by_curve = [(curve, shape_ratios(source, backend, word)) for backend, word, curve in CURVES]
        names = sorted(
            {(t.particles, t.rows, t.columns) for _, found in by_curve for t, _ in found},
        )
        place = {(rows, columns): k for k, (_, rows, columns) in enumerate(names)}
        for shift, (curve, found) in zip((-0.12, 0.12), by_curve, strict=True):
            label: str | None = curve.label
            for timing, square in found:
                x, ratio = place[timing.rows, timing.columns] + shift, timing.median / square
                bar = [[(timing.median - timing.low) / square], [(timing.high - timing.median) / square]]
                face = "white" if is_suspect(timing) else curve.colour
                ax.errorbar(
                    [x], [ratio], yerr=bar, fmt=curve.marker, color=curve.colour, markerfacecolor=face, label=label,
                    elinewidth=1.2, capsize=2,
                )  # fmt: skip
                times.append(timing)
                label = None
        ax.axhline(1, color=GREY, linewidth=1, zorder=1)
        low, high = ax.get_ylim()
        ax.set_ylim(min(low, 0.75), max(high, 1.25))  # wobble is not to look like a difference
        ax.set_xticks(
            range(len(names)), [f"{r} x {c}" for _, r, c in names], rotation=60, ha="right", rotation_mode="anchor"
        )
        ax.set_xlim(-0.6, len(names) - 0.4)
        ax.set_xlabel("rows x columns / masses")
    chosen[0][0].set_ylabel("time / time of a square")
    legend_below(figure, [ax for ax, _ in chosen], times)
    sources = [source for _, source in chosen]
    caption = (
        "Time of a step over that of a square grid of as many masses (between two measured squares where there is none "
        "of that count), float32, least to greatest repeat."
    )
    return Drawing(figure, TITLE, caption, tuple(sources))
