"""Energy of clusters and distance of particles from their goals, on the host."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from softlab.model.assets.lattice import matching_axis
from softlab.model.core.stability.springs import matching_stiffness
from softlab.model.scene.scene import Scene


def window_energy(scene: Scene, position: np.ndarray) -> float:
    """Return the energy [J] of the clusters of a grid that is solved by shape matching.

    It is the `Clusters.energy` of `lattice_clusters` (model/shape_matching/matching.py), window by window without their
    many indices.
    """
    grid, n = scene.grid, scene.method.region
    down, across = matching_axis(grid.rows, n), matching_axis(grid.columns, n)
    rest = scene.springs.rest_length if scene.springs else grid.spacing
    here = np.asarray(position, dtype=np.float64).reshape(grid.rows, grid.columns, 2).transpose(2, 0, 1)
    placed = np.pad(here, ((0, 0), (n, n), (n, n)))
    weight = np.pad(grid.mass * down.weight[:, None] * across.weight, n)  # nothing outside has mass

    def members() -> Iterator[tuple[np.ndarray, ...]]:
        """Yield (mass, x and y from the window's middle, rest offset along x and y) of a member of every window."""
        for i, j in np.ndindex(2 * n + 1, 2 * n + 1):
            window = slice(i, i + grid.rows), slice(j, j + grid.columns)
            x, y = placed[:, *window] - here
            yield weight[window], x, y, (j - n - across.centre)[None, :] * rest, -(i - n - down.centre)[:, None] * rest

    centre_x, centre_y, along, across_sum = (np.zeros((grid.rows, grid.columns)) for _ in range(4))
    for mass, x, y, rest_x, rest_y in members():
        centre_x += mass * x
        centre_y += mass * y
        along += mass * (x * rest_x + y * rest_y)
        across_sum += mass * (y * rest_x - x * rest_y)
    inverse = down.inverse_mass[:, None] * across.inverse_mass / grid.mass
    centre_x, centre_y = centre_x * inverse, centre_y * inverse
    angle = np.arctan2(across_sum, along)
    cosine, sine = np.cos(angle), np.sin(angle)
    total = 0.0
    for mass, x, y, rest_x, rest_y in members():
        away_x = centre_x + cosine * rest_x - sine * rest_y - x
        away_y = centre_y + sine * rest_x + cosine * rest_y - y
        total += float(np.sum(mass * (away_x * away_x + away_y * away_y)))
    return 0.5 * matching_stiffness(scene) * total


def goal_strain(scene: Scene, position: np.ndarray, plastic: np.ndarray | None = None) -> np.ndarray:
    """Return the distance of each particle of `position` (particles, 3) [m] from its goal in each of its clusters,
    (entries,) float64.

    Relative to its body's particle spacing; `plastic` as in State. NaN where positions are not finite.
    """
    body_set, clusters = scene.body_set, scene.body_set.clusters
    p = np.asarray(position, dtype=np.float64)
    if not np.isfinite(p).all():
        return np.full(len(clusters.indices), np.nan)
    spacing = np.array([copy.baked.spacing for copy in body_set.copies])[body_set.body[clusters.indices]]
    return np.linalg.norm(clusters.goals(p, plastic) - p[clusters.indices], axis=1) / spacing
