"""The interactive demo without a window: every key and drag is a method here, so that tests can call it.

`Demo` owns a list of simulations (worlds) that run side by side. Gravity, step size and stiffness change in all of them
or, if one was chosen, in that one; everything else applies to all. User actions never raise: the reason goes to
`message`, and the old state continues.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from softlab.app.window.live import live_fields, stiffness_paths
from softlab.app.window.materials import bodies_of, material_at, material_changes, material_text
from softlab.app.window.spare_bodies import counts_text, drop, next_spare
from softlab.app.window.steering import Steering
from softlab.app.window.worlds import STEPS_PER_FRAME

THREAD_WORDS = ("1x", "2x", "4x")
NO_BODIES = "this scene has no bodies"
FACTOR = 1.25  # one press of [ ] { }


class Demo(Steering):
    """The running demo of one or more scenes: the keys and the mouse as methods. The constructor raises what
    `open_simulation` raises; its public attributes are those of `Worlds`."""

    # ------------------------------------------------------------------ keys

    def next_world(self) -> None:
        """Change all worlds, the first alone, the second alone, in turn (Tab)."""
        if len(self.worlds) == 1:
            self.say("only one scene is open; softlab demo SCENE SCENE shows two side by side")
            return
        following = self.current + 1 if self.alone else 0
        self.choose(following if following < len(self.worlds) else None)

    def toggle_gravity(self) -> None:
        """Switch gravity on or off (G)."""
        if self._blocked():
            return
        on = not self.gravity
        if self._change([(world, {"gravity.enabled": on}) for world in self.changed]):
            parts = [world.scene.gravity for world in self.changed]
            accelerations = dict.fromkeys(f"{part.acceleration:g}" for part in parts if part)
            self.say(f"{self.whose}gravity " + (f"on: {', '.join(accelerations)} m/s² downward" if on else "off"))

    @property
    def gravity(self) -> bool:
        gravity = self.world.scene.gravity
        return bool(gravity and gravity.enabled)

    def toggle_pause(self) -> None:
        """Pause or continue (space)."""
        self.paused = not self.paused
        self.say("paused; press space to continue" if self.paused else "running")

    def change_dt(self, presses: int) -> None:
        """Change the step size by a factor of 1.25, down (-1, key [) or up (+1, key ])."""
        if self._blocked():
            return
        factor = FACTOR**presses
        if self._change([(world, {"method.dt": world.scene.method.dt * factor}) for world in self.changed]):
            self.say(f"{self.whose}dt {self.world.scene.method.dt:.4g} s, {self.limit_text()}")

    def change_stiffness(self, presses: int) -> None:
        """Change the spring stiffness by a factor of 1.25, down (-1, key {) or up (+1, key })."""
        if bodies_of(self.world.scene):
            self.change_material("young_modulus", presses)
            return
        if self._blocked():
            return
        wanted = [
            (world, {path: stiffness * FACTOR**presses for path, stiffness in stiffness_paths(world.scene).items()})
            for world in self.changed
        ]
        first = next((fields for _, fields in wanted if fields), None)
        if first is None:
            self.say(f"{self.whose}this scene has no elastic springs")
        elif self._change(wanted):
            texts = [
                f"{'' if path.startswith('springs.') else path.partition('.')[0] + ' '}stiffness {stiffness:.4g} N/m"
                for path, stiffness in first.items()
            ]
            self.say(f"{self.whose}{', '.join(texts)}; dt {self.world.scene.method.dt:.4g} s, {self.limit_text()}")

    def change_material(self, field: str, presses: int) -> None:
        """Change Young's modulus (by 1.25), Poisson's ratio (its distance from 1/2 by 1.25) or the damping (by 2) of
        all bodies, down (-1) or up (+1): keys ( ) < > and, for tetrahedra, { }.

        Constraints depend on the material, so the worlds are reopened.
        """
        if self._blocked():
            return
        if not bodies_of(self.world.scene):
            self.say(f"{self.whose}this scene has no tetrahedra")
            return
        wanted = [material_changes(world.scene, field, presses) for world in self.changed]
        self.set_fields(wanted, lambda: material_text(self.world.scene, field))

    def change_material_to(self, field: str, value: float) -> None:
        """Set `field` of the first body to `value`; the others change by the same factor (for the panel)."""
        first = next(iter(bodies_of(self.world.scene)))
        if self._guard(lambda: self.world.scene.replace({f"{first}.{field}": value})):
            wanted = [material_at(world.scene, field, value) for world in self.changed]
            self.set_fields(wanted, lambda: material_text(self.world.scene, field))

    def limit_text(self) -> str:
        """Return the step size relative to its limit, in words."""
        method, limit = self.world.scene.method.name, self.world.limit
        if limit == 0:
            return f"unstable at every dt with {method}"
        if math.isinf(limit):
            return "no limit"
        relation = "OVER the limit of" if self.over_limit else "limit"
        return f"{relation} {limit:.4g} s"

    def change_steps(self, presses: int) -> None:
        """Change the steps per frame along 1, 2, 5, 10, 20 ..., down (-1, key -) or up (+1, key +)."""
        place = STEPS_PER_FRAME.index(self.steps_per_frame) + presses
        self.set_steps(STEPS_PER_FRAME[min(max(place, 0), len(STEPS_PER_FRAME) - 1)])

    def restart(self) -> None:
        """Reset the masses and all settings to those of the scene (R)."""

        def back() -> None:
            for world, scene in zip(self.worlds, self.scenes, strict=True):
                world.reset()
                if "poke" in world.options.live:
                    world.poke(None)
                for path, value in live_fields(scene).items():
                    world.set(path, value)

        self.picker.poke = None
        if self.world.scene.copies:  # it may wait again
            self.picker.selected = None
        self.picker.forget()
        self.frozen, self.failure = False, ""
        if self.rebuilt and not self._reopen(self.backend, self.threads, self.scenes, from_start=True):
            return
        if self._guard(back):
            self.disturbed = ""
            self._read()
            self.refresh(force=True)
            self.say("restarted with the original settings of the scene")

    def switch_backend(self) -> None:
        """Switch from the CPU to the GPU or back, with the current state (B)."""
        other = "gpu" if self.backend == "cpu" else "cpu"
        if self.run_with({}, backend=other):
            self.say(f"now on the {other}: {self.world.device}, state kept")

    def cycle_threads(self) -> None:
        """Use 1x, 2x, 4x as many threads as cores, in turn (T)."""
        if self._blocked():
            return
        if self.backend != "cpu":
            self.say("threads apply to the cpu backend; press B to switch to it")
            return
        place = THREAD_WORDS.index(self.threads) if self.threads in THREAD_WORDS else -1
        word = THREAD_WORDS[(place + 1) % len(THREAD_WORDS)]
        if self.run_with({}, threads=word):
            self.say(f"{self.world.threads} threads ({word} the cores), state kept")

    # ------------------------------------------------------------------ bodies that come and go

    def drop_body(self, place: Sequence[float]) -> None:
        """Activate a body above `place` [m]; each part in turn (D)."""
        if self._blocked():
            return
        if not self.world.scene.copies:
            self.say(NO_BODIES)
            return

        def bring() -> None:
            for world in self.changed:
                self._at = self.worlds.index(world)
                name = next_spare(world, self._dropped)
                drop(world, name, place)
            self._dropped = name
            self.say(f"{self.whose}{name} dropped: {counts_text(self.world)}")

        self._guard(bring)
        self._moved = True
        self.refresh(force=True)

    def remove_body(self) -> None:
        """Deactivate the body of the selected particle (X)."""
        if self._blocked():
            return
        selected, copies = self.picker.selected, self.world.scene.copies
        if selected is None or not copies:
            self.say("select a body first: click it or press an arrow key" if copies else NO_BODIES)
            return
        copy = copies[self.world.scene.body_set.body[selected]]
        if self._guard(lambda: self.world.remove_body(copy.number)):
            self.picker.poke = self.picker.selected = None
            self.picker.forget()
            self._moved = True
            self.say(f"{copy.name} removed: {counts_text(self.world)}")
            self.refresh(force=True)
