"""Rule for whether two times differ, the same for every sentence and figure.

With seven repeats or more, taken in turn: the bootstrap interval of the ratio of medians must exclude 1 (Efron and
Tibshirani, An introduction to the bootstrap, 1993, chapter 13; LEVEL of it between the percentiles). With five or six,
no repeat of one may lie among those of the other: by chance that happens to one pair in 126. With fewer, each range
counts as three times as wide, in ratios: a disturbed repeat takes a multiple of its time, whatever that is compared
with. One session cannot show a difference of less than SMALL: the placement of a process's pages changes times by up to
a tenth for as long as it lives.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from softlab.bench.store.results import Timing

MANY, FEW = 7, 5  # repeats
LEVEL = 0.99
RESAMPLES = 4000
SMALL = 0.15  # relative to the shorter time


def apart(a: Timing, b: Timing) -> int:
    """Return -1 if a is faster than b, 1 if it is slower, 0 if the repeats do not show a difference."""
    if small(a.median / b.median) and min(a.sessions, b.sessions) < 2:
        return 0
    if min(a.count, b.count) >= MANY:
        low, high = ratio_interval(tuple(a.seconds_per_step), tuple(b.seconds_per_step))
    else:
        (a_low, a_high), (b_low, b_high) = _range(a), _range(b)
        low, high = a_low / b_high, a_high / b_low
    return -1 if high < 1 else 1 if low > 1 else 0


def too_few(a: Timing, b: Timing) -> bool:
    """Return True if `apart` is undecided only because there are fewer repeats than FEW: their ranges do not overlap."""
    if min(a.count, b.count) >= FEW or small(a.median / b.median) or apart(a, b) != 0:
        return False
    return a.high < b.low or b.high < a.low


def small(ratio: float) -> bool:
    """True if a ratio of times is too close to 1 for a single session."""
    return max(ratio, 1 / ratio) < 1 + SMALL


def _range(timing: Timing) -> tuple[float, float]:
    """Return the smallest and largest time [s]; with few repeats, extended by the same factor on both sides."""
    width = timing.high / timing.low if timing.count < FEW else 1.0
    return timing.low / width, timing.high * width


@lru_cache(maxsize=1024)  # claims call it again and again
def ratio_interval(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float]:
    """Return the percentiles that enclose LEVEL of the ratios of medians, resampled with replacement."""
    random = np.random.default_rng(7)
    medians = [np.median(random.choice(times, (RESAMPLES, len(times))), axis=1) for times in (a, b)]
    low, high = np.percentile(medians[0] / medians[1], (50 * (1 - LEVEL), 50 * (1 + LEVEL)))
    return float(low), float(high)
