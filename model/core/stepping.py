"""Steps of a simulation, the search for the first bad one, and pins that let go: what is the same for every backend.

The state is checked at intervals (model/core/stability/divergence.py). A good one is copied to a snapshot on the
device; from there the steps up to a bad one are repeated, to find the step and the particle where it began.

At the step that reaches the time of a release the solver is opened again, in place, for the scene without those pins, and
continues from the state. A release costs what opening costs, and is the same on every backend.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from math import ceil, isqrt
from numbers import Integral

from softlab.model.base.clock import UNSEEN, Clock
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.backend import Backend
from softlab.model.core.build import Body, build
from softlab.model.core.options import Options
from softlab.model.core.stability.diagnosis import diagnose
from softlab.model.core.state import State

NEVER = 2**62  # steps


class Releasing(Backend):
    """Pins that let go: what `Stepping` and `Simulation` need."""

    options: Options
    backend: str
    threads: int
    threads_reason: str | None
    body: Body
    snapshots: int
    lost_when_opened: Mapping[str, int]
    step: int
    time: float  # s
    _poke_particle: int
    _poke_force: tuple[float, ...]
    _entering = False

    @abstractmethod
    def state(self) -> State:
        """Copy the state to the host, see Simulation."""

    @abstractmethod
    def load(self, state: State) -> None:
        """Continue from a state, see Simulation."""

    @abstractmethod
    def faults(self) -> dict[str, int]:
        """Return the counts that make a run incomplete, see Simulation."""

    @abstractmethod
    def _apply_poke(self, particle: int, force: tuple[float, ...]) -> None:
        """Apply a force [N] to a particle from now on; -1: to none."""

    def _steps_to_release(self) -> int:
        """Number of steps, at least 1, until the next pins let go."""
        dt = self.scene.method.dt
        waits = [ceil((time - self.time) / dt - UNSEEN) for time, _ in self.scene.whole.phases]
        return min((steps for steps in waits if steps > 0), default=NEVER)

    def _body_at(self, time: float) -> Body:
        """Return the masses with their pins at `time` [s]."""
        scene = self.scene.at(time)
        return self.body if scene is self.scene or self._entering else build(scene)

    def _let_go(self) -> None:
        """Free the pins whose time has come."""
        if self.scene.at(self.time) is not self.scene:
            state = self.state()
            self._enter(self.time)
            self.load(replace(state, inverse_mass=self.body.inverse_mass))

    def _run_released(self, after: float, steps: int) -> None:
        """Run `steps` steps, from its start state, of each scene that releases later than `after` [s] leave."""
        for time, _ in self.scene.whole.phases:
            if time > after:
                self._enter(time)
                self._run(steps)

    def _enter(self, time: float) -> None:
        """Restart as the simulation of the scene at `time` [s], in its start state, if its pins differ from the present
        ones."""
        scene = self.scene.at(time)
        if scene is self.scene or self._entering:
            return
        self.require_open()

        poke, count, before = (self._poke_particle, self._poke_force), self.snapshots, self.faults()
        options, reason = self.options, self.threads_reason
        threads = (self.threads,) if self.backend == "cpu" else ()
        self.close()
        vars(self).clear()  # everything that a solver creates or caches depends on its pins
        self._entering = True
        try:
            self.__init__(scene, options, *threads)  # type: ignore[misc]
        except BaseException:
            self.closed = True
            raise
        finally:
            self._entering = False
        self.snapshots, self.threads_reason = count, reason
        self._apply_poke(*poke)
        self.lost_when_opened = {name: now - before.get(name, 0) for name, now in self.faults().items()}


class Stepping(Releasing):
    """Methods `advance`, `check` and `rewind` of Simulation (model/core/simulation.py), which sets up their
    attributes."""

    limit: float  # s, the largest stable dt
    check_interval: int  # steps
    _snapshot_step: int
    _snapshot_time: float
    _clock: Clock

    def advance(self, steps: int) -> None:
        """Advance by `steps` steps of `method.dt` each.

        The state is checked every `check_interval` steps, and whenever it is read. An interval in which it became bad is
        replayed to find the first bad step and particle.

        Parameters
        ----------
        steps : int

        Raises
        ------
        Diverged
            The state is bad; the simulation then holds the last checked finite one.
        SceneError
            `steps` is no number of steps.
        InputError
            The simulation is closed.
        """
        self.require_open()
        if not isinstance(steps, Integral) or steps < 0:
            raise SceneError("steps", steps, "must be a whole number of at least 0")
        while steps > 0:
            batch = min(steps, self.check_interval - (self.step - self._snapshot_step), self._steps_to_release())
            self._run(batch)
            self._count(batch)
            steps -= batch
            self._let_go()
            if self.step - self._snapshot_step >= self.check_interval:
                self.check()

    def _count(self, steps: int) -> None:
        self.step += steps
        self.time = self._clock.at(self.step, self.scene.method.dt)

    def check(self, snapshot: bool = True) -> None:
        """Check the state now.

        Parameters
        ----------
        snapshot : bool
            Store a good state as the snapshot to which `rewind` returns.

        Raises
        ------
        Diverged
            The state is bad.
        """
        if self.step == self._snapshot_step:
            return
        if self._first_diverged() < 0:
            if snapshot:
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
        diagnosis = diagnose(self.scene, self.limit, self._download()[1])
        raise Diverged(step, bad, self.scene.method.dt, self.limit, diagnosis.cause, diagnosis.remedy)

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
        self._store_snapshot()
        self._snapshot_step, self._snapshot_time = self.step, self.time
        self.snapshots += 1

    def rewind(self) -> None:
        """Return to the last snapshot, without a copy through the host.

        The snapshot is the state that was loaded last, until a check of the state (`check`, `state`, and `advance` every
        `check_interval` steps) stores a newer one.
        """
        self._restore()
        self.step, self.time = self._snapshot_step, self._snapshot_time
