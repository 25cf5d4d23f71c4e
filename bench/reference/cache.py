"""Keeping converged references: a second each to make, the same for every run of a scene."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from bench.reference.mass_spring import converged
from model.scene import Scene

TOLERANCE = 5e-9  # spacings; RK4 at dt 0.0025 on the accuracy scenes is at 8e-8, and shall be resolved tenfold


@dataclass(frozen=True)
class Converged:
    """`position`, `velocity` (particles, 2) float64 at the asked-for time, and the `estimate` [m] of the error."""

    position: np.ndarray
    velocity: np.ndarray
    estimate: float


@cache
def _sources() -> bytes:
    """What a kept reference was made by: other code, other references."""
    return b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))


def key(scene: Scene, time: float, inertia: float, tolerance: float) -> str:
    """16 hexadecimal digits of the scene without its method (the reference does not use it), the time and the rest."""
    material = scene.replace({"method.dt": 1.0, "method.integrator": "rk4"}).canonical()
    text = f"{material} {time!r} {inertia!r} {tolerance!r} ".encode()
    return hashlib.sha256(text + _sources()).hexdigest()[:16]


def kept(
    scene: Scene, time: float, folder: Path | None, *, inertia: float = 1.0, tolerance: float = TOLERANCE
) -> Converged:
    """The converged reference, from `folder` where it lies there, else made and put there (None: nothing is kept).

    A file that cannot be read or written costs the time to make it again, nothing else. Raises what `converged` raises.
    """
    file = folder / f"reference-{key(scene, time, inertia, tolerance)}.npz" if folder else None
    if file:
        try:
            with np.load(file) as held:
                found = Converged(held["position"], held["velocity"], float(held["estimate"]))
            if found.position.shape == found.velocity.shape == (scene.grid.particle_count, 2):
                return found
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error):  # not there, or cut short
            pass
    made = Converged(*converged(scene, time, inertia=inertia, tolerance=tolerance))
    if file:
        _write(file, made)
    return made


def _write(file: Path, made: Converged) -> None:
    """Under another name first, so that a killed process leaves no half of a reference."""
    try:
        file.parent.mkdir(exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, suffix=".tmp")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as opened:
            np.savez(opened, position=made.position, velocity=made.velocity, estimate=made.estimate)
        os.replace(name, file)
    except OSError:
        Path(name).unlink(missing_ok=True)
