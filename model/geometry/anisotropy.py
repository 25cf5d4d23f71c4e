"""Particles of a fluid as ellipsoids: flat where they lie at its surface.

J. Yu, G. Turk, "Reconstructing Surfaces of Particle-Based Fluids Using Anisotropic Kernels", ACM TOG 32 (2013), sections 4.1
and 4.2: the covariance of a particle's neighbours, weighted by 1 - (distance / support)^3, describes their spread. Its
axes are the ellipsoid's, whose lengths are in proportion to the square roots of the variances, none shorter than a quarter of
the longest; a particle with few neighbours is a small ball. The volume stays that of the ball; theirs goes by a constant of
the kernel.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

FEW = 6  # neighbours: those with no more are balls, in three dimensions
LONE = 0.6  # of the radius, of a ball alone
FLATTEST = 4.0  # times: the longest axis over the shortest
SMOOTHED = 0.9  # of the way from a particle to the mean of its neighbours, for the middle of its ellipsoid


def ellipsoids(position: np.ndarray, radius: float, support: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ellipsoids of particles: balls of `radius` [m] stretched along their neighbours within `support` [m].

    `position`: (particles, 3) [m]. Returns (middles (particles, 3) [m], axes (particles, 3, 3) [m], which map the unit ball
    to the ellipsoid).
    """
    position = np.asarray(position, np.float64)
    pairs = cKDTree(position).query_pairs(support, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    apart = position[other] - position[one]
    weight = 1 - (np.linalg.norm(apart, axis=1) / support) ** 3
    count, total = np.bincount(one, minlength=len(position)), 1 + np.bincount(one, weight, len(position))
    mean = np.stack([np.bincount(one, weight * apart[:, k], len(position)) for k in range(3)], axis=1) / total[:, None]
    spread = np.empty((len(position), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            second = np.bincount(one, weight * apart[:, i] * apart[:, j], len(position)) / total
            spread[:, i, j] = spread[:, j, i] = second - mean[:, i] * mean[:, j]
    variance, directions = np.linalg.eigh(spread)
    length = np.sqrt(np.maximum(variance, 0))
    length = np.maximum(length, np.maximum(length[:, 2:], 1e-6 * support) / FLATTEST)
    length *= radius / np.cbrt(length.prod(axis=1, keepdims=True))
    alone = count <= FEW
    length[alone] = LONE * radius
    middle = position + SMOOTHED * mean
    return middle, np.einsum("nik,nk,njk->nij", directions, length, directions)
