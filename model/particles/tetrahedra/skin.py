"""Drawn surfaces of tetrahedral bodies, carried by their tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softlab.model.assets.tetrahedral_body import CookedBody


@dataclass(frozen=True, eq=False)
class Skin:
    """The surfaces that bodies were cut from, carried by their tetrahedra.

    `corners` (points, 4) int32 and `weights` (points, 4) float64: particles that carry each point; `triangles` (n, 3)
    int32 between points, body by body.
    """

    corners: np.ndarray
    weights: np.ndarray
    triangles: tuple[np.ndarray, ...]

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.corners)

    @cached_property
    def faces(self) -> np.ndarray:
        """Triangles of all bodies, (triangles, 3) int32."""
        return np.concatenate(self.triangles)

    def points(self, position: np.ndarray) -> np.ndarray:
        """Return the positions of the points, (points, 3) [m], for particles at `position` (particles, 3)."""
        points: np.ndarray = np.einsum("pk,pkj->pj", self.weights, position[self.corners])
        return points

    def beside(self, other: Skin) -> Skin:
        """Return both skins in one, with the other's pieces last."""
        more = tuple((one + self.count).astype(np.int32) for one in other.triangles)
        corners, weights = np.concatenate([self.corners, other.corners]), np.concatenate([self.weights, other.weights])
        return Skin(corners, weights, self.triangles + more)


def skin_of(bodies: Sequence[CookedBody], first: np.ndarray) -> Skin:
    """Return the skin of bodies whose particles start at index `first`."""
    corners = [
        one.mesh.tetrahedra[one.embedding.tetrahedron] + start for one, start in zip(bodies, first, strict=False)
    ]
    before = np.concatenate([[0], np.cumsum([len(some) for some in corners])])
    return Skin(
        np.concatenate(corners).astype(np.int32),
        np.concatenate([one.embedding.weights for one in bodies]),
        tuple((one.hull_triangles + start).astype(np.int32) for one, start in zip(bodies, before, strict=False)),
    )


def plain_skin(particles: np.ndarray, pieces: tuple[np.ndarray, ...]) -> Skin:
    """Return a skin whose points are the `particles` (n,) themselves; `pieces`: triangles of indices into them."""
    weights = np.zeros((len(particles), 4))
    weights[:, 0] = 1.0
    return Skin(np.repeat(particles[:, None], 4, axis=1).astype(np.int32), weights, pieces)
