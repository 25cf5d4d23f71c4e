"""State and trajectory files (.npz): checked when read, and written completely or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.disk_cache import save_arrays
from softlab.model.base.errors import InputError
from softlab.model.base.files import check_target, read_archive, replacing
from softlab.model.core.build import build
from softlab.model.core.state import FAMILY_ARRAYS, State, checked_arrays
from softlab.model.scene.scene import Scene

STATE = ".npz"


def check_state_target(path: Path | str) -> Path:
    """Return `path`, if a state or trajectory could be written there. Raises InputError."""
    return check_target(path, (STATE,), "a state or trajectory file")


def _write(path: Path, arrays: dict[str, np.ndarray | np.generic]) -> Path:
    with replacing(path) as temporary, open(temporary, "wb") as file:
        save_arrays(file, arrays)
    return path


def write_state(path: Path | str, state: State) -> Path:
    """Write `position`, `velocity` (particles, dimensions), `inverse_mass` (particles,), `time` [s] and `step`.

    For bodies also `rotation` (clusters, 4), for plastic ones `plastic` (clusters, 3, 3), for emitters `taps`. If the
    step size was changed, `clock_step` and `clock_time` [s] of the change.
    """
    arrays: dict[str, np.ndarray | np.generic] = {
        name: getattr(state, name) for name in ("position", "velocity", "inverse_mass")
    }
    arrays |= state.arrays
    if state.clock != START:
        arrays |= {"clock_step": np.int64(state.clock.step), "clock_time": np.float64(state.clock.time)}
    return _write(check_state_target(path), arrays | {"time": np.float64(state.time), "step": np.int64(state.step)})


def read_state(path: Path | str, scene: Scene, notes: list[str] | None = None) -> State:
    """Return the state in a .npz file, and add to `notes` which of its arrays are ignored.

    `position` is required. By default velocity is 0, the masses are the scene's, the rotations of bodies are fitted to
    the positions, and there is no plastic strain. Raises InputError for a file that is missing, unreadable, no .npz, or
    without positions of this scene; the other arrays are checked where they are loaded.
    """
    arrays = read_archive(
        path, "a state is a .npz file with named arrays, position among them, such as softlab run --out writes"
    )
    if "position" not in arrays:
        raise InputError(f"{path} has no array named position (it has: {', '.join(arrays) or 'nothing'})")
    position = arrays["position"]
    body = build(scene)
    try:
        time, step = float(arrays.get("time", 0.0)), int(arrays.get("step", 0))
        clock = Clock(int(arrays.get("clock_step", 0)), float(arrays.get("clock_time", 0.0)))
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: time and step must be single numbers") from None
    if not np.isfinite((time, clock.time)).all() or min(step, clock.step) < 0:
        raise InputError(f"{path}: time must be finite and step at least 0 (time = {time}, step = {step}, {clock})")
    velocity = arrays.get("velocity", np.zeros_like(position))
    inverse_mass = arrays.get("inverse_mass", build(scene.at(time)).inverse_mass)
    others = {name: arrays.get(name) for name in FAMILY_ARRAYS}
    state = State(position, velocity, inverse_mass, time, step, clock=clock, **others)
    if notes is not None and "wetness" in arrays:
        notes.append(f"{path}: wetness is ignored; this version simulates no absorption of fluid by cloths")
    try:
        checked_arrays(state, body.position.shape, "float64")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return state


def write_trajectory(path: Path | str, scene: Scene, states: list[State]) -> Path:
    """Write `position`, `velocity` (frames, particles, dimensions), `time` [s], `step` (frames,), the scene as JSON text."""
    return _write(
        check_state_target(path),
        {
            "position": np.stack([state.position for state in states]),
            "velocity": np.stack([state.velocity for state in states]),
            "time": np.array([state.time for state in states]),
            "step": np.array([state.step for state in states]),
            "scene": np.array(json.dumps(scene.whole.as_dict())),
        },
    )
