"""The worlds of the demo: opened, stepped frame by frame, read for the picture, and frozen when they diverge. What the
user does to them is in app/demo.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, log
from time import perf_counter
from typing import Self

import numpy as np

from app.camera import finite_bounds
from app.driver import open_simulation
from app.hand import Hand
from app.measures import Statistics, measure, measure_picture
from model.errors import Diverged, SoftlabError
from model.scene import Scene
from model.simulation import Simulation, State

ALWAYS_KEPT = 50_000  # masses: up to here the last picture that fits is kept in every frame, beyond it when dt is over
WATCHABLE = 3.0  # times the scene's size: what still fits the window, and is shown of a state that diverged
STEPS_PER_FRAME = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
FRAME = 1 / 60  # s
MOST_BATCHES, BODY_BATCHES = 20, 4  # in a frame, while a cloth or a body is pulled
STATISTICS_INTERVAL = 0.1  # s, at least
STATISTICS_SHARE = 0.1  # of the time, at most: on large grids energies are looked at less often

OpenWorld = Callable[..., Simulation]


def stiffness_paths(scene: Scene) -> dict[str, float]:
    """Dotted path -> stiffness [N/m] of every kind of spring in the scene, as it is now."""
    if scene.springs:
        return {"springs.stiffness": scene.springs.stiffness}
    return {f"{kind}.stiffness": springs.stiffness for kind, springs in scene.cloth_springs.items()}


def live_parts(scene: Scene) -> tuple[str, ...]:
    """What the demo can change in this scene while it runs: gravity always, stiffness where springs are, pokes but of bodies,
    which are pulled through their state (app/grip.py)."""
    poked = () if scene.bodies else ("poke",)
    return ("gravity", *poked, "dt", *(("stiffness",) if stiffness_paths(scene) else ()))


def first_steps(scene: Scene) -> int:
    """Steps per frame at first: 10, but of bodies those that come nearest to a frame's time."""
    if not scene.bodies:
        return 10
    return min(STEPS_PER_FRAME, key=lambda steps: abs(log(steps * scene.method.dt / FRAME)))


class Worlds:
    """One or more scenes that run side by side, stepped by `frame`. Raises what `open_simulation` raises, when opening only.

    Public: `worlds`, `positions` (one (particles, dimensions) float32 array a world: what is drawn), `statistics`, `message`,
    `paused`, `frozen` (diverged, with the reason in `failure`: only `restart` goes on), `steps_per_frame`, `hand`
    (selected mass, held poke), `physics_seconds` of the last frame. Positions are read from the worlds when they are asked
    for: large cloths on a GPU are drawn without them.
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
        self.scenes = list(scenes)
        self.backend, self.threads = backend, str(threads)
        self._options = {"precision": precision, "math": math}
        self._open_world = open_world
        self.worlds: list[Simulation] = []
        try:
            for scene in self.scenes:
                self.worlds.append(self._open(scene, backend, self.threads, None))
        except BaseException:
            self.close()
            raise
        self._positions = [world.read("position").astype(np.float32) for world in self.worlds]
        self._moved = False  # since they were read
        self._watchable = [position.copy() for position in self._positions]
        self.statistics = Statistics()
        self.message = self.failure = ""
        self.message_count = 0  # so that the same message twice is seen as new
        self.paused = False
        self.frozen = False
        self.steps_per_frame = first_steps(self.scenes[0])
        self.hand = Hand(self.scenes[0].dimensions)
        self.physics_seconds = 0.0
        self._statistics_due, self._look_seconds = 0.0, inf
        self.refresh(force=True)

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
        """The first world: the one that is picked in, and whose numbers are shown."""
        return self.worlds[0]

    @property
    def positions(self) -> list[np.ndarray]:
        """As the worlds are now, or as they were when they froze."""
        if self._moved:
            self._read()
        return self._positions

    # ------------------------------------------------------------------ the frame

    def frame(self) -> None:
        """The physics of one frame: `steps_per_frame` steps of every world."""
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
        """The steps of a frame, the held force renewed before each of its batches."""
        done = 0
        for batch in range(1, self._batches() + 1):
            if done:
                self.world.read("position", into=self._positions[0])
            steps = self.steps_per_frame * batch // self._batches() - done
            self._guard(self._push)
            if not self._guard(lambda steps=steps: self._pull_and_advance(steps)):  # type: ignore[misc]
                return
            done += steps

    def _batches(self) -> int:
        """Of a frame's steps. A cloth gives way to a pull across it without resistance, and little dampens it: it would swing
        up about the pointer, were the force as old as a frame. A body weighs more than what is pulled of it."""
        if self.hand.held is None or self.world.scene.dimensions == 2:
            return 1
        return min(self.steps_per_frame, BODY_BATCHES if self.world.scene.bodies else MOST_BATCHES)

    def _pull_and_advance(self, steps: int) -> None:
        self.hand.pull(self.world, steps * self.world.scene.method.dt)
        for world in self.worlds:
            world.advance(steps)
        for world in self.worlds:
            world.synchronize()

    def _keeps_pictures(self) -> bool:
        """Whether the last picture that fits the window is kept in every frame."""
        return self.over_limit or len(self._positions[0]) <= ALWAYS_KEPT

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
        return self.world.scene.method.dt > self.world.limit * (1 + 1e-12)

    def _hold_time(self) -> float:
        """For which a held force stays as it is [s]."""
        return self.steps_per_frame // self._batches() * self.world.scene.method.dt

    def _push(self) -> None:
        position = self.positions[0] if self.hand.held else self._positions[0]  # with nothing held it is not looked at
        self.hand.push(self.world, position, self._hold_time())

    def refresh(self, force: bool = False) -> None:
        """Energies, strain and bounds, if they are due (they need the whole state on the host)."""
        now = perf_counter()
        if self.frozen or (now < self._statistics_due and not force):
            return
        self._guard(self._measure)
        cost = perf_counter() - now
        usual = min(cost, self._look_seconds)  # one that waits for a compiler tells nothing of the next
        self._look_seconds = cost
        self._statistics_due = now + max(STATISTICS_INTERVAL, usual / STATISTICS_SHARE)

    def _measure(self) -> None:
        self.statistics = measure(self.world, self.positions, self.statistics)

    def _guard(self, action: Callable[[], object]) -> bool:
        """Do `action`; on one of the lab's errors say so (and freeze, if the state diverged). True if it went well."""
        try:
            action()
        except Diverged as error:
            self._freeze(f"{error}. R restarts; the picture is the last that fitted the window")
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
        self.hand.held = None
        self._moved = False  # what is shown from now on is no world's state
        for position, watchable in zip(self._positions, self._watchable, strict=True):
            position[...] = watchable
        self.statistics = measure_picture(self.world.scene, self.positions, self.statistics)

    def _blocked(self) -> bool:
        if self.frozen:
            self.say("diverged: first restart with R")
        return self.frozen
