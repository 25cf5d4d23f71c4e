"""Bracketing of the number of steps that reaches an error, and the next number to try."""

from __future__ import annotations

from math import ceil, isfinite, log, sqrt

TIGHT = 1.03  # a step size is accepted if one this many times as large misses the error
MAX_STRIDE = 64.0  # largest factor of steps from one run to the next

Tried = tuple[int, float]  # steps, error [spacings]


def next_steps(low: Tried | None, high: Tried | None, target: float, order: int, least: int, turn: int) -> int:
    """Return the number of steps to try next, more than `low` and fewer than `high`.

    `low`: the most that miss the target; `high`: the fewest that reach it. With one of them known, the order determines
    the next number. With both, log error is taken as linear in log steps, slightly shifted to either side in turn, so
    that both ends close in. One of them must be given.
    """
    if low is not None and high is not None:
        (few, worse), (many, better) = low, high
        guess = sqrt(few * many)
        if isfinite(worse) and 0 < better < worse:
            guess = few * (worse / target) ** (log(many / few) / log(worse / better))
        guess *= 1.01 if turn % 2 else 1 / 1.01
        return min(many - 1, max(few + 1, round(guess)))
    if low is not None:
        steps, error = low
        known = order > 0 and isfinite(error) and turn < 3
        factor = 1.01 * (error / target) ** (1 / order) if known else 2.0
        return max(steps + 1, ceil(steps * min(MAX_STRIDE, max(factor, TIGHT))))
    assert high is not None
    steps, error = high
    guess = min(steps / TIGHT, steps * (error / target) ** (1 / max(order, 1)) / 1.01)
    return max(least, min(steps - 1, ceil(guess)))
