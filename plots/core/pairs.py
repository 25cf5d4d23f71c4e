"""Timings that belong side by side: grids against squares of as many masses, float32 and float64."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from bench.store.results import Timing
from plots.core.data import Source, sound


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
    """(one, another) of every size that is among both, in the order of the others."""
    held = {(t.rows, t.columns): t for t in ones}
    return [(held[t.rows, t.columns], t) for t in others if (t.rows, t.columns) in held]


def float64_pairs(source: Source, backend: str, word: str | None) -> list[tuple[Timing, Timing]]:
    """(float32, float64) timings of one size, smallest first, where both gave right answers."""
    return at_one_size(sound(source.select(backend, word)), sound(source.select(backend, word, "float64")))
