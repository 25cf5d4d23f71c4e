"""Material of clusters: linear deformation, plasticity and damping of inner motion, besides the rotation of shape
matching.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, 4.3 (linear deformations) and 4.5
(plasticity); M. Mueller et al., "Position Based Dynamics", J. Vis. Commun. Image R. 18, 2007, 3.5 (damping).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from softlab.model.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Material:
    """Values of each cluster, all (clusters,) float64.

    `linear` in [0, 1]: how much of a goal follows the linear map nearest to the particles, of unit volume, instead of
    the nearest rotation; `threshold`: the strain, of no unit, over which it creeps; `creep` [1/s]: how fast; `limit` in
    (0, 1): the largest strain that it retains; `damping` [1/s]: the rate at which motion that is not rigid decays.
    """

    linear: np.ndarray
    threshold: np.ndarray
    creep: np.ndarray
    limit: np.ndarray
    damping: np.ndarray

    def __post_init__(self) -> None:
        one = ~((self.linear >= 0) & (self.linear <= 1))
        if one.any():
            raise InputError(f"linear {self.linear[one][0]:g}: must be in [0, 1]")
        for name in ("threshold", "creep", "damping"):
            if not (getattr(self, name) >= 0).all():
                raise InputError(f"{name} of a cluster must be at least 0")
        if not ((self.limit >= 0) & (self.limit < 1)).all():
            raise InputError("limit of a cluster's plastic strain must be in [0, 1): at 1 it could be flat")

    @property
    def parts(self) -> frozenset[str]:
        """Features to compile: `linear`, `plastic`, `cluster_damping`."""
        features = {"linear": self.linear, "plastic": self.creep, "cluster_damping": self.damping}
        return frozenset(name for name, values in features.items() if (values > 0).any())

    def some(self, chosen: np.ndarray | slice) -> Material:
        """Return the material of the `chosen` clusters."""
        return Material(**{field.name: getattr(self, field.name)[chosen] for field in fields(Material)})

    def first(self, count: int) -> Material | None:
        """Return the material of the first `count` clusters; None if they only rotate."""
        material = self.some(slice(count))
        return material if material.parts else None


def even(
    count: int,
    linear: float = 0.0,
    threshold: float = 0.0,
    creep: float = 0.0,
    limit: float = 0.0,
    damping: float = 0.0,
) -> Material:
    """Return the material of `count` identical clusters."""
    return Material(*(np.full(count, float(value)) for value in (linear, threshold, creep, limit, damping)))


def joined(materials: Sequence[Material | None], counts: Sequence[int]) -> Material | None:
    """Return the concatenated material of clusters, `counts` of each; None for a field that none has."""
    if all(one is None for one in materials):
        return None
    whole = [even(count) if one is None else one for one, count in zip(materials, counts, strict=True)]
    return Material(
        **{field.name: np.concatenate([getattr(one, field.name) for one in whole]) for field in fields(Material)}
    )
