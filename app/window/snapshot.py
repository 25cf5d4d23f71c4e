"""The demo's scene and state as files: the scene with all changes, and the positions of its masses."""

from __future__ import annotations

from pathlib import Path

from softlab.app.command.scene_file import write_scene
from softlab.app.output.files import read_state, write_state
from softlab.app.window.demo import Demo
from softlab.app.window.shots import free_path
from softlab.model.base.errors import InputError

LOADED = "the state was loaded from a file"


def save_scene(demo: Demo, name: str = "") -> str:
    """Write the current world's scene as TOML, into the file `name` or a new one. Returns the file, or "" with the
    reason as a message."""
    path = Path(name.strip()) if name.strip() else free_path(demo, ".toml")
    heading = f"softlab demo, {demo.titles[demo.current]}, as it was set at {demo.world.time:g} s"
    saved: list[Path] = []
    if demo.guarded(lambda: saved.append(write_scene(path, demo.world.scene, heading))):
        demo.say(f"saved {saved[0]}; softlab demo {saved[0].name} opens it")
    return str(saved[0]) if saved else ""


def save_state(demo: Demo, name: str = "") -> str:
    """Write the current world's state, as `save_scene` does."""
    path = Path(name.strip()) if name.strip() else free_path(demo, ".npz")
    saved: list[Path] = []

    def save() -> None:
        if path.exists():
            raise InputError(f"{path} exists already; give another name")
        saved.append(write_state(path, demo.world.state()))

    if demo.guarded(save):
        demo.say(f"saved {saved[0]}")
    return str(saved[0]) if saved else ""


def load_state(demo: Demo, name: str) -> bool:
    """Load a saved state into the changed worlds."""

    notes: list[str] = []

    def load() -> None:
        if not name.strip():
            raise InputError("give the name of a state file (.npz)")
        states = [read_state(name.strip(), world.scene, notes) for world in demo.changed]
        for world, state in zip(demo.changed, states, strict=True):
            world.load(state)

    if not demo.goes_on_from(load, LOADED):
        return False
    demo.say("; ".join([f"loaded {name.strip()}: {demo.world.time:g} s, step {demo.world.step}", *notes[:1]]))
    return True
