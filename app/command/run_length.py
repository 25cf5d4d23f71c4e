"""Length of a run and interval of its recording, from the command line."""

from __future__ import annotations

import math
from collections.abc import Iterable

from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene

MAX_STEPS = 10**15  # more would take years


def parse_record(words: Iterable[str] | None) -> int:
    """Return N of `every=N`. Raises SceneError."""
    word = next(iter(words or ()), "")
    key, _, number = word.partition("=")
    short = number.isascii() and number.isdigit() and len(number) <= len(str(MAX_STEPS))
    if key != "every" or not short or int(number) < 1:
        raise SceneError("--record", word, f"must be two words, every=N FILE.npz, with N from 1 to {MAX_STEPS:.0e}")
    return int(number)


def step_count(scene: Scene, steps: int | None, time: float | None, notes: list[str]) -> int:
    """Return the requested number of steps; a time is rounded to whole steps, which adds a note."""
    if steps is not None and time is not None:
        raise SceneError("--time", time, "--steps and --time are mutually exclusive; pass one of them")
    if steps is not None:
        if not 0 <= steps <= MAX_STEPS:
            raise SceneError("--steps", steps, f"must be a whole number from 0 to {MAX_STEPS:.0e}")
        return steps
    if time is None:
        return 1000
    dt = scene.method.dt
    if not math.isfinite(time) or time < 0:
        raise SceneError("--time", time, "must be a finite number of seconds, at least 0")
    if time / dt > MAX_STEPS:
        raise SceneError(
            "--time", time, f"is more than {MAX_STEPS:.0e} steps of {dt:g} s; use a shorter time or a larger method.dt"
        )
    whole = round(time / dt)
    if abs(whole * dt - time) > 1e-9 * max(dt, time):
        notes.append(f"--time {time:g} s rounded to {whole} steps of {dt:g} s = {whole * dt:.9g} s")
    return whole
