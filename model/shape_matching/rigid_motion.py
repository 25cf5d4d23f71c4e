"""Tables for rigid bodies that conserve their momenta to rounding (model/formulas/shape_matching/rigid.py)."""

from __future__ import annotations

import numpy as np

from softlab.model.assets.clusters import Clusters, whole_clusters
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.geometry.arithmetic.ordered import norm

ROTATION = 4  # roundings of a body's size in a goal: of a rotation's row and of a rest offset's displacement


def goal_slack(clusters: Clusters, real: Real) -> np.ndarray:
    """Return the rounding error of goals in the arithmetic `real`, (particles,) float64 [m]; 0 for particles of no
    rigid body.

    ROTATION roundings of the longest rest offset, and for the centre a random walk of those of each lane's sum.
    """
    whole, sizes = whole_clusters(clusters), np.diff(clusters.offsets)
    extent = np.zeros(clusters.count)
    np.maximum.at(extent, clusters.owner, norm(clusters.rest))
    slack = float(np.finfo(real).eps) * extent * (ROTATION + np.sqrt(sizes / LANES))
    slack_of_particle = np.zeros(len(clusters.mass))
    rigid = whole[clusters.owner]
    slack_of_particle[clusters.indices[rigid]] = np.maximum(slack, float(np.finfo(real).tiny))[clusters.owner[rigid]]
    return slack_of_particle
