"""Time as a state of its own, counted from the last change of the step size."""

from __future__ import annotations

from math import isclose
from typing import NamedTuple

import numpy as np

ROUNDED = 1e-12  # of a time: largest difference between sums of step sizes and their product
UNSEEN = 1e-6  # steps: a jump too small to have an effect


class Clock(NamedTuple):
    """The step and the time [s] at which the step size was last changed."""

    step: int = 0
    time: float = 0.0

    def at(self, step: int, dt: float) -> float:
        """Return the time [s] at the start of step number `step`."""
        return self.time + (step - self.step) * dt

    def shows(self, step: int, time: float, dt: float) -> bool:
        """Return True if step `step` begins at `time` [s] by this clock."""
        return isclose(self.at(step, dt), time, rel_tol=ROUNDED, abs_tol=UNSEEN * dt)

    def values(self, dt: float, substeps: int = 1) -> dict[str, float]:
        """Return the clock's kernel constants: `first_step`, a number of substeps of `dt` [s] that float32 represents
        exactly, and `first_time` [s].

        Kernels compute first_time + (substep - first_step) dt: the same bits as substep times dt while dt has not
        changed.
        """
        number = self.step * substeps
        first = int(np.float32(number))
        return {"first_step": float(first), "first_time": self.time - (number - first) * dt}


START = Clock()


def clock_of(clock: Clock, step: int, time: float, dt: float) -> Clock:
    """Return the clock with which a state of that step and time [s] continues in steps of `dt` [s].

    It is the state's own `clock`, which continues it to the bit, or that of a run from time 0. For a state from steps
    of another size it is a new one that starts there.
    """
    for known in (clock, START):
        if known.shows(step, time, dt):
            return known
    return Clock(step, time)
