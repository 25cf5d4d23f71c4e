"""Tables of clusters for both backends' solvers, in addition to the clusters themselves."""

from __future__ import annotations

import numpy as np

from softlab.model.assets.clusters import Clusters, binned, matching_factor
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.deformation import S_CREEP, S_INVERSE, S_LIMIT, S_LINEAR, S_THRESHOLD, SHAPE
from softlab.model.geometry.arithmetic.functions import expm1


def matching_factors(clusters: Clusters, substep: float, iterations: int) -> np.ndarray:
    """Return the fraction of the displacement to its goal that an entry moves its particle per iteration, (entries,)
    float64.

    Its weight in the particle times `matching_factor` of its cluster, for `iterations` of a substep [s].
    """
    b = matching_factor(clusters.stiffness, substep, iterations)
    factors: np.ndarray = clusters.weights * b[clusters.owner]
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
    factors: np.ndarray = clusters.weights * -expm1(-rate * substep)[clusters.owner]
    return factors


def first_particles(clusters: Clusters) -> np.ndarray:
    """Return the particle to which positions are relative, (clusters,) int32; 0 for a cluster without particles."""
    particles = np.zeros(clusters.count, np.int32)
    some = np.diff(clusters.offsets) > 0
    particles[some] = clusters.indices[clusters.offsets[:-1][some]]
    return particles


def leans(clusters: Clusters, real: Real) -> np.ndarray:
    """Return the centre [m] of the rest offsets and one over the mass [1/kg], (clusters, 4) in the arithmetic `real`.

    Both are those of the masses and offsets rounded to it; 0 for a cluster without mass.
    """
    m, rest, owner, count = clusters.masses.astype(real).astype(float), clusters.rest, clusters.owner, clusters.count
    sums = [binned(owner, m * axis.astype(real), count) for axis in rest.T]
    mass = binned(owner, m, count)
    inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
    return np.stack([*(one * inverse for one in sums), inverse], axis=1).astype(real)
