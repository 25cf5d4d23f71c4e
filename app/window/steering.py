"""Settings of the demo's worlds: fields of scenes and options of the run, for keys (app/window/demo.py) and panel
(app/window/panel). A live field changes during the run. Any other is compiled into a world, which is then reopened,
with its state if the masses are still the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from softlab.app.window.live import stiffness_paths
from softlab.app.window.picker import Picker
from softlab.app.window.poking import Poking
from softlab.app.window.worlds import STEPS_PER_FRAME
from softlab.model.base.errors import SoftlabError
from softlab.model.core.options import LIVE_PATHS
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene

CHANGED = "a setting was changed while it ran"


class Steering(Poking):
    """Worlds whose settings can be changed. `generation`: number of times that the worlds were replaced, so that
    their views are replaced; `rebuilt`: they were opened with fields other than those of `scenes`. User actions
    never raise."""

    generation = 0
    rebuilt = False

    @property
    def changed(self) -> list[Simulation]:
        """Worlds that a setting applies to: all, or only the chosen one."""
        return [self.world] if self.alone else self.worlds

    @property
    def whose(self) -> str:
        """Prefix of a message about a single world."""
        return f"{self.titles[self.current]}: " if self.alone else ""

    def turn_to(self, number: int) -> None:
        """Make another world the current one, which is selected and reported."""
        if number != self.current:
            self.release()
            self.current, self.picker = number, Picker(self.scenes[number].dimensions)
            self.refresh(force=True)

    def choose(self, number: int | None) -> None:
        """Apply changes to this world only from now on, or (None) to all."""
        self.alone = number is not None
        self.turn_to(number or 0)
        self.say(f"keys change {self.titles[self.current] + ' only' if self.alone else 'all scenes'}")

    # ------------------------------------------------------------------ fields

    def is_live(self, path: str) -> bool:
        """Return True if a field changes while the world runs."""
        return any(path in LIVE_PATHS[name] for name in self.world.options.live)

    def set_field(self, path: str, value: object) -> bool:
        """Set a field in the worlds that changes apply to and that have its table, live or by reopening them."""
        if self._blocked():
            return False
        part = path.partition(".")[0]
        fields = [{path: value} if part in world.scene.parts else {} for world in self.changed]
        if not any(fields):
            self.say(f"{self.whose}{path}: this scene has no such table")
            return False
        if not self.is_live(path):
            return self.set_fields(fields, lambda: f"{path} = {_text(value)}")
        if not self._change(list(zip(self.changed, fields, strict=True))):
            return False
        self.say(f"{self.whose}{path} = {_text(value)}")
        return True

    def set_fields(self, wanted: Sequence[Mapping[str, object]], message: Callable[[], str]) -> bool:
        """Reopen each changed world with the `wanted` fields, and show `message()`. Returns True on success."""
        if self._blocked():
            return False
        changes = {id(world): fields for world, fields in zip(self.changed, wanted, strict=True)}
        scenes: list[Scene] = []

        def make() -> None:
            for world in self.worlds:
                scenes.append(world.scene.replace(changes.get(id(world), {})))

        if not self._guard(make):
            return False
        same = all(_same_masses(scene, world.scene) for scene, world in zip(scenes, self.worlds, strict=True))
        if not self._reopen(self.backend, self.threads, scenes, from_start=not same):
            return False
        self._moved = True
        self.refresh(force=True)
        self.say(f"{self.whose}{message()}, " + ("state kept" if same else "restarted because the masses changed"))
        return True

    def _change(self, wanted: Sequence[tuple[Simulation, Mapping[str, object]]]) -> bool:
        """Set fields of worlds by their paths; on an error, show the reason and change no world."""
        before = [(world, path, field_of(world, path)) for world, fields in wanted for path in fields]

        def change() -> None:
            try:
                for world, fields in wanted:
                    self._at = self.worlds.index(world)
                    for path, value in fields.items():
                        world.set(path, value)
            except SoftlabError:
                for world, path, value in before:
                    world.set(path, value)
                raise

        if not self._guard(change):
            return False
        self.disturb(CHANGED)
        return True

    def set_steps(self, steps: int) -> None:
        """Set the steps per frame, one of STEPS_PER_FRAME."""
        self.steps_per_frame = min(STEPS_PER_FRAME, key=lambda known: abs(known - steps))
        self.say(f"{self.steps_per_frame} steps per frame")

    def one_step(self) -> None:
        """Do a single step of the world with the longest dt, and pause."""
        if self._blocked():
            return
        self.paused = True
        if self._guard(lambda: self._pull_and_advance(1)):
            self._moved = True
            self.refresh(force=True)
            self.say(f"step {self._leading_world.step}; press space to continue")

    # ------------------------------------------------------------------ how they are run

    @property
    def options(self) -> dict[str, str | None]:
        """The choice of `precision`, `math` and `kernel` (None: the default of the backend)."""
        return {"kernel": None, **self._options}

    def run_with(
        self, options: Mapping[str, str | None], backend: str | None = None, threads: str | None = None
    ) -> bool:
        """Change `precision`, `math` or `kernel` in `options`, backend or number of threads, and keep the state.
        Returns True on success; otherwise the reason becomes the message, and nothing changes."""
        if self._blocked():
            return False
        before = self._options
        wanted = before | dict(options)
        if backend not in (None, self.backend):
            wanted |= {"kernel": None}  # each has its own
        self._options = {name: value for name, value in wanted.items() if value is not None or name != "kernel"}
        if not self._reopen(backend or self.backend, threads or self.threads):
            self._options = before
            return False
        return True

    def _reopen(
        self, backend: str, threads: str, scenes: Sequence[Scene] | None = None, from_start: bool = False
    ) -> bool:
        """Open every world again, with `scenes` if they are given, and continue from the current states or
        `from_start`. On an error the open worlds continue."""
        fresh: list[Simulation] = []

        def reopen() -> None:
            for world, scene in zip(self.worlds, scenes or [world.scene for world in self.worlds], strict=True):
                fresh.append(self._open(scene, backend, threads, None if from_start else world.state()))

        if not self._opened(reopen, fresh):
            return False
        if scenes is not None:
            self.generation += 1
            self.rebuilt = scenes is not self.scenes
            if from_start:
                self._start_anew()
            else:
                self.disturb(CHANGED)
        self.backend, self.threads = backend, threads
        self.picker.forget()
        self._guard(self._push)
        return True

    def show(self, scenes: Sequence[Scene], states: Sequence[State | None] | None = None) -> bool:
        """Replace the scenes by others, from their start or from `states`. If that fails, the old ones continue."""
        fresh: list[Simulation] = []
        states = states or [None] * len(scenes)

        def opening() -> None:
            self._check(scenes)
            for scene, state in zip(scenes, states, strict=True):
                fresh.append(self._open(scene, self.backend, self.threads, state))

        self.release()
        if not self._opened(opening, fresh):
            return False
        self._begin(scenes)
        self.generation, self.rebuilt = self.generation + 1, False
        return True

    def _opened(self, opening: Callable[[], None], fresh: list[Simulation]) -> bool:
        """Return True if `opening` filled `fresh`, which then replaces the worlds."""
        if not self._guard(opening):
            for world in fresh:
                world.close()
            return False
        old, self.worlds = self.worlds, fresh
        for world in old:
            world.close()
        return True

    def show_current_only(self) -> None:
        """Show the current world alone, with its state."""
        self._show_as_it_is(1)

    def guarded(self, action: Callable[[], object]) -> bool:
        """Run `action`. Returns True on success; else the reason becomes the message."""
        return not self._blocked() and self._guard(action)

    def goes_on_from(self, load: Callable[[], object], why: str) -> bool:
        """Replace the states by `load`, after which no reference is valid, with the reason `why`. Returns True on
        success."""
        self.release()
        if not self.guarded(load):
            return False
        self.disturbed = why
        self._moved = True
        self.refresh(force=True)
        return True

    def compare(self) -> bool:
        """Show the current world twice, side by side, with its state; later changes apply to the second."""
        if not self._show_as_it_is(2):
            return False
        self.choose(1)
        return True

    def _show_as_it_is(self, times: int) -> bool:
        """Show the current world that many times, with its state, and no other."""
        states: list[State] = []
        if not self.guarded(lambda: states.append(self.world.state())):
            return False
        disturbed, steps = self.disturbed, self.steps_per_frame
        if not self.show([self.world.scene] * times, states * times):
            return False
        self.disturbed, self.steps_per_frame = disturbed, steps
        return True


def field_of(world: Simulation, path: str) -> Any:
    """Return the current value of a live field."""
    if path == "gravity.enabled":
        return bool(world.scene.gravity and world.scene.gravity.enabled)
    if path in (known := stiffness_paths(world.scene)):
        return known[path]
    return world.scene.value(path)


def _same_masses(scene: Scene, other: Scene) -> bool:
    """Return True if a state of one scene is valid in the other: as many masses, with the same weights and pins."""
    from softlab.model.core.build import build

    one, two = build(scene.whole), build(other.whole)
    return one.position.shape == two.position.shape and bool(
        (abs(one.inverse_mass - two.inverse_mass) <= 1e-6 * abs(two.inverse_mass)).all()
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_text, value))}]"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
