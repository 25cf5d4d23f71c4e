"""What both backends' solvers of clusters read beside the clusters themselves."""

from __future__ import annotations

import numpy as np

from model.clusters import Clusters, matching_share
from model.errors import InputError

UNIT = 1e-3  # a quaternion's length may be off by: what float32 leaves, and what a text file with three digits does


def matching_factors(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """(entries,) float64: how far an entry moves its particle towards its goal in one of `iterations` of a substep [s]: its
    share of the particle times `matching_share` of its cluster."""
    b = matching_share(clusters.stiffness, substep, iterations)
    factors: np.ndarray = clusters.shares * b[clusters.owner]
    return factors


def first_particles(clusters: Clusters) -> np.ndarray:
    """(clusters,) int32: the particle that positions are counted from; 0 of a cluster that has none."""
    found = np.zeros(clusters.count, np.int32)
    some = np.diff(clusters.offsets) > 0
    found[some] = clusters.indices[clusters.offsets[:-1][some]]
    return found


def leans(clusters: Clusters, real: type) -> np.ndarray:
    """(clusters, 4) in the arithmetic `real`: the centre [m] of the rest offsets, and one over the mass [1/kg], both of the
    masses and offsets that are rounded to it; 0 of a cluster without mass."""
    m, rest, owner, count = clusters.masses.astype(real).astype(float), clusters.rest, clusters.owner, clusters.count
    sums = [np.bincount(owner, m * axis.astype(real), count) for axis in rest.T]
    mass = np.bincount(owner, m, count)
    inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
    return np.stack([*(one * inverse for one in sums), inverse], axis=1).astype(real)


def checked_rotation(rotation: np.ndarray, count: int, real: type) -> np.ndarray:
    """(clusters, 4) unit quaternions (w, x, y, z) in the arithmetic `real`, as they are. Raises InputError."""
    array = np.asarray(rotation)
    if array.shape != (count, 4):
        raise InputError(
            f"rotation has shape {array.shape}, this scene needs ({count}, 4): a quaternion for each cluster"
        )
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"rotation holds {array.dtype}, this needs real numbers")
    length = np.sqrt(np.einsum("nk,nk->n", array, array, dtype=np.float64))
    if not (np.abs(length - 1) <= UNIT).all():  # false for NaN
        worst = int(np.argmax(np.where(np.isfinite(length), np.abs(length - 1), np.inf)))
        raise InputError(f"rotation of cluster {worst} has the length {length[worst]:g}; it must be 1")
    return np.ascontiguousarray(array, dtype=real)
