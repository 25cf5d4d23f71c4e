"""What both backends' solvers of clusters read beside the clusters themselves."""

from __future__ import annotations

import numpy as np

from model.core.errors import InputError
from model.formulas.deformation import S_CREEP, S_INVERSE, S_LIMIT, S_LINEAR, S_THRESHOLD, SHAPE
from model.shape_matching.clusters import Clusters, binned, matching_share
from model.shape_matching.rigid_rebound import whole_clusters

UNIT = 1e-3  # a quaternion's length may be off by: what float32 leaves, and what a text file with three digits does


def matching_factors(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """(entries,) float64: how far an entry moves its particle towards its goal in one of `iterations` of a substep [s]: its
    share of the particle times `matching_share` of its cluster."""
    b = matching_share(clusters.stiffness, substep, iterations)
    factors: np.ndarray = clusters.shares * b[clusters.owner]
    return factors


def shaping(parts: frozenset[str]) -> frozenset[str]:
    """Those of a scene's parts that clusters are turned by in another way."""
    return parts & {"linear", "plastic"}


def shape_table(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """(clusters, SHAPE) float64, in the order of the S_ constants: the inverse moments at rest (xx, xy, xz, yy, yz, zz)
    [1/(kg m^2)], the linear map's part, the strain over which a cluster creeps, its creep in one of `iterations` of a substep
    [s], 1 - exp(-c h / n), the largest strain kept, and zeros; all 0 of a cluster that is flat."""
    table = np.zeros((clusters.count, SHAPE))
    material, inverse = clusters.material, clusters.inverse_moments
    for place, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        table[:, S_INVERSE + place] = inverse[:, i, j]
    if material is not None:
        table[:, S_LINEAR], table[:, S_THRESHOLD], table[:, S_LIMIT] = (
            material.linear,
            material.threshold,
            material.limit,
        )
        table[:, S_CREEP] = -np.expm1(-material.creep * substep / iterations)
    table[clusters.flat] = 0
    return table


def damping_factors(clusters: Clusters, substep: float, rebounds: bool = False) -> np.ndarray:
    """(entries,) float64: how far an entry moves its particle's velocity towards its cluster's rigid motion in a substep
    [s]: its share of the particle times 1 - exp(-d h); where a scene `rebounds`, all of it of clusters that do as a whole."""
    rate = np.zeros(clusters.count) if clusters.material is None else clusters.material.damping
    if rebounds:
        rate = np.where(whole_clusters(clusters), np.inf, rate)
    factors: np.ndarray = clusters.shares * -np.expm1(-rate * substep)[clusters.owner]
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
    sums = [binned(owner, m * axis.astype(real), count) for axis in rest.T]
    mass = binned(owner, m, count)
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


def checked_plastic(plastic: np.ndarray, count: int, real: type) -> np.ndarray:
    """(clusters, 3, 3) in the arithmetic `real`, as they are. Raises InputError."""
    array = np.asarray(plastic)
    if array.shape != (count, 3, 3):
        raise InputError(
            f"plastic has shape {array.shape}, this scene needs ({count}, 3, 3): a matrix for each cluster"
        )
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"plastic holds {array.dtype}, this needs real numbers")
    with np.errstate(invalid="ignore"):
        volume = np.linalg.det(array.astype(np.float64))
    if not (np.abs(volume - 1) <= UNIT).all():  # false for NaN
        worst = int(np.argmax(np.where(np.isfinite(volume), np.abs(volume - 1), np.inf)))
        raise InputError(f"plastic of cluster {worst} has the volume {volume[worst]:g}; it must be 1")
    return np.ascontiguousarray(array, dtype=real)


def checked_clusters(
    rotation: np.ndarray | None, plastic: np.ndarray | None, parts: frozenset[str], count: int, real: type
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Both as they were checked, where they are given. Raises InputError, for plastic strains of a scene without, too."""
    if rotation is not None:
        rotation = checked_rotation(rotation, count, real)
    if plastic is not None:
        if "plastic" not in parts:
            raise InputError("plastic: this scene has no plastic bodies; plastic_creep makes them so")
        plastic = checked_plastic(plastic, count, real)
    return rotation, plastic


def every_plastic(loose: np.ndarray | None, count: int) -> np.ndarray | None:
    """(clusters, 3, 3) of all `count` clusters, of those of loose ones: no strain of lattices'."""
    if loose is None or len(loose) == count:
        return loose
    return np.concatenate([loose, np.tile(np.eye(3, dtype=loose.dtype), (count - len(loose), 1, 1))])
