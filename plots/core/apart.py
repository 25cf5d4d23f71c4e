"""Whether two times differ: one rule for every sentence and figure.

Of seven repeats or more, taken in turn: the bootstrap interval of the ratio of medians must leave out 1 (Efron and
Tibshirani, An introduction to the bootstrap, 1993, chapter 13; LEVEL of it between the percentiles). Of fewer, down to five,
no repeat of one may lie among those of the other: chance alone does that to one pair in 126. Of fewer still each range
counts as three times as wide, in ratios: a disturbed repeat takes a multiple of its time, whatever that is compared with.
And what one session measured says nothing about less than SMALL: where a process's pages lie moves times by up to a tenth
for as long as it lives.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bench.store.results import Timing

MANY, FEW = 7, 5  # repeats
LEVEL = 0.99
RESAMPLES = 4000
SMALL = 0.15  # of the shorter time


def apart(a: Timing, b: Timing) -> int:
    """-1 where a is faster than b, 1 where it is slower, 0 where the repeats do not tell."""
    if small(a.median / b.median) and min(a.sessions, b.sessions) < 2:
        return 0
    if min(a.count, b.count) >= MANY:
        low, high = ratio_interval(tuple(a.seconds_per_step), tuple(b.seconds_per_step))
    else:
        (a_low, a_high), (b_low, b_high) = _range(a), _range(b)
        low, high = a_low / b_high, a_high / b_low
    return -1 if high < 1 else 1 if low > 1 else 0


def too_few(a: Timing, b: Timing) -> bool:
    """Whether `apart` tells nothing only because there are fewer repeats than FEW: what there is of them does not meet."""
    if min(a.count, b.count) >= FEW or small(a.median / b.median) or apart(a, b) != 0:
        return False
    return a.high < b.low or b.high < a.low


def small(ratio: float) -> bool:
    """Whether a ratio of times is one that a single session cannot bear."""
    return max(ratio, 1 / ratio) < 1 + SMALL


def _range(timing: Timing) -> tuple[float, float]:
    """Least and most [s]; of few repeats by the same factor further on both sides."""
    width = timing.high / timing.low if timing.count < FEW else 1.0
    return timing.low / width, timing.high * width


@lru_cache(maxsize=1024)  # claims ask again and again
def ratio_interval(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float]:
    """The percentiles between which LEVEL of the ratios of medians lie, when repeats are drawn again with replacement."""
    random = np.random.default_rng(7)
    medians = [np.median(random.choice(times, (RESAMPLES, len(times))), axis=1) for times in (a, b)]
    low, high = np.percentile(medians[0] / medians[1], (50 * (1 - LEVEL), 50 * (1 + LEVEL)))
    return float(low), float(high)
