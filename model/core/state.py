"""The state of a simulation: every array that the next step reads, and the checks before a run continues from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softlab.model.core.clock import START, Clock
from softlab.model.core.errors import InputError
from softlab.model.core.options import PRECISIONS
from softlab.model.geometry.arithmetic.ordered import determinant, dot

UNIT = 1e-3  # tolerance of a quaternion's length: float32 rounding, or a text file with three digits


@dataclass(frozen=True)
class State:
    """State of a simulation: every array that the next step reads.

    Attributes
    ----------
    position, velocity : (particles, dimensions) float arrays, m and m/s
        In the order of the scene, in the simulation's precision.
    inverse_mass : (particles,) float array, 1/kg
        0 where a particle is pinned, or waits for an emitter (model/fluid/fluid_set.py).
    time : float
        Simulated time, s.
    step : int
        Steps since the scene's start.
    rotation : (clusters, 4) float array, optional
        Unit quaternions (w, x, y, z) of bodies, from which the next rotations are computed; None: computed anew.
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
    rotation: np.ndarray | None = None
    plastic: np.ndarray | None = None
    clock: Clock = START
    taps: np.ndarray | None = None


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


def _checked(
    name: str, values: np.ndarray, shape: tuple[int, ...], real: type, size: Callable, nouns: tuple[str, str]
) -> np.ndarray:
    """Return an array with an entry for each cluster, `shape` in all, in the arithmetic `real`, unchanged.

    `size`: of the arrays in float64, which must be 1. `nouns`: names of an entry and of its size. Raises InputError.
    """
    array = np.asarray(values)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, this scene needs {shape}: a {nouns[0]} for each cluster")
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} holds {array.dtype}, this needs real numbers")
    with np.errstate(invalid="ignore"):
        sizes = size(array)
    if not (np.abs(sizes - 1) <= UNIT).all():  # false for NaN
        worst = int(np.argmax(np.where(np.isfinite(sizes), np.abs(sizes - 1), np.inf)))
        raise InputError(f"{name} of cluster {worst} has the {nouns[1]} {sizes[worst]:g}; it must be 1")
    return np.ascontiguousarray(array, dtype=real)


def checked_clusters(
    rotation: np.ndarray | None, plastic: np.ndarray | None, parts: frozenset[str], count: int, real: type
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return (unit quaternions (clusters, 4), plastic strains (clusters, 3, 3) of volume 1) in the arithmetic `real`,
    or None.

    Values are unchanged. Raises InputError, also for plastic strains of a scene without plastic bodies.
    """
    if rotation is not None:
        rotation = _checked("rotation", rotation, (count, 4), real, _lengths, ("quaternion", "length"))
    if plastic is not None:
        if "plastic" not in parts:
            raise InputError("plastic: this scene has no plastic bodies; plastic_creep makes them so")
        plastic = _checked("plastic", plastic, (count, 3, 3), real, _volumes, ("matrix", "volume"))
    return rotation, plastic


def _lengths(quaternions: np.ndarray) -> np.ndarray:
    return np.sqrt(dot(quaternions.astype(np.float64), quaternions.astype(np.float64)))


def _volumes(matrices: np.ndarray) -> np.ndarray:
    return determinant(matrices.astype(np.float64))


def every_plastic(loose: np.ndarray | None, count: int) -> np.ndarray | None:
    """Return the plastic strains of all `count` clusters, (clusters, 3, 3), from those of loose ones: lattices have
    none."""
    if loose is None or len(loose) == count:
        return loose
    return np.concatenate([loose, np.tile(np.eye(3, dtype=loose.dtype), (count - len(loose), 1, 1))])
