"""Shape matching of a grid: a cluster around every mass, of the existing masses at most `region` rows and columns away.

See model/shape_matching/lattice.py for the tables of its rows and columns.
"""

from __future__ import annotations

import numpy as np

from softlab.model.core.build import masses
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.clusters import Clusters
from softlab.model.shape_matching.lattice import windows


def matching_stiffness(scene: Scene) -> float:
    """Return the square of the clusters' angular frequency [1/s^2] that makes the lattice as stiff in a uniform stretch
    as its springs are.

    Stretched by e, a chain of springs stores k (e d)^2 / 2 per mass, a window w^2 m <r^2> e^2 / 2 for its one mass,
    where the mean square of the rest offsets along an axis is <r^2> = d^2 n (n + 1) / 3 for a half-width n: w^2 = 3 k /
    (n (n + 1) m). Windows that are cut off by the edge are softer.
    """
    springs, region = scene.springs, scene.method.region
    return 3 * springs.stiffness / (region * (region + 1) * scene.grid.mass) if springs else 0.0


def lattice_clusters(scene: Scene) -> Clusters:
    """Return the windows of a scene's grid in compressed form, row by row, as represented by the tables."""
    grid, region = scene.grid, scene.method.region
    row, column = np.divmod(np.arange(grid.particle_count), grid.columns)
    found = windows((grid.rows, grid.columns), region)
    rest = scene.springs.rest_length if scene.springs else grid.spacing
    return Clusters(
        found.offsets,
        found.indices,
        np.ones(len(found.indices)),
        np.full(grid.particle_count, matching_stiffness(scene)),
        np.broadcast_to(masses(scene), (grid.particle_count, 1))[:, 0].astype(np.float64),
        np.stack([column * rest, -row * rest], axis=1).astype(np.float64),
    )
