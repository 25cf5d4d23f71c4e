"""Pairs of timings: grids and squares of equal masses, float32 and float64."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from softlab.bench.store.results import Timing
from softlab.plots.core.data import Source, sound


def square_time(squares: Sequence[Timing], particles: int) -> float | None:
    """Return the time per step [s] of a square of `particles` masses: measured, or interpolated on log-log scales."""
    below = [t for t in squares if t.particles <= particles]
    above = [t for t in squares if t.particles >= particles]
    if not below or not above:
        return None
    left, right = below[-1], above[0]
    if left.particles == right.particles:
        return left.median
    fraction = math.log(particles / left.particles) / math.log(right.particles / left.particles)
    return left.median * (right.median / left.median) ** fraction


def shape_ratios(source: Source, backend: str, word: str | None) -> list[tuple[Timing, float]]:
    """Return (timing, time [s] of a square of equal masses) for every grid that is no square of a power of two."""
    everything = sound(source.select(backend, word, square=False))
    squares = [t for t in everything if t.rows == t.columns and t.rows & (t.rows - 1) == 0]
    result = []
    for timing in everything:
        if timing not in squares:
            seconds = square_time(squares, timing.particles)
            if seconds:
                result.append((timing, seconds))
    return result


def at_one_size(ones: Iterable[Timing], others: Iterable[Timing]) -> list[tuple[Timing, Timing]]:
    """Return (one, another) of every size that is in both, in the order of the others."""
    by_size = {(t.rows, t.columns): t for t in ones}
    return [(by_size[t.rows, t.columns], t) for t in others if (t.rows, t.columns) in by_size]


def float64_pairs(source: Source, backend: str, word: str | None) -> list[tuple[Timing, Timing]]:
    """Return (float32, float64) timings of one size, smallest first, if both have right results."""
    return at_one_size(sound(source.select(backend, word)), sound(source.select(backend, word, "float64")))
