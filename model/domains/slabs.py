"""Who owns what when a fluid is shared: slabs of space across its longest side, and the halo around each. Pure arithmetic.

A particle is owned by the share in whose slab it lies. A share holds those, too, that lie within the halo of its slab: all
that what it owns may hang on in a substep. So a substep sends nothing but the box of all particles, of which the cells are
made; after it owners send what now lies in or near another's slab. Which slabs there are changes no bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.core.errors import SceneError
from model.core.families import family_of
from model.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Slabs:
    """`axis`: along which they follow each other; `bounds` (shares - 1,) float64 [m]: where one ends and the next begins, the
    first and the last one have no outer end; `halo` [m]."""

    axis: int
    bounds: np.ndarray
    halo: float

    @property
    def count(self) -> int:
        """How many shares."""
        return len(self.bounds) + 1

    def ends(self, share: int) -> tuple[float, float]:
        """[m]: where a slab begins and ends; of the first and the last one the outer end is infinite."""
        found = [-float("inf"), *self.bounds.tolist(), float("inf")]
        return found[share], found[share + 1]

    def owned(self, along: np.ndarray, share: int) -> np.ndarray:
        """(n,) bool: which of coordinates along the axis lie in a slab; what is no number lies in the last one."""
        low, high = self.ends(share)
        beyond = ~(along < low) if share else np.ones(len(along), bool)
        return beyond & (along < high) if share + 1 < self.count else beyond

    def held(self, along: np.ndarray, share: int) -> np.ndarray:
        """(n,) bool: which of them lie in its slab or its halo; what is no number lies in all."""
        low, high = self.ends(share)
        return ~((along < low - self.halo) | (along > high + self.halo))


def fluid_halo_of(scene: Scene) -> float:
    """[m]. Raises SceneError for a scene whose family, or a part of it, is not shared by slabs."""
    halo = family_of(scene).halo
    assert halo is not None
    return halo(scene)


def is_in_slabs(scene: Scene) -> bool:
    """Whether several share the scene by slabs of space."""
    return family_of(scene).halo is not None


def slabs_of(scene: Scene, position: np.ndarray, count: int, halo: float) -> Slabs:
    """As many slabs with as many particles each, where they are now, across the longest side of their box of those that do
    not repeat; what is nowhere counts as being at the origin."""
    place = np.where(np.isfinite(position), position, 0.0)
    fixed = [axis for axis in range(scene.dimensions) if "xyz"[axis] not in _repeats(scene)]
    axis = max(fixed, key=lambda axis: float(np.ptp(place[:, axis])))
    along = np.sort(place[:, axis].astype(np.float64))
    cuts = [len(along) * k // count for k in range(1, count)]
    return Slabs(axis, np.array([(along[cut - 1] + along[cut]) / 2 for cut in cuts]), halo)


def slabs_at_start(scene: Scene, count: int, steps: int | None, option: str) -> Slabs:
    """Those of the scene's start. Raises SceneError, naming the `option`, for what cannot be shared, or not by so many;
    `steps` between two exchanges are one's."""
    halo = fluid_halo_of(scene)
    if steps is not None:
        raise SceneError(
            "--exchange-every",
            steps,
            "is for a sheet that is shared by its rows: a fluid sends each substep; leave it out",
        )
    if count < 1:
        raise SceneError(option, count, "must be at least 1")
    position, repeats = scene.fluid_set.position, _repeats(scene)
    if len(repeats) == scene.dimensions:
        told = "repeats along every axis, across one of which a fluid is shared: run it as one"
        raise SceneError(f"{scene.name_of('domain')}.repeats", list(repeats), told)
    if count > len(position):
        raise SceneError(option, count, f"{len(position)} particles can be shared by at most as many; use fewer")
    found = slabs_of(scene, position, count, halo)
    length = float(np.ptp(position[:, found.axis])) + scene.fluid_set.spacing
    if count > 1 and length / count < halo:
        thin = f"slabs of {length / count:.3g} m along {'xyz'[found.axis]} are thinner than their halo"
        told = f"{thin}, {halo:.3g} m for {scene.method.iterations} iterations; use fewer shares or iterations"
        raise SceneError(option, count, told)
    return found


def _repeats(scene: Scene) -> tuple[str, ...]:
    return tuple(scene.domain.repeats) if scene.domain else ()
