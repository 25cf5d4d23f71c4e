"""Keeping converged references: a second each to make, the same for every run of a scene."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.reference.mass_spring import converged
from model.core.disk_cache import read_arrays, write_arrays
from model.scene.scene import Scene

TOLERANCE = 5e-9  # spacings; RK4 at dt 0.0025 on the accuracy scenes is at 8e-8, and shall be resolved tenfold


@dataclass(frozen=True)
class Converged:
    """`position`, `velocity` (particles, dimensions) float64 at the asked-for time, and the `estimate` [m] of the error."""

    position: np.ndarray
    velocity: np.ndarray
    estimate: float


@cache
def sources(folder: Path = Path(__file__).parent) -> bytes:
    """What a kept reference was made by, the Python files of a folder and of those in it: other code, other references."""
    files = sorted((file.relative_to(folder).as_posix(), file) for file in folder.rglob("*.py"))
    return b"".join(name.encode() + b"\0" + file.read_bytes() + b"\0" for name, file in files)


def key(scene: Scene, time: float, inertia: float, tolerance: float) -> str:
    """16 hexadecimal digits of the scene without its method (the reference does not use it), the time and the rest."""
    material = {name: table for name, table in scene.as_dict().items() if scene.kinds.get(name, "method") != "method"}
    text = f"{json.dumps(material, sort_keys=True)} {time!r} {inertia!r} {tolerance!r} ".encode()
    return hashlib.sha256(text + sources()).hexdigest()[:16]


def kept(
    scene: Scene,
    time: float,
    folder: Path | None,
    *,
    inertia: float = 1.0,
    tolerance: float = TOLERANCE,
    per_radian: float = 4,
) -> Converged:
    """The converged reference, from `folder` where it lies there, else made and put there (None: nothing is kept).

    `per_radian`: the steps to begin with, which the tolerance makes finer. Raises what `converged` raises.
    """
    file = folder / f"reference-{key(scene, time, inertia, tolerance)}.npz" if folder else None
    how: dict[str, Any] = {"inertia": inertia, "tolerance": tolerance, "per_radian": per_radian}
    return kept_state(file, scene, lambda: Converged(*converged(scene, time, **how)))


def kept_state(file: Path | None, scene: Scene, make: Callable[[], Converged]) -> Converged:
    """A reference of the scene, kept in the file as `kept_arrays` are."""
    shape = scene.grid.particle_count, scene.dimensions
    found = kept_arrays(file, {"position": shape, "velocity": shape, "estimate": ()}, lambda: vars(make()))
    return Converged(found["position"], found["velocity"], float(found["estimate"]))


def kept_arrays(
    file: Path | None, shapes: Mapping[str, tuple[int, ...]], make: Callable[[], Mapping[str, Any]]
) -> Mapping[str, Any]:
    """Arrays of these `shapes` by name, from the file where it holds them, else made and put there (None: nothing is kept). A
    file that cannot be read or written costs the time to make them again, nothing else."""
    held = read_arrays(file) if file else None
    if held and all(name in held and held[name].shape == shape for name, shape in shapes.items()):
        return held
    made = make()
    if file:
        write_arrays(file, **made)
    return made
