"""Time as a state of its own: since when steps are counted as so many times the step size."""

from __future__ import annotations

from math import isclose
from typing import NamedTuple

import numpy as np

ROUNDED = 1e-12  # of a time: what sums of step sizes may differ by from their product
UNSEEN = 1e-6  # steps: no jump that anything sees


class Clock(NamedTuple):
    """The step at which the step size was changed last, and the time [s] at which that was: steps are counted from there."""

    step: int = 0
    time: float = 0.0

    def at(self, step: int, dt: float) -> float:
        """The time [s] at which step number `step` begins."""
        return self.time + (step - self.step) * dt

    def shows(self, step: int, time: float, dt: float) -> bool:
        """Whether that step begins at `time` [s] by this clock."""
        return isclose(self.at(step, dt), time, rel_tol=ROUNDED, abs_tol=UNSEEN * dt)

    def values(self, dt: float, substeps: int = 1) -> dict[str, float]:
        """What kernels read of it: `first_step`, a number of substeps of `dt` [s] that float32 holds, and `first_time` [s].

        Their time is first_time + (substep - first_step) dt: to the bit substep times dt as long as dt was not changed.
        """
        number = self.step * substeps
        first = int(np.float32(number))
        return {"first_step": float(first), "first_time": self.time - (number - first) * dt}


START = Clock()


def clock_of(clock: Clock, step: int, time: float, dt: float) -> Clock:
    """The clock by which a state of that step and time [s] goes on in steps of `dt` [s]: `clock`, its own, which continues it
    to the bit; or that of a run that began with it; or, of a state from steps of another size, one that starts there."""
    for known in (clock, START):
        if known.shows(step, time, dt):
            return known
    return Clock(step, time)
