"""The state of a simulation: every array that the next step reads, and the checks before a run continues from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.errors import InputError
from softlab.model.core.backend import Backend
from softlab.model.core.family import Field
from softlab.model.core.options import PRECISIONS

FAMILY = {"declared by": "a family"}  # metadata of the attributes that a family declares as a `Field`


@dataclass(frozen=True)
class State:
    """State of a simulation: every array that the next step reads.

    Attributes
    ----------
    position, velocity : (particles, dimensions) float arrays, m and m/s
        In the order of the scene, in the simulation's precision.
    inverse_mass : (particles,) float array, 1/kg
        0 where a particle is pinned, or waits for an emitter (model/particles/fluid_set.py).
    time : float
        Simulated time, s.
    step : int
        Steps since the scene's start.
    rotation : (clusters, 4) float array, optional
        Unit quaternions (w, x, y, z) of bodies, from which the next rotations are computed; None: computed again.
    plastic : (clusters, 3, 3) float array, optional
        Plastic deformation of bodies' rest offsets, of determinant 1; None: no deformation.
    clock : Clock
        Time and step at which the present step size began.
    taps : (emitters, 2) float array, optional
        Per emitter the time since which it has its speed, s, and the layers that had left it by then; None: as in the scene.
    """

    position: np.ndarray
    velocity: np.ndarray
    inverse_mass: np.ndarray
    time: float
    step: int
    rotation: np.ndarray | None = field(default=None, metadata=FAMILY)
    plastic: np.ndarray | None = field(default=None, metadata=FAMILY)
    clock: Clock = START
    taps: np.ndarray | None = field(default=None, metadata=FAMILY)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays that only some families have and this state has, by name."""
        values = {name: getattr(self, name) for name in FAMILY_ARRAYS}
        return {name: array for name, array in values.items() if array is not None}


FAMILY_ARRAYS = tuple(one.name for one in fields(State) if one.metadata == FAMILY)


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


def checked_family_arrays(state: State, declared: Sequence[tuple[Field, Backend]]) -> Mapping[str, np.ndarray]:
    """Return the arrays of the families, by name, in the arithmetic of the simulations that have them (`declared`).

    Raises InputError, also for an array that none of them has.
    """
    known = {one.name: (one, simulation) for one, simulation in declared}
    checked = {}
    for name, array in state.arrays.items():
        if name not in known:
            raise InputError(f"{name}: this scene has no such array; leave it out")
        one, simulation = known[name]
        assert one.check is not None
        checked[name] = one.check(simulation.scene, array, simulation.real)
    return checked
