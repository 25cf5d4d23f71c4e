"""Partition of a fluid: slabs of space across its longest side, and the halo around each. Pure arithmetic.

A particle is owned by the slab in which it lies. Its window also contains the particles within the halo of the slab, on
which the owned ones may depend in a substep. So a substep only sends the bounding box of all particles, from which the
cells are made; after it owners send the particles that now lie in or near another slab. The choice of slabs does not
change bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.families import family_of
from softlab.model.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Slabs:
    """`axis`: along which they follow each other; `bounds` (slabs - 1,) float64 [m]: the planes between them (the
    first and the last one have no outer end); `halo` [m]."""

    axis: int
    bounds: np.ndarray
    halo: float

    @property
    def count(self) -> int:
        """Number of slabs."""
        return len(self.bounds) + 1

    def ends(self, slab: int) -> tuple[float, float]:
        """Return the ends of a slab [m]; the outer ends of the first and the last one are infinite."""
        ends = [-float("inf"), *self.bounds.tolist(), float("inf")]
        return ends[slab], ends[slab + 1]

    def owned(self, along: np.ndarray, slab: int) -> np.ndarray:
        """Return which coordinates along the axis are in a slab, (n,) bool; NaN counts to the last slab."""
        low, high = self.ends(slab)
        beyond = ~(along < low) if slab else np.ones(len(along), bool)
        return beyond & (along < high) if slab + 1 < self.count else beyond

    def contained(self, along: np.ndarray, slab: int) -> np.ndarray:
        """Return which coordinates are in a slab or its halo, (n,) bool; NaN counts as inside every slab."""
        low, high = self.ends(slab)
        return ~((along < low - self.halo) | (along > high + self.halo))


def fluid_halo_of(scene: Scene) -> float:
    """Return the halo of the scene's slabs [m]. Raises SceneError if the scene's family, or a part of it, cannot be
    divided into slabs.

    Raises SceneError for a scene whose family, or a part of it, cannot be divided into slabs.
    """
    halo = family_of(scene).halo
    assert halo is not None
    return halo(scene)


def is_in_slabs(scene: Scene) -> bool:
    """Return True if the scene is divided into slabs of space."""
    return family_of(scene).halo is not None


def slabs_of(scene: Scene, position: np.ndarray, count: int, halo: float) -> Slabs:
    """Return `count` slabs with equal numbers of particles at their current positions.

    They lie across the longest side of the particles' bounding box among the axes that do not repeat; non-finite
    positions count as the origin.
    """
    place = np.where(np.isfinite(position), position, 0.0)
    fixed = [axis for axis in range(scene.dimensions) if "xyz"[axis] not in _repeats(scene)]
    axis = max(fixed, key=lambda axis: float(np.ptp(place[:, axis])))
    along = np.sort(place[:, axis].astype(np.float64))
    cuts = [len(along) * k // count for k in range(1, count)]
    return Slabs(axis, np.array([(along[cut - 1] + along[cut]) / 2 for cut in cuts]), halo)


def slabs_at_start(scene: Scene, count: int, steps: int | None, option: str) -> Slabs:
    """Return the slabs of the scene's start.

    Raises SceneError, naming the `option`, for scenes that cannot be shared, or not by so many, and for any `steps`
    between two exchanges: a fluid exchanges in each substep.
    """
    halo = fluid_halo_of(scene)
    if steps is not None:
        raise SceneError(
            "--exchange-every",
            steps,
            "applies to a sheet that is shared by its rows: a fluid sends each substep; leave it out",
        )
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    position, repeats = scene.fluid_set.position, _repeats(scene)
    if len(repeats) == scene.dimensions:
        reason = "is periodic along every axis, but slabs cut one of them; run the scene on one GPU or process"
        raise SceneError(f"{scene.name_of('domain')}.repeats", list(repeats), reason)
    if count > len(position):
        raise SceneError(option, count, f"{len(position)} particles can be shared by at most as many; use fewer")
    slabs = slabs_of(scene, position, count, halo)
    length = float(np.ptp(position[:, slabs.axis])) + scene.fluid_set.spacing
    if count > 1 and length / count < halo:
        thin = f"slabs of {length / count:.3g} m along {'xyz'[slabs.axis]} are thinner than their halo"
        reason = f"{thin}, {halo:.3g} m for {scene.method.iterations} iterations; use fewer shares or iterations"
        raise SceneError(option, count, reason)
    return slabs


def _repeats(scene: Scene) -> tuple[str, ...]:
    return tuple(scene.domain.repeats) if scene.domain else ()
