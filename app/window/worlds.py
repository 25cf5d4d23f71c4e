"""The worlds of the demo: opened, stepped frame by frame, read for the picture, and frozen when they diverge. User
actions are in app/window/demo.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import inf, log
from time import perf_counter
from typing import Self

import numpy as np

from softlab.app.driver import open_simulation
from softlab.app.presentation import presentation_of
from softlab.app.render.camera import finite_bounds
from softlab.app.window.live import live_parts
from softlab.app.window.measures import Statistics, measure, measure_picture
from softlab.app.window.panes import check_alike, titles_of
from softlab.app.window.picker import Picker
from softlab.model.base.errors import Diverged, SoftlabError
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

MAX_SNAPSHOT_MASSES = (
    50_000  # up to here the last picture that fits is stored in every frame, beyond if dt is too large
)
WATCHABLE = 3.0  # times the scene's size: what still fits the window, and is shown of a state that diverged
STEPS_PER_FRAME = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
FRAME = 1 / 60  # s
MAX_BATCHES, BODY_BATCHES = 20, 4  # in a frame, while a cloth or a body is pulled
STATISTICS_INTERVAL = 0.1  # s, at least
STATISTICS_FRACTION = 0.1  # of the time, at most: on large grids energies are looked at less often

OpenWorld = Callable[..., Simulation]


def first_steps(scene: Scene) -> int:
    """Return the initial number of steps per frame: the number of the scene's family, or the one nearest to a frame's
    time."""
    count = presentation_of(scene).steps_per_frame
    return count or min(STEPS_PER_FRAME, key=lambda steps: abs(log(steps * scene.method.dt / FRAME)))


def _over_limit(world: Simulation) -> bool:
    return world.scene.method.dt > world.limit * (1 + 1e-12)


class Worlds:
    """One or more scenes that run side by side, stepped by `frame`. The constructor raises what `open_simulation`
    raises, and SceneError for scenes that cannot be shown side by side.

    Public: `worlds`, `positions` (one (particles, dimensions) float32 array a world: what is drawn; read from the worlds when
    they are asked for: large cloths on a GPU are drawn without them), `statistics`, `message`, `paused`, `frozen` (diverged,
    with the reason in `failure`: only `restart` goes on), `steps_per_frame`, `hand` (selected mass, held poke),
    `physics_seconds` of the last frame; `current`, the number of the world in which the hand is and whose numbers are shown,
    `alone`, whether it is the only one that is changed, `titles`, `disturbed`, why no reference knows their motion any more;
    `wants_momentum`: whether somebody looks at it; `compiling`: seconds since warming up the worlds began, None once they
    are warm.

    Clocks go together: `steps_per_frame` are of the world with the longest dt, others do as many as take them there.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        *,
        backend: str = "cpu",
        threads: str = "1x",
        precision: str = "float32",
        math: str = "fast",
        open_world: OpenWorld = open_simulation,
    ):
        self._check(scenes)
        self.backend, self.threads = backend, str(threads)
        self._options: dict[str, str | None] = {"precision": precision, "math": math}
        self._open_world = open_world
        self.worlds: list[Simulation] = []
        try:
            for scene in scenes:
                self.worlds.append(self._open(scene, backend, self.threads, None))
        except BaseException:
            self.close()
            raise
        self.message = ""
        self.message_count = 0  # so that the same message twice is seen as new
        self.paused = self.wants_momentum = False
        self.compiling: float | None = None
        self.physics_seconds = 0.0
        self._begin(scenes)

    _check = staticmethod(check_alike)

    def _begin(self, scenes: Sequence[Scene]) -> None:
        """Start with the worlds of these scenes in their opening state."""
        self.scenes, self.titles = list(scenes), titles_of(scenes)
        self.current, self.alone = 0, False
        self.statistics = Statistics()
        self.steps_per_frame = first_steps(max(self.scenes, key=lambda scene: scene.method.dt))
        self._statistics_due, self._measure_seconds = 0.0, inf
        self._dropped: str | None = None  # the part of which a body was brought in last
        self._start_anew()

    def _start_anew(self) -> None:
        """Restart the worlds from their initial states, with the number of masses that they may have now."""
        self._positions = [world.read("position").astype(np.float32) for world in self.worlds]
        self._moved = False  # since they were read
        self._watchable = [position.copy() for position in self._positions]
        self.failure, self.disturbed = "", ""
        self.frozen = False
        self.picker = Picker(self.scenes[0].dimensions)
        self._at = 0  # of the world that is stepped or looked at
        self.refresh(force=True)

    def disturb(self, reason: str) -> None:
        """Record the reason why no reference describes the motion of the worlds from now on."""
        if any(world.step for world in self.worlds):
            self.disturbed = self.disturbed or reason

    def _open(self, scene: Scene, backend: str, threads: str, state: State | None) -> Simulation:
        return self._open_world(
            scene,
            backend,
            threads=threads,
            live=live_parts(scene),
            initial=state,
            allow_unstable=True,  # the student is to see the limit break
            **self._options,
        )

    def close(self) -> None:
        """Close every world."""
        for world in self.worlds:
            world.close()
        self.worlds = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def world(self) -> Simulation:
        """The current world: the picked one, whose numbers are shown."""
        return self.worlds[self.current]

    @property
    def position(self) -> np.ndarray:
        """Positions of the current world."""
        return self.positions[self.current]

    def steps_of(self, world: Simulation) -> int:
        """Return the number of steps of a world in a frame."""
        if world is self._leading_world:
            return self.steps_per_frame
        return self._steps(world, self.steps_per_frame * self._leading_world.scene.method.dt)

    @property
    def positions(self) -> list[np.ndarray]:
        """Positions of the worlds, now or when they were frozen."""
        if self._moved:
            self._read()
        return self._positions

    # ------------------------------------------------------------------ the frame

    def frame(self) -> None:
        """Do the physics of one frame: `steps_per_frame` steps of every world."""
        self.physics_seconds = 0.0
        if self.frozen:
            return  # the picture stays as it was when the state went bad
        if not self.paused:
            start = perf_counter()
            self._step()
            self.physics_seconds = perf_counter() - start
        if not self.frozen:
            self._moved = True
            if self._keeps_pictures():
                self._read()
            self.refresh()

    def _step(self) -> None:
        """Do the steps of a frame; the force of a poke is renewed before each batch."""
        done = 0
        for batch in range(1, self._batches() + 1):
            if done:
                self.world.read("position", into=self._positions[self.current])
            steps = self.steps_per_frame * batch // self._batches() - done
            self._guard(self._push)
            if not self._guard(partial(self._pull_and_advance, steps)):
                return
            done += steps

    def _batches(self) -> int:
        """Return the number of batches into which a frame's steps are divided.

        A cloth does not resist a pull across it and is hardly damped: with a force that is a frame old it would
        oscillate around the pointer with growing amplitude. A body is heavier than its pulled part.
        """
        if self.picker.poke is None or self.world.scene.dimensions == 2:
            return 1
        return min(self.steps_per_frame, BODY_BATCHES if presentation_of(self.world.scene).grips else MAX_BATCHES)

    @property
    def _leading_world(self) -> Simulation:
        """The world whose steps are counted: the one with the longest step."""
        return max(self.worlds, key=lambda world: world.scene.method.dt)

    @staticmethod
    def _steps(world: Simulation, seconds: float) -> int:
        """Return the steps of a world that come nearest to this time, at most as many as a frame may have, since dt can
        be arbitrarily short."""
        return min(max(round(seconds / world.scene.method.dt), 0), STEPS_PER_FRAME[-1])

    def _pull_and_advance(self, steps: int) -> None:
        leader = self._leading_world
        seconds = steps * leader.scene.method.dt
        until = leader.time + seconds
        self.picker.pull(self.world, seconds)
        for number, world in enumerate(self.worlds):
            self._at = number
            world.advance(steps if world is leader else self._steps(world, until - world.time))
        for number, world in enumerate(self.worlds):
            self._at = number
            world.synchronize()

    def _keeps_pictures(self) -> bool:
        """Return True if the last picture that fits the window is stored in every frame."""
        return any(map(_over_limit, self.worlds)) or sum(map(len, self._positions)) <= MAX_SNAPSHOT_MASSES

    def _read(self) -> None:
        self._moved = False
        with np.errstate(over="ignore", invalid="ignore"):  # a float64 world on its way out of float32
            for world, position in zip(self.worlds, self._positions, strict=True):
                world.read("position", into=position)
        if self._keeps_pictures():
            for world, position, watchable in zip(self.worlds, self._positions, self._watchable, strict=True):
                bounds = finite_bounds(position)
                if bounds and max(map(abs, bounds)) <= WATCHABLE * world.body.size and np.isfinite(position).all():
                    watchable[...] = position

    @property
    def over_limit(self) -> bool:
        return _over_limit(self.world)

    def _force_interval(self) -> float:
        """Time for which a force stays constant [s]."""
        return self.steps_per_frame // self._batches() * self._leading_world.scene.method.dt

    def _push(self) -> None:
        positions = self.positions if self.picker.poke else self._positions  # with nothing held not looked at
        self.picker.push(self.world, positions[self.current], self._force_interval())

    def refresh(self, force: bool = False) -> None:
        """Measure energies, strain and bounds, if they are due (they need the whole state on the host)."""
        now = perf_counter()
        if self.frozen or (now < self._statistics_due and not force):
            return
        self._guard(self._measure)
        cost = perf_counter() - now
        usual = min(cost, self._measure_seconds)  # one that waits for a compiler tells nothing of the next
        self._measure_seconds = cost
        self._statistics_due = now + max(STATISTICS_INTERVAL, usual / STATISTICS_FRACTION)

    def _measure(self) -> None:
        self._at, before = self.current, self.statistics.faults
        self.statistics = measure(self.worlds, self.current, self.positions, self.statistics, self.wants_momentum)
        if self.statistics.faults and not before:
            self.say(f"incomplete: {self.statistics.faults}; press R to restart")

    def _guard(self, action: Callable[[], object]) -> bool:
        """Run `action`. On one of softlab's errors show its message (and freeze, if the state diverged). Returns True
        on success."""
        try:
            action()
        except Diverged as error:
            whose = f"{self.titles[self._at]}: " if len(self.worlds) > 1 else ""
            self._freeze(f"{whose}{error}. Press R to restart. The picture shows the last state that fits the window")
            return False
        except SoftlabError as error:
            self.say(str(error))
            return False
        return True

    def say(self, message: str) -> None:
        """Show a message."""
        self.message = message
        self.message_count += 1

    def _freeze(self, failure: str) -> None:
        self.frozen, self.failure = True, failure
        self.message = ""
        self.picker.poke = None
        self._moved = False  # what is shown from now on is no world's state
        for position, watchable in zip(self._positions, self._watchable, strict=True):
            position[...] = watchable
        self.statistics = measure_picture(
            [world.scene for world in self.worlds], self.current, self.positions, self.statistics
        )

    def _blocked(self) -> bool:
        if self.frozen:
            self.say("diverged; press R to restart")
        return self.frozen
