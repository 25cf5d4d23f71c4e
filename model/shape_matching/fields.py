"""The fields of bodies of clusters: rotations, centres, deformations, plastic deformations, lost contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.types import Real
from softlab.model.core.family import Field, fault, on_host
from softlab.model.geometry.arithmetic.ordered import determinant, dot
from softlab.model.scene.scene import Scene

UNIT = 1e-3  # tolerance of a quaternion's length: float32 rounding, or a text file with three digits


def _checked(
    name: str, values: object, shape: tuple[int, ...], real: Real, size: Callable, words: tuple[str, str]
) -> np.ndarray:
    """Return an array with an entry for each cluster, `shape` in all, in the arithmetic `real`, unchanged.

    `size`: of the arrays in float64, which must be 1. `words`: names of an entry and of its size. Raises InputError.
    """
    array = np.asarray(values)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, this scene needs {shape}: a {words[0]} for each cluster")
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} holds {array.dtype}, this needs real numbers")
    with np.errstate(invalid="ignore"):
        sizes = size(array)
    if not (np.abs(sizes - 1) <= UNIT).all():  # false for NaN
        worst = int(np.argmax(np.where(np.isfinite(sizes), np.abs(sizes - 1), np.inf)))
        raise InputError(f"{name} of cluster {worst} has the {words[1]} {sizes[worst]:g}; it must be 1")
    return np.ascontiguousarray(array, dtype=real)


def _check_rotation(scene: Scene, rotation: object, real: Real) -> np.ndarray:
    """Return unit quaternions, (clusters, 4)."""
    return _checked("rotation", rotation, (scene.body_set.clusters.count, 4), real, _lengths, ("quaternion", "length"))


def _check_plastic(scene: Scene, plastic: object, real: Real) -> np.ndarray:
    """Return plastic deformations of determinant 1, (clusters, 3, 3)."""
    return _checked("plastic", plastic, (scene.body_set.clusters.count, 3, 3), real, _volumes, ("matrix", "volume"))


def _lengths(quaternions: np.ndarray) -> np.ndarray:
    return np.sqrt(dot(quaternions.astype(np.float64), quaternions.astype(np.float64)))


def _volumes(matrices: np.ndarray) -> np.ndarray:
    return determinant(matrices.astype(np.float64))


def _download_plastic(simulation: Any) -> np.ndarray:
    """Return the plastic deformation of all clusters, from that of loose ones: lattices have none."""
    loose, count = simulation._download_plastic(), simulation.scene.body_set.clusters.count
    every = np.tile(np.eye(3, dtype=simulation.real), (count, 1, 1))
    if loose is not None:
        every[: len(loose)] = loose
    return every


def _upload_plastic(simulation: Any, plastic: np.ndarray | None) -> None:
    simulation._upload_plastic(None if plastic is None else plastic[: simulation.scene.body_set.loose.count])


ROTATION = Field(
    "rotation", "clusters", (4,), "1", "unit quaternions (w, x, y, z); in the state, those from which the next ones are "
    "computed",
    read=on_host(lambda simulation: simulation.read_clusters()[0]),
    check=_check_rotation,
    download=lambda simulation: simulation._download_rotation(),
    upload=lambda simulation, rotation: simulation._upload_rotation(rotation),
)  # fmt: skip
CENTRE = Field(
    "centre", "clusters", (3,), "m", "centres of mass", on_host(lambda simulation: simulation.read_clusters()[1])
)
DEFORMATION = Field(
    "deformation", "clusters", (3, 3), "1", "matrices from rest offsets to goal offsets",
    on_host(lambda simulation: simulation._read_deformation()),
)  # fmt: skip
PLASTIC = Field(
    "plastic", "clusters", (3, 3), "1", "plastic deformation of rest offsets, of determinant 1",
    on_host(_download_plastic), _check_plastic, _download_plastic, _upload_plastic,
)  # fmt: skip
CONTACTS_LOST = fault(
    "contacts_lost", "neighbours of particles that did not fit into their lists",
    lambda simulation: int(simulation.contacts_lost),
)  # fmt: skip


def of_bodies(scene: Scene) -> tuple[Field, ...]:
    """Return the fields of a scene with bodies of clusters."""
    plastic = (PLASTIC,) if "plastic" in scene.body_set.clusters.parts else ()
    return (*plastic, ROTATION, CENTRE, DEFORMATION, *((CONTACTS_LOST,) if scene.contact else ()))
