"""Steps of a simulation and the search for the first bad one: the part that is the same for every backend and solver.

The state is checked at intervals (model/core/stability/divergence.py). A good one is copied to a snapshot on the
device; from there the steps up to a bad one are repeated, to find the step and the particle where it began.
"""

from __future__ import annotations

from math import isqrt
from numbers import Integral

from model.core.backend import Backend
from model.core.clock import Clock
from model.core.errors import Diverged, SceneError
from model.core.stability.diagnosis import diagnose


class Stepping(Backend):
    """Methods `advance`, `check` and `rewind` of Simulation (model/core/simulation.py), which sets up their
    attributes."""

    step: int
    time: float  # s
    limit: float  # s, the largest stable dt
    check_interval: int  # steps
    kept: int  # number of snapshots so far
    _kept_step: int
    _kept_time: float
    _clock: Clock

    def advance(self, steps: int) -> None:
        """Do `steps` steps of `method.dt` each. Raises Diverged (then the state is the last checked finite one).

        The state is looked at every `check_interval` steps, and whenever it is read; the interval in which it went bad is
        then replayed to name the first bad step and particle. Raises SceneError for steps that are no number of them, and
        InputError when it was closed.
        """
        self.require_open()
        if not isinstance(steps, Integral) or steps < 0:
            raise SceneError("steps", steps, "must be a whole number of at least 0")
        while steps > 0:
            batch = min(steps, self.check_interval - (self.step - self._kept_step))
            self._run(batch)
            self._count(batch)
            steps -= batch
            if self.step - self._kept_step >= self.check_interval:
                self.check()

    def _count(self, steps: int) -> None:
        self.step += steps
        self.time = self._clock.at(self.step, self.scene.method.dt)

    def check(self, keep: bool = True) -> None:
        """Look at the state now; raise Diverged if it is bad, else put it aside as the last good one (if `keep`)."""
        if self.step == self._kept_step:
            return
        if self._first_diverged() < 0:
            if keep:
                self._put_aside()
            return
        last = self.step
        self.rewind()
        begin, _ = self._replay(last, isqrt(last - self.step))  # the fewest checks in both replays together
        self.rewind()
        if begin > self.step:
            self._run(begin - self.step)
            self._count(begin - self.step)
        _, bad = self._replay(last, 1)
        step = self.step
        self.rewind()
        found = diagnose(self.scene, self.limit, self._download()[1])
        raise Diverged(step, bad, self.scene.method.dt, self.limit, found.cause, found.remedy)

    def _replay(self, last: int, interval: int) -> tuple[int, int]:
        """Advance to `last` or to the first failed check. Returns (step of the last good check, first bad particle or
        -1)."""
        begin, bad = self.step, -1
        while bad < 0 and self.step < last:
            begin = self.step
            batch = min(interval, last - begin)
            self._run(batch)
            self._count(batch)
            bad = self._first_diverged()
        return begin, bad

    def _put_aside(self) -> None:
        self._keep()
        self._kept_step, self._kept_time = self.step, self.time
        self.kept += 1

    def rewind(self) -> None:
        """Back to the state that was put aside last, without a copy through the host.

        That is the one loaded last, until `kept` moves on: a look at the state (`check`, `state`, and `advance` every
        `check_interval` steps) puts a newer one aside.
        """
        self._restore()
        self.step, self.time = self._kept_step, self._kept_time
