"""Shape matching of a grid: a cluster around every mass, of the existing masses at most `region` rows and columns away.

See model/assets/lattice.py for the tables of its rows and columns.
"""

from __future__ import annotations

import numpy as np

from softlab.model.assets.clusters import Clusters
from softlab.model.assets.lattice import windows
from softlab.model.core.build import masses
from softlab.model.core.stability.springs import matching_stiffness
from softlab.model.scene.scene import Scene


def lattice_clusters(scene: Scene) -> Clusters:
    """Return the windows of a scene's grid in compressed form, row by row, as represented by the tables."""
    grid, region = scene.grid, scene.method.region
    row, column = np.divmod(np.arange(grid.particle_count), grid.columns)
    members = windows((grid.rows, grid.columns), region)
    rest = scene.springs.rest_length if scene.springs else grid.spacing
    return Clusters(
        members.offsets,
        members.indices,
        np.ones(len(members.indices)),
        np.full(grid.particle_count, matching_stiffness(scene)),
        np.broadcast_to(masses(scene), (grid.particle_count, 1))[:, 0].astype(np.float64),
        np.stack([column * rest, -row * rest], axis=1).astype(np.float64),
    )
