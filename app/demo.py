"""What the interactive demo does, without a window: every key and drag is a method here, and can be tested as one.

`Demo` owns a list of simulations (worlds) that run side by side; actions apply to all of them, and masses are picked in
the first. It never raises for what a user does: the reason goes to `message`, and the old state goes on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np

from app.camera import finite_bounds
from app.driver import open_simulation
from app.hand import DOWN, Hand, Poke, nearest
from app.measures import Statistics, measure, measure_picture
from model.errors import Diverged, SoftlabError
from model.scene import Scene
from model.simulation import Simulation, State

THREAD_WORDS = ("1x", "2x", "4x")
FACTOR = 1.25  # one press of [ ] { }
STEPS_PER_FRAME = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
ALWAYS_KEPT = 50_000  # masses: up to here the last picture that fits is kept in every frame, beyond it when dt is over
WATCHABLE = 3.0  # times the scene's size: what still fits the window, and is shown of a state that diverged
STATISTICS_INTERVAL = 0.1  # s, at least
STATISTICS_SHARE = 0.1  # of the time, at most: on large grids energies are looked at less often

OpenWorld = Callable[..., Simulation]


def live_parts(scene: Scene) -> tuple[str, ...]:
    """What the demo can change in this scene while it runs. Gravity and pokes always; stiffness where springs are."""
    return ("gravity", "poke", "dt", *(("stiffness",) if scene.springs else ()))


class Demo:
    """The running demo of one or more scenes. Raises what `open_simulation` raises, when opening only.

    Public: `worlds`, `positions` (one (particles, 2) float32 array a world: what is drawn), `statistics`, `message`,
    `paused`, `frozen` (diverged, with the reason in `failure`: only `restart` goes on), `steps_per_frame`, `hand`
    (selected mass, held poke), `physics_seconds` of the last frame.
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
        self.positions = [world.read("position").astype(np.float32) for world in self.worlds]
        self._watchable = [position.copy() for position in self.positions]
        self.statistics = Statistics()
        self.message = self.failure = ""
        self.message_count = 0  # so that the same message twice is seen as new
        self.paused = False
        self.frozen = False
        self.steps_per_frame = 10
        self.hand = Hand()
        self.physics_seconds = 0.0
        self._statistics_due = 0.0
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

    def __enter__(self) -> Demo:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def world(self) -> Simulation:
        """The first world: the one that is picked in, and whose numbers are shown."""
        return self.worlds[0]

    # ------------------------------------------------------------------ the frame

    def frame(self) -> None:
        """The physics of one frame: `steps_per_frame` steps of every world, then its positions."""
        self.physics_seconds = 0.0
        if self.frozen:
            return  # the picture stays as it was when the state went bad
        if not self.paused:
            start = perf_counter()
            self._guard(self._push)
            self._guard(self._advance)
            self.physics_seconds = perf_counter() - start
        if not self.frozen:
            self._read()
            self.refresh()

    def _advance(self) -> None:
        for world in self.worlds:
            world.advance(self.steps_per_frame)
        for world in self.worlds:
            world.synchronize()

    def _read(self) -> None:
        with np.errstate(over="ignore", invalid="ignore"):  # a float64 world on its way out of float32
            for world, position in zip(self.worlds, self.positions, strict=True):
                world.read("position", into=position)
        if self.over_limit or len(self.positions[0]) <= ALWAYS_KEPT:
            for world, position, watchable in zip(self.worlds, self.positions, self._watchable, strict=True):
                bounds = finite_bounds(position)
                if bounds and max(map(abs, bounds)) <= WATCHABLE * world.body.size and np.isfinite(position).all():
                    watchable[...] = position

    def refresh(self, force: bool = False) -> None:
        """Energies, strain and bounds, if they are due (they need the whole state on the host)."""
        now = perf_counter()
        if self.frozen or (now < self._statistics_due and not force):
            return
        self._guard(self._measure)
        cost = perf_counter() - now
        self._statistics_due = now + max(STATISTICS_INTERVAL, cost / STATISTICS_SHARE)

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
        for position, watchable in zip(self.positions, self._watchable, strict=True):
            position[...] = watchable
        self.statistics = measure_picture(self.world.scene, self.positions, self.statistics)

    def _blocked(self) -> bool:
        if self.frozen:
            self.say("diverged: first restart with R")
        return self.frozen

    # ------------------------------------------------------------------ keys

    def toggle_gravity(self) -> None:
        """G"""
        if self._blocked():
            return
        on = not self.gravity
        if self._guard(lambda: self._set("gravity.enabled", on)):
            gravity = self.world.scene.gravity
            self.say(f"gravity on: {gravity.acceleration:g} m/s² downward" if on and gravity else "gravity off")

    @property
    def gravity(self) -> bool:
        gravity = self.world.scene.gravity
        return bool(gravity and gravity.enabled)

    def _set(self, path: str, value: object) -> None:
        for world in self.worlds:
            world.set(path, value)

    def toggle_pause(self) -> None:
        """Space"""
        self.paused = not self.paused
        self.say("paused; space goes on" if self.paused else "running")

    def change_dt(self, presses: int) -> None:
        """[ (-1) and ] (+1): the step size by a factor of 1.25."""
        if self._blocked():
            return
        dt = self.world.scene.method.dt * FACTOR**presses
        if self._guard(lambda: self._set("method.dt", dt)):
            self.say(f"dt {dt:.4g} s, {self.limit_text()}")

    def change_stiffness(self, presses: int) -> None:
        """{ (-1) and } (+1): the spring stiffness by a factor of 1.25."""
        if self._blocked():
            return
        springs = self.world.scene.springs
        if springs is None:
            self.say("this scene has no springs")
            return
        stiffness = springs.stiffness * FACTOR**presses
        if self._guard(lambda: self._set("springs.stiffness", stiffness)):
            self.say(f"stiffness {stiffness:.4g} N/m; dt {self.world.scene.method.dt:.4g} s, {self.limit_text()}")

    @property
    def over_limit(self) -> bool:
        return self.world.scene.method.dt > self.world.limit * (1 + 1e-12)

    def limit_text(self) -> str:
        """The step size against its limit, in words."""
        integrator, limit = self.world.scene.method.integrator, self.world.limit
        if limit == 0:
            return f"and {integrator} is unstable at every dt here"
        if math.isinf(limit):
            return "no limit"
        relation = "OVER the limit of" if self.over_limit else "limit"
        return f"{relation} {limit:.4g} s"

    def change_steps(self, presses: int) -> None:
        """- (-1) and + (+1): steps per frame along 1, 2, 5, 10, 20 ..."""
        place = STEPS_PER_FRAME.index(self.steps_per_frame) + presses
        self.steps_per_frame = STEPS_PER_FRAME[min(max(place, 0), len(STEPS_PER_FRAME) - 1)]
        self.say(f"{self.steps_per_frame} steps per frame")

    def restart(self) -> None:
        """R: masses, step size, stiffness and gravity back to what the scene says."""

        def back() -> None:
            for world, scene in zip(self.worlds, self.scenes, strict=True):
                world.reset()
                world.poke(None)
                world.set("method.dt", scene.method.dt)
                world.set("gravity.enabled", bool(scene.gravity and scene.gravity.enabled))
                if scene.springs:
                    world.set("springs.stiffness", scene.springs.stiffness)

        self.hand.held = None
        self.hand.forget()
        self.frozen, self.failure = False, ""
        if self._guard(back):
            self._read()
            self.refresh(force=True)
            self.say("restarted, everything as the scene says")

    def switch_backend(self) -> None:
        """B: from the CPU to the GPU or back, with the state as it is."""
        other = "gpu" if self.backend == "cpu" else "cpu"
        if not self._blocked() and self._reopen(other, self.threads):
            self.say(f"now on the {other}: {self.world.device}, state carried over")

    def cycle_threads(self) -> None:
        """T: 1x, 2x, 4x the cores."""
        if self._blocked():
            return
        if self.backend != "cpu":
            self.say("threads belong to the cpu backend; B switches to it")
            return
        place = THREAD_WORDS.index(self.threads) if self.threads in THREAD_WORDS else -1
        word = THREAD_WORDS[(place + 1) % len(THREAD_WORDS)]
        if self._reopen("cpu", word):
            self.say(f"{self.world.threads} threads ({word} the cores), state carried over")

    def _reopen(self, backend: str, threads: str) -> bool:
        """Open every world anew and go on from its state; on an error the old ones go on."""
        fresh: list[Simulation] = []

        def reopen() -> None:
            for world in self.worlds:
                fresh.append(self._open(world.scene, backend, threads, world.state()))

        if not self._guard(reopen):
            for world in fresh:
                world.close()
            return False
        old, self.worlds = self.worlds, fresh
        for world in old:
            world.close()
        self.backend, self.threads = backend, threads
        self.hand.forget()
        self._guard(self._push)
        return True

    # ------------------------------------------------------------------ poking

    def name(self, particle: int) -> str:
        """`row, column` of a mass."""
        return "{}, {}".format(*divmod(particle, self.world.body.columns))

    def force(self) -> tuple[float, float]:
        """The held force [N]; (0, 0) without one."""
        return self.hand.force(self.world, self.positions[0], self._frame_time())

    def _frame_time(self) -> float:
        return self.steps_per_frame * self.world.scene.method.dt

    def _push(self) -> None:
        self.hand.push(self.world, self.positions[0], self._frame_time())

    def _tell_selection(self, particle: int) -> None:
        pinned = self.world.body.inverse_mass[particle] == 0
        self.say(f"mass {self.name(particle)} selected" + ("; it is pinned and does not move" if pinned else ""))

    def move_selection(self, columns: int, rows: int) -> None:
        """Arrows: select the neighbour `columns` to the right and `rows` up; the first press selects the middle.

        The direction is also where Enter pokes to from then on.
        """
        self._tell_selection(self.hand.move(columns, rows, self.world))

    def press(self, x: float, y: float, reach: float) -> bool:
        """Mouse down at (x, y) [m]: take the nearest mass within `reach` [m], to be pulled toward the pointer."""
        if self._blocked():
            return False
        particle = nearest(self.positions[0], x, y, reach)
        if particle is None:
            return False
        self.hand.selected = particle
        self.hand.held = Poke(particle, (x, y))
        self._tell_selection(particle)
        return self._guard(self._push)

    def drag(self, x: float, y: float) -> None:
        """The pointer is at (x, y) [m] now."""
        held = self.hand.held
        if held is not None and held.target is not None:
            self.hand.held = Poke(held.particle, (x, y))

    def press_key(self) -> None:
        """Enter down: poke the selected mass downward, or the way of the last arrow key."""
        if self._blocked():
            return
        if self.hand.selected is None:
            self.move_selection(0, 0)
            self.hand.direction = DOWN
        if self.hand.selected is not None and self.hand.held is None:
            self.hand.held = Poke(self.hand.selected, None, self.hand.direction)
            self._guard(self._push)

    def release(self) -> None:
        """Mouse or Enter up."""
        if self.hand.held is not None:
            self.hand.held = None
            self._guard(self._push)
