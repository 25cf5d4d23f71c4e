"""Tables of clusters for both backends' solvers, in addition to the clusters themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.model.core.errors import InputError
from softlab.model.formulas.shape_matching.deformation import S_CREEP, S_INVERSE, S_LIMIT, S_LINEAR, S_THRESHOLD, SHAPE
from softlab.model.geometry.arithmetic.functions import expm1
from softlab.model.geometry.arithmetic.ordered import determinant, dot
from softlab.model.shape_matching.clusters import Clusters, binned, matching_share

UNIT = 1e-3  # tolerance of a quaternion's length: float32 rounding, or a text file with three digits


def matching_factors(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """Return the fraction of the displacement to its goal that an entry moves its particle per iteration, (entries,)
    float64.

    Its weight in the particle times `matching_share` of its cluster, for `iterations` of a substep [s].
    """
    b = matching_share(clusters.stiffness, substep, iterations)
    factors: np.ndarray = clusters.shares * b[clusters.owner]
    return factors


def shaping(parts: frozenset[str]) -> frozenset[str]:
    """Return the parts of a scene that change the deformation of clusters."""
    return parts & {"linear", "plastic"}


def shape_table(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """Return the clusters' constants, (clusters, SHAPE) float64, in the order of the S_ constants.

    The inverse moments at rest (xx, xy, xz, yy, yz, zz) [1/(kg m^2)], the linear map's weight, the strain above which a
    cluster creeps, its creep in one of `iterations` of a substep [s], 1 - exp(-c h / n), the largest plastic strain,
    and zeros. All are 0 for a flat cluster.
    """
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
        table[:, S_CREEP] = -expm1(-material.creep * substep / iterations)
    table[clusters.flat] = 0
    return table


def damping_factors(clusters: Clusters, substep: float) -> np.ndarray:
    """Return the fraction by which an entry moves its particle's velocity to its cluster's rigid motion per substep
    [s], (entries,) float64.

    Its weight in the particle times 1 - exp(-d h).
    """
    rate = np.zeros(clusters.count) if clusters.material is None else clusters.material.damping
    factors: np.ndarray = clusters.shares * -expm1(-rate * substep)[clusters.owner]
    return factors


def first_particles(clusters: Clusters) -> np.ndarray:
    """Return the particle to which positions are relative, (clusters,) int32; 0 for a cluster without particles."""
    found = np.zeros(clusters.count, np.int32)
    some = np.diff(clusters.offsets) > 0
    found[some] = clusters.indices[clusters.offsets[:-1][some]]
    return found


def leans(clusters: Clusters, real: type) -> np.ndarray:
    """Return the centre [m] of the rest offsets and one over the mass [1/kg], (clusters, 4) in the arithmetic `real`.

    Both are those of the masses and offsets rounded to it; 0 for a cluster without mass.
    """
    m, rest, owner, count = clusters.masses.astype(real).astype(float), clusters.rest, clusters.owner, clusters.count
    sums = [binned(owner, m * axis.astype(real), count) for axis in rest.T]
    mass = binned(owner, m, count)
    inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
    return np.stack([*(one * inverse for one in sums), inverse], axis=1).astype(real)


def _checked(
    name: str, given: np.ndarray, shape: tuple[int, ...], real: type, size: Callable, told: tuple[str, str]
) -> np.ndarray:
    """Return an array with an entry for each cluster, `shape` in all, in the arithmetic `real`, unchanged.

    `size`: of the arrays in float64, which must be 1. `told`: names of an entry and of its size. Raises InputError.
    """
    array = np.asarray(given)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, this scene needs {shape}: a {told[0]} for each cluster")
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} holds {array.dtype}, this needs real numbers")
    with np.errstate(invalid="ignore"):
        found = size(array)
    if not (np.abs(found - 1) <= UNIT).all():  # false for NaN
        worst = int(np.argmax(np.where(np.isfinite(found), np.abs(found - 1), np.inf)))
        raise InputError(f"{name} of cluster {worst} has the {told[1]} {found[worst]:g}; it must be 1")
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
