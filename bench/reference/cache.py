"""Cache of converged references: each takes about a second to compute and is the same for every run of a scene."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from softlab.bench.reference.mass_spring import converged
from softlab.model.base.disk_cache import read_arrays, write_arrays
from softlab.model.scene.scene import Scene

# spacings; RK4 at dt 0.0025 on the accuracy scenes has an error of 8e-8, which shall be resolved tenfold
TOLERANCE = 5e-9


@dataclass(frozen=True)
class Converged:
    """`position`, `velocity` (particles, dimensions) float64 at the requested time, and the error `estimate` [m]."""

    position: np.ndarray
    velocity: np.ndarray
    estimate: float


@cache
def sources(folder: Path = Path(__file__).parent) -> bytes:
    """Return the contents of the Python files in a folder and its subfolders, which determine a stored reference."""
    files = sorted((file.relative_to(folder).as_posix(), file) for file in folder.rglob("*.py"))
    return b"".join(name.encode() + b"\0" + file.read_bytes() + b"\0" for name, file in files)


def key(scene: Scene, time: float, inertia: float, tolerance: float) -> str:
    """Return 16 hexadecimal digits of the scene without its method (which the reference does not use), the time and the
    rest.
    """
    material = {name: table for name, table in scene.as_dict().items() if scene.kinds.get(name, "method") != "method"}
    text = f"{json.dumps(material, sort_keys=True)} {time!r} {inertia!r} {tolerance!r} ".encode()
    return hashlib.sha256(text + sources()).hexdigest()[:16]


def cached_reference(
    scene: Scene,
    time: float,
    folder: Path | None,
    *,
    inertia: float = 1.0,
    tolerance: float = TOLERANCE,
    per_radian: float = 4,
) -> Converged:
    """Return the converged reference from `folder`, or compute it and store it there (None: not stored).

    `per_radian`: initial number of steps, which the tolerance refines. Raises the errors of `converged`.
    """
    file = folder / f"reference-{key(scene, time, inertia, tolerance)}.npz" if folder else None
    return cached_state(
        file,
        scene,
        lambda: Converged(*converged(scene, time, inertia=inertia, tolerance=tolerance, per_radian=per_radian)),
    )


def cached_state(file: Path | None, scene: Scene, make: Callable[[], Converged]) -> Converged:
    """Return a reference of the scene, stored in the file as by `cached_arrays`."""
    shape = scene.grid.particle_count, scene.dimensions
    arrays = cached_arrays(file, {"position": shape, "velocity": shape, "estimate": ()}, lambda: vars(make()))
    return Converged(arrays["position"], arrays["velocity"], float(arrays["estimate"]))


def cached_arrays(
    file: Path | None, shapes: Mapping[str, tuple[int, ...]], make: Callable[[], Mapping[str, ArrayLike]]
) -> Mapping[str, np.ndarray]:
    """Return arrays of these `shapes` by name from the file, or make them and store them (None: not stored).

    A file that cannot be read or written only costs the time to make them again.
    """
    stored = read_arrays(file) if file else None
    if stored and all(name in stored and stored[name].shape == shape for name, shape in shapes.items()):
        return stored
    computed = {name: np.asarray(array) for name, array in make().items()}
    if file:
        write_arrays(file, computed)
    return computed
