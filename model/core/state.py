"""The state of a simulation: every array that the next step reads, and the checks before a run continues from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.core.clock import START, Clock
from model.core.errors import InputError
from model.core.options import PRECISIONS


@dataclass(frozen=True)
class State:
    """Every array the next step reads. `position`, `velocity` (particles, dimensions), C-contiguous, in builder order, in
    the simulation's precision; `inverse_mass` (particles,) [1/kg], 0 where pinned; `time` [s]; `step`; of bodies
    `rotation` (clusters, 4), the unit quaternions (w, x, y, z) that the next rotations are looked for from: None where there
    are none, or they are to be found anew; of plastic bodies `plastic` (clusters, 3, 3), of volume 1: what their rest offsets
    have been bent by, None: nothing; `clock`: since when `time` goes by the present step size; of emitters `taps`
    (emitters, 2): since when [s] each has its speed, and how many layers had left it by then, None: as the scene says;
    `wetness` (particles,): of a cloth that drinks, of what it can hold, 0 to 1, None: nothing. Of fluids what waits for an
    emitter has inverse mass 0, and is PARKED (model/fluid/fluid_set.py)."""

    position: np.ndarray
    velocity: np.ndarray
    inverse_mass: np.ndarray
    time: float
    step: int
    rotation: np.ndarray | None = None
    plastic: np.ndarray | None = None
    clock: Clock = START
    taps: np.ndarray | None = None
    wetness: np.ndarray | None = None


def checked_arrays(state: State, shape: tuple[int, ...], precision: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return (position and velocity in that precision, C-contiguous, by name; inverse masses unchanged) of a state.

    `shape`: that of the positions. Raises InputError for other shapes, values that are not real numbers, and non-finite
    values.
    """
    arrays = {}
    for name in ("position", "velocity"):
        array = np.asarray(getattr(state, name))
        if array.shape != shape:
            raise InputError(f"{name} has shape {array.shape}, this scene needs {shape}")
        if not np.issubdtype(array.dtype, np.number) or np.issubdtype(array.dtype, np.complexfloating):
            raise InputError(f"{name} holds {array.dtype}, this needs real numbers")
        with np.errstate(over="ignore"):
            arrays[name] = np.ascontiguousarray(array, dtype=PRECISIONS[precision])
        finite = np.isfinite(arrays[name])
        if not finite.all():
            odd = np.argwhere(~finite)
            value = f"{name} of particle {odd[0][0]} is {float(array[tuple(odd[0])]):g}"
            if np.isfinite(array[tuple(odd[0])]):
                origin = "a body's velocity or spin" if name == "velocity" else "grid.spacing or a body's origin"
                remedy = f"see {origin}, or use float64"
                raise InputError(f"{value}, more than {precision} can hold: {remedy}")
            raise InputError(f"{value}, not a finite number")
    inverse_mass = np.asarray(state.inverse_mass)
    if inverse_mass.shape != shape[:1]:
        raise InputError(f"inverse_mass has shape {inverse_mass.shape}, this scene needs {shape[:1]}")
    return arrays, inverse_mass
