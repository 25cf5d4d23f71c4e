"""Clusters over the particles of a body: their centres, their members, and connectivity of the body.

Centres are particles, each the farthest from those before it until all are nearer than the spacing of clusters (T. F.
Gonzalez, "Clustering to minimize the maximum intercluster distance", 1985): no two are nearer to each other than that,
and a radius of the spacing leaves no particle out. A particle's coefficient decreases smoothly with its distance from
the centre.
"""

from __future__ import annotations

from math import ceil, log10

import numpy as np

from softlab.model.assets.clusters import Clusters
from softlab.model.base.errors import SceneError
from softlab.model.geometry.arithmetic.ordered import eigenvalues, mean, norm
from softlab.model.geometry.edges import components
from softlab.model.geometry.lists import offsets_of
from softlab.model.geometry.neighbours import SLACK, TooMany, pairs_within

RIM = 0.1  # the coefficient at the radius; over 0, so that every member has an effect
COLLINEAR = 2.0**-10  # width over length of a cluster that counts as a line: rotation about it moves nothing visibly
FEWEST = 4  # particles that can span a space


def falloff(part: np.ndarray) -> np.ndarray:
    """Return the coefficient of a particle at `part` of the radius from the centre: 1 at 0, RIM at 1, with slope 0 at
    both."""
    return RIM + (1 - RIM) * (1 - np.square(part)) ** 2


def centres(position: np.ndarray, spacing: float) -> np.ndarray:
    """Return the central particles among `position` (particles, 3) [m], (clusters,) int64, the first nearest to the
    mean position."""
    from scipy.spatial import cKDTree

    tree = cKDTree(position)
    first = int(np.argmin(norm(position - mean(position))))
    chosen, distance = [first], norm(position - position[first])
    while (farthest := float(distance.max())) >= spacing:
        new = int(np.argmax(distance))
        chosen.append(new)
        # a new centre can only be nearest to particles within the current largest distance
        near = np.array(tree.query_ball_point(position[new], farthest * SLACK), dtype=np.int64)
        distance[near] = np.minimum(distance[near], norm(position[near] - position[new]))
    return np.array(chosen)


def gather(position: np.ndarray, mass: np.ndarray, spacing: float, radius: float, stiffness: float) -> Clusters:
    """Return clusters of `radius` [m] about centres `spacing` [m] apart, all of one stiffness [1/s^2]; members
    ascending.

    `position` (particles, 3) [m], `mass` (particles,) [kg]. Some particles may belong to none: see `check`.
    """
    middle = position[centres(position, spacing)]
    try:
        cluster, particle, distance = pairs_within(middle, position, radius)
    except TooMany as error:
        raise SceneError("cluster_radius", radius, str(error)) from None
    return Clusters(
        offsets_of(np.bincount(cluster, minlength=len(middle))),
        particle.astype(np.int32),
        falloff(distance / radius),
        np.full(len(middle), stiffness),
        mass,
        position,
    )


def one_cluster(position: np.ndarray, mass: np.ndarray) -> Clusters:
    """Return a rigid body: everything in one cluster, all coefficients 1, its stiffness inf."""
    count = len(position)
    everyone = np.arange(count, dtype=np.int32)
    return Clusters(np.array([0, count], np.int32), everyone, np.ones(count), np.array([np.inf]), mass, position)


def parts(clusters: Clusters, links: np.ndarray) -> int:
    """Return the number of parts of the body connected by clusters or `links` (n, 2); an unconnected particle is one,
    too."""
    count = len(clusters.mass)
    memberships = np.stack([clusters.indices, clusters.owner + count], axis=1)
    label = components(count + clusters.count, np.concatenate([memberships, links]))
    return len(np.unique(label[:count]))


def check(clusters: Clusters, links: np.ndarray, spacing: float, radius: float, pieces: int) -> int:
    """Return the number of connected parts.

    Raises SceneError, with a sufficient radius, where particles are in no cluster or there are more parts than `pieces`
    of the mesh.
    """
    orphans, connected = clusters.orphans, parts(clusters, links)
    if not len(orphans) and connected <= pieces:
        return connected
    enough = ceiled(least_radius(clusters.position, links, spacing, pieces))
    count = len(clusters.mass)
    what = (
        f"{len(orphans)} of {count} particles are in no cluster, and the body would fall apart"
        if len(orphans)
        else f"the clusters overlap too little, and the body would fall into {connected} parts"
    )
    raise SceneError(
        "cluster_radius", radius, f"{what}; use at least {enough:g}, or a smaller cluster_spacing (now {spacing:g})"
    )


def least_radius(position: np.ndarray, links: np.ndarray, spacing: float, pieces: int) -> float:
    """Return the smallest radius [m] with which every particle is in a cluster and at most `pieces` parts are left."""
    chosen = centres(position, spacing)
    count, radius = len(position), spacing
    while True:
        cluster, particle, distance = pairs_within(position[chosen], position, radius)
        pairs = np.stack([particle, cluster + count], axis=1)

        def fit(radius: float, pairs: np.ndarray = pairs, distance: np.ndarray = distance) -> bool:
            near = pairs[distance <= radius]
            if len(np.unique(near[:, 0])) < count:
                return False
            label = components(count + len(chosen), np.concatenate([near, links]))
            return len(np.unique(label[:count])) <= pieces

        if fit(radius):
            break
        radius *= 2
    steps = np.unique(distance)
    low, high = 0, len(steps) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if fit(steps[middle]) else (middle + 1, high)
    return float(steps[low])


def ceiled(value: float) -> float:
    """Return `value` > 0 with three digits, rounded up, so that a user can type it and it suffices."""
    unit = 10.0 ** (ceil(log10(value)) - 3) if value > 0 else 1.0
    steps = ceil(value / unit)
    rounded = float(f"{steps * unit:.6g}")
    return rounded if rounded >= value else float(f"{(steps + 1) * unit:.6g}")


def undetermined(clusters: Clusters) -> int:
    """Return the number of clusters with fewer than FEWEST particles, or all on one line: their rotation is partly
    undetermined."""
    values = eigenvalues(clusters.rest_moments)
    line = values[:, 1] <= COLLINEAR**2 * values[:, 2]
    return int(((np.diff(clusters.offsets) < FEWEST) | line).sum())
