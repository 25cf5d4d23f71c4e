"""Timings that belong side by side: grids against squares of as many masses, float32 and float64."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.store.results import Timing
from plots.core.data import Source, is_wrong


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


def float64_pairs(source: Source, backend: str, word: str | None) -> list[tuple[Timing, Timing]]:
    """(float32, float64) timings of one size, smallest first, where both gave right answers."""
    single = {(t.rows, t.columns): t for t in source.select(backend, word) if not is_wrong(t)}
    double = [t for t in source.select(backend, word, "float64") if not is_wrong(t)]
    return [(single[t.rows, t.columns], t) for t in double if (t.rows, t.columns) in single]
