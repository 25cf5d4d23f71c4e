"""What the interactive demo does, without a window: every key and drag is a method here, and can be tested as one.

`Demo` owns a list of simulations (worlds) that run side by side; actions apply to all of them, and masses are picked in
the first. It never raises for what a user does: the reason goes to `message`, and the old state goes on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from app.hand import Poke, nearest, neighbour
from app.worlds import STEPS_PER_FRAME, Worlds, stiffness_paths
from model.simulation import Simulation

THREAD_WORDS = ("1x", "2x", "4x")
FACTOR = 1.25  # one press of [ ] { }


class Demo(Worlds):
    """The running demo of one or more scenes: the keys and the mouse as methods. Raises what `open_simulation` raises, when
    opening only; its public attributes are those of `Worlds`."""

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
        now = stiffness_paths(self.world.scene)
        if not now:
            self.say("this scene has no springs")
            return
        wanted = {path: stiffness * FACTOR**presses for path, stiffness in now.items()}

        def change() -> None:
            for path, stiffness in wanted.items():
                self._set(path, stiffness)

        if self._guard(change):
            texts = [
                f"{'' if path.startswith('springs.') else path.partition('.')[0] + ' '}stiffness {stiffness:.4g} N/m"
                for path, stiffness in wanted.items()
            ]
            self.say(f"{', '.join(texts)}; dt {self.world.scene.method.dt:.4g} s, {self.limit_text()}")

    def limit_text(self) -> str:
        """The step size against its limit, in words."""
        method, limit = self.world.scene.method.name, self.world.limit
        if limit == 0:
            return f"and {method} is unstable at every dt here"
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
                if "poke" in world.options.live:
                    world.poke(None)
                world.set("method.dt", scene.method.dt)
                world.set("gravity.enabled", bool(scene.gravity and scene.gravity.enabled))
                for path, stiffness in stiffness_paths(scene).items():
                    world.set(path, stiffness)

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
        """`row, column` of a mass; of bodies the particle's number, and whose it is."""
        if self.world.scene.bodies:
            crowd = self.world.scene.crowd
            copy = crowd.copies[crowd.body[particle]]
            return f"{particle} of {copy.name}"
        return "{}, {}".format(*divmod(particle, self.world.body.columns))

    def force(self) -> tuple[float, ...]:
        """The held force [N], of as many components as the world has; 0 without one."""
        return self.hand.force(self.world, self.positions[0], self._hold_time())

    def _tell_selection(self, particle: int) -> None:
        pinned = self.world.body.inverse_mass[particle] == 0
        what = "particle" if self.world.scene.bodies else "mass"
        self.say(f"{what} {self.name(particle)} selected" + ("; it is pinned" if pinned else ""))

    def move_selection(self, columns: int, rows: int, direction: Sequence[float] | None = None) -> None:
        """Arrows: select the neighbour `columns` to the right and `rows` up; the first press selects the middle.

        The `direction` (in the plane that same way) is also where Enter pokes to from then on.
        """
        towards = (float(columns), float(rows)) if direction is None else tuple(direction)
        if self.hand.selected is not None and self.world.scene.bodies:
            crowd = self.world.scene.crowd
            own = np.flatnonzero(crowd.body == crowd.body[self.hand.selected])
            self._tell_selection(
                self.hand.move_to(neighbour(self.positions[0], own, self.hand.selected, towards), towards)
            )
            return
        self._tell_selection(self.hand.move(columns, rows, self.world, towards))

    def press(self, x: float, y: float, reach: float) -> bool:
        """Mouse down at (x, y) [m] in the plane: take the nearest mass within `reach` [m], to be pulled to the pointer."""
        if self._blocked():
            return False
        particle = nearest(self.positions[0], x, y, reach)
        return particle is not None and self.take(particle, (x, y))

    def take(self, particle: int, target: Sequence[float]) -> bool:
        """Select a mass and pull it toward `target` [m] until `release`."""
        if self._blocked():
            return False
        self.hand.selected = particle
        self.hand.held = Poke(particle, tuple(target))
        self._tell_selection(particle)
        return self._guard(self._push)

    def drag(self, *target: float) -> None:
        """The pointer is at `target` [m] now."""
        held = self.hand.held
        if held is not None and held.target is not None:
            self.hand.held = Poke(held.particle, target)

    def press_key(self) -> None:
        """Enter down: poke the selected mass downward, or the way of the last arrow key."""
        if self._blocked():
            return
        if self.hand.selected is None:
            self.move_selection(0, 0)
            self.hand.direction = self.hand.down
        if self.hand.selected is not None and self.hand.held is None:
            self.hand.held = Poke(self.hand.selected, None, self.hand.direction)
            self._guard(self._push)

    def release(self) -> None:
        """Mouse or Enter up."""
        if self.hand.held is not None:
            self.hand.held = None
            self._guard(self._push)
