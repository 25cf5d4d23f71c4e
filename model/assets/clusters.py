"""Clusters of particles for shape matching, in compressed form, and constants derived from them.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005; overlapping clusters, each with a
coefficient for every particle, after M. Macklin et al., "Unified Particle Physics for Real-Time Applications", 2014. A
particle's weight in a cluster is its coefficient over the sum of its coefficients, and its mass is split among its
clusters likewise: every cluster moves its own part of the mass, so that linear and angular momentum are conserved
exactly, for any coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from softlab.model.assets.material import Material
from softlab.model.base.errors import InputError
from softlab.model.formulas.shape_matching.deformation import MIN_VOLUME
from softlab.model.geometry.arithmetic.functions import expm1, log1p
from softlab.model.geometry.arithmetic.ordered import eigenvalues, inverse
from softlab.model.geometry.lists import grouped

FLAT = 1e-4  # of the moments of rest offsets, smallest over largest: a hundredth as thick as it is long


@dataclass(frozen=True, eq=False)
class Clusters:
    """Members and stiffness of clusters.

    `offsets` (clusters + 1,) int32, from 0: cluster k has the entries offsets[k] to offsets[k + 1]; `indices`
    (entries,) int32, the particle of each entry; `coefficients` (entries,) float64 in [0, 1]; `stiffness` (clusters,)
    float64: the square of the angular frequency [1/s^2] at which a particle oscillates about its goal, inf for a rigid
    cluster; `mass` (particles,) float64 [kg], of pinned ones too; `position` (particles, dimensions) float64 [m], at
    rest; `material`: effects other than rotation, or None.
    """

    offsets: np.ndarray
    indices: np.ndarray
    coefficients: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    position: np.ndarray
    material: Material | None = None

    def __post_init__(self) -> None:
        _check(self)

    @property
    def count(self) -> int:
        """Number of clusters."""
        return len(self.offsets) - 1

    @property
    def parts(self) -> frozenset[str]:
        """Features of the material that need code, see `Material.parts`."""
        return frozenset() if self.material is None else self.material.parts

    @cached_property
    def owner(self) -> np.ndarray:
        """Cluster of each entry, (entries,) int32."""
        return np.repeat(np.arange(self.count, dtype=np.int32), np.diff(self.offsets))

    @cached_property
    def weights(self) -> np.ndarray:
        """Weight of each entry in its particle, (entries,) float64; those of a particle with clusters sum to 1."""
        total = binned(self.indices, self.coefficients, len(self.mass))[self.indices]
        return np.divide(self.coefficients, total, out=np.zeros_like(total), where=total > 0)

    @cached_property
    def masses(self) -> np.ndarray:
        """Particle's mass times its weight, (entries,) float64 [kg]."""
        return self.mass[self.indices] * self.weights

    @cached_property
    def cluster_mass(self) -> np.ndarray:
        """Mass of each cluster, (clusters,) float64 [kg]."""
        return binned(self.owner, self.masses, self.count)

    @cached_property
    def rest_centre(self) -> np.ndarray:
        """Rest centre of mass, (clusters, dimensions) float64 [m]; 0 for a cluster without mass."""
        return self.centres(self.position)

    @cached_property
    def rest(self) -> np.ndarray:
        """Rest position of each particle relative to its cluster's centre, (entries, dimensions) float64 [m]."""
        return self.position[self.indices] - self.rest_centre[self.owner]

    @cached_property
    def of_particle(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (offsets (particles + 1,), entries (entries,)) int32: each particle's entries, by their clusters."""
        entries = np.arange(len(self.indices), dtype=np.int32)
        lists = grouped(self.indices, entries, len(self.mass))
        return lists.offsets, lists.indices

    @property
    def rest_moments(self) -> np.ndarray:
        """sum m rest rest', (clusters, d, d) float64 [kg m^2]."""
        return self._summed(self.masses[:, None, None] * self.rest[:, :, None] * self.rest[:, None, :])

    @cached_property
    def inverse_moments(self) -> np.ndarray:
        """Inverse of sum m rest rest', (clusters, d, d) float64 [1/(kg m^2)], which maps moments to the nearest linear
        map.

        0 where the cluster is `flat`, along a line or at a point, and has no such map.
        """
        moments = self.rest_moments
        values = eigenvalues(moments)
        solid = values[:, 0] > FLAT * values[:, -1]
        inverses = np.zeros_like(moments)
        inverses[solid] = inverse(moments[solid])
        return inverses

    @property
    def flat(self) -> np.ndarray:
        """Clusters without a linear map, (clusters,) bool. They rotate, and do not creep."""
        return np.logical_not(np.any(self.inverse_moments, axis=(1, 2)))

    def _summed(self, entries: np.ndarray) -> np.ndarray:
        """Return the sums over each cluster's entries, (clusters, ...), of (entries, ...)."""
        sums = np.zeros((self.count, *entries.shape[1:]))
        np.add.at(sums, self.owner, entries)
        return sums

    def moments(self, position: np.ndarray) -> np.ndarray:
        """Return sum m (x - centre) rest', (clusters, d, d) float64 [kg m^2]."""
        away = self.masses[:, None] * (position[self.indices] - self.centres(position)[self.owner])
        return self._summed(away[:, :, None] * self.rest[:, None, :])

    def rotations(self, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
        """Return the rotation, det +1, nearest to sum m (x - centre) rest', (clusters, d, d) float64, by singular
        values.

        `position` [m]: of particles; `plastic` (clusters, d, d): the plastic deformation of rest offsets.
        """
        moments = self.moments(position)
        if plastic is not None:
            moments = moments @ np.swapaxes(plastic, 1, 2)
        u, _, v = np.linalg.svd(moments)
        signs = np.ones(moments.shape[:2])
        signs[:, -1] = np.sign(np.linalg.det(u) * np.linalg.det(v))
        return np.einsum("nij,nj,njk->nik", u, signs, v)

    def strained(self, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
        """Return the linear map nearest to the particles, (clusters, d, d) float64, from offsets deformed by `plastic`;
        0 where `flat`."""
        map_ = self.moments(position) @ self.inverse_moments
        return map_ if plastic is None else map_ @ np.linalg.inv(plastic)

    def deformations(self, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
        """Return the maps T Sp from rest offsets to goals, (clusters, d, d) float64.

        T = R, or with `linear` b > 0, with the map F of `strained`, b F / cbrt(det F) + (1 - b) R (M. Mueller et al.
        2005, 4.3); below MIN_VOLUME b falls with det F, to 0 where F is flat or mirrored.

        Momentum is conserved: sum m (goal - x) = 0 as sum m rest = 0. The moment of the displacements about the centre
        is the skew part of sum m (x - centre) (T Sp rest)' = A T', A the moments with Sp rest for rest. A R' is
        symmetric, R being the nearest rotation, and so is A F' = A (sum m Sp rest rest' Sp')^-1 A'.
        """
        maps = self.rotations(position, plastic)
        if "linear" in self.parts and self.material is not None:
            map_ = self.strained(position, plastic)
            volume = np.maximum(np.linalg.det(map_), 0.0)
            part = self.material.linear * np.minimum(1.0, volume / MIN_VOLUME)
            scale = part / np.cbrt(np.where(volume > 0, volume, 1.0))
            maps = scale[:, None, None] * map_ + (1 - part)[:, None, None] * maps
        return maps if plastic is None else maps @ plastic

    def centres(self, position: np.ndarray) -> np.ndarray:
        """Return the centres of mass with particles at `position`, (clusters, d) float64 [m]; 0 for a cluster without
        mass."""
        sums = np.stack([binned(self.owner, self.masses * x[self.indices], self.count) for x in position.T], axis=1)
        heavy = self.cluster_mass[:, None] > 0
        return np.divide(sums, self.cluster_mass[:, None], out=np.zeros_like(sums), where=heavy)

    def goals(self, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
        """Return each cluster's goal positions of its particles, (entries, d) float64 [m]: centre + R (rest offset).

        `deformations` replaces R where clusters deform.
        """
        position = np.asarray(position, dtype=np.float64)
        displaced = np.einsum("nij,nj->ni", self.deformations(position, plastic)[self.owner], self.rest)
        return self.centres(position)[self.owner] + displaced

    def energy(self, position: np.ndarray, plastic: np.ndarray | None = None) -> float:
        """Return the sum of w^2 m |goal - x|^2 / 2 over entries [J]; rigid clusters store none."""
        away = self.goals(position, plastic) - np.asarray(position, dtype=np.float64)[self.indices]
        stiffness = np.where(np.isfinite(self.stiffness), self.stiffness, 0.0)[self.owner]
        return 0.5 * float(np.sum(stiffness * self.masses * np.einsum("nk,nk->n", away, away)))

    @property
    def orphans(self) -> np.ndarray:
        """Particles without a cluster, (n,) int64."""
        return np.flatnonzero(np.bincount(self.indices, self.coefficients, len(self.mass)) == 0)


def binned(places: np.ndarray, weights: np.ndarray, count: int) -> np.ndarray:
    """Return the sums of weights by index, (count,) float64, 0 for indices that do not occur."""
    return np.bincount(places, weights, count).astype(np.float64)


Value = TypeVar("Value", float, np.ndarray)
MAX_SUBSTEP = 1e150  # s: Python refuses the square of much more


def matching_factor(stiffness: Value, substep: float, iterations: int) -> Value:
    """Return the fraction of the displacement to their goals by which masses move per iteration: b = 1 - (1 + w^2
    h^2)^(-1 / n).

    `stiffness` w^2 [1/s^2], a number or an array; `substep` h [s]. All n iterations together reduce a lone cluster's
    deviation to 1 / (1 + w^2 h^2), which is a step of implicit Euler, for any n. So the material does not change with
    the step, and converges with it at first order. A stiffness of inf is rigid.

        >>> matching_factor(np.array([3600.0, np.inf]), 1 / 60, 1).round(12).tolist()
        [0.5, 1.0]
    """
    with np.errstate(over="ignore"):
        square = substep**2 if substep < MAX_SUBSTEP else np.inf
        return -expm1(-log1p(stiffness * square) / iterations)


def _check(clusters: Clusters) -> None:
    """Raise InputError for arrays that are no clusters."""
    offsets, indices, coefficients = clusters.offsets, clusters.indices, clusters.coefficients
    if len(offsets) == 0 or offsets[0] != 0:
        raise InputError(
            f"cluster offsets begin with {int(offsets[0]) if len(offsets) else 'nothing'}; they must begin with 0 and have "
            "one more entry than there are clusters"
        )
    if (np.diff(offsets) < 0).any() or offsets[-1] != len(indices):
        raise InputError(
            f"cluster offsets must not fall and must end with the number of indices, {len(indices)}; they end with "
            f"{offsets[-1]}"
        )
    if len(coefficients) != len(indices) or len(clusters.stiffness) != len(offsets) - 1:
        raise InputError(
            f"{len(indices)} indices need as many coefficients, and {len(offsets) - 1} clusters as many stiffnesses; got "
            f"{len(coefficients)} and {len(clusters.stiffness)}"
        )
    if clusters.material is not None and len(clusters.material.linear) != clusters.count:
        raise InputError(f"a material of {len(clusters.material.linear)} clusters for {clusters.count} of them")
    outside = np.flatnonzero((indices < 0) | (indices >= len(clusters.mass)))
    if len(outside):
        raise InputError(
            f"cluster index {int(indices[outside[0]])} at {int(outside[0])}: particles are 0 to {len(clusters.mass) - 1}"
        )
    wrong = np.flatnonzero(~((coefficients >= 0) & (coefficients <= 1)))
    if len(wrong):
        raise InputError(f"coefficient {coefficients[wrong[0]]:g} at {int(wrong[0])}: must be in [0, 1]")
    if not (clusters.stiffness >= 0).all():
        raise InputError("cluster stiffnesses must be at least 0 (1/s^2), inf for rigid ones")


def whole_clusters(clusters: Clusters) -> np.ndarray:
    """Return (clusters,) bool: True for rigid clusters of at least two particles that are in no other cluster."""
    sizes, count = np.diff(clusters.offsets), clusters.count
    whole = (
        np.isinf(clusters.stiffness) & (sizes > 1) & (np.bincount(clusters.owner, clusters.weights != 1, count) == 0)
    )
    if clusters.material is not None:  # no effect on flat ones
        whole &= ((clusters.material.linear == 0) & (clusters.material.creep == 0)) | clusters.flat
    return np.asarray(whole)
