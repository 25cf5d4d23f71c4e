"""Shape matching of a lattice: a cluster around every mass, and the tables that are the same along rows and columns.

The window of a mass holds those at most `region` rows and columns away that exist. All coefficients are 1, so that a mass has
an equal share in each of the windows it is in: 1 over their number, which is the size of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.clusters import Clusters
from model.energy import masses
from model.scene import Scene


@dataclass(frozen=True)
class Axis:
    """Of the rows (or columns) of a lattice, float64: `share` of a mass in each of its windows, 1 over their number along
    this axis; `inverse_mass` 1 over the `mass`, the sum of shares in the window; `centre` [spacings]: where the window's
    centre of mass lies, from its middle; `count` of the window's members."""

    share: np.ndarray
    inverse_mass: np.ndarray
    centre: np.ndarray
    mass: np.ndarray
    count: np.ndarray

    def table(self, real: type) -> np.ndarray:
        """(5, n) in the arithmetic `real`, in this order: what kernels get."""
        return np.stack([self.share, self.inverse_mass, self.centre, self.mass, self.count]).astype(real)


def matching_axis(count: int, region: int) -> Axis:
    """The tables of an axis of `count` masses.

    >>> matching_axis(3, 1).centre.round(3).tolist()
    [0.4, 0.0, -0.4]
    """
    place = np.arange(count)
    first, last = np.maximum(place - region, 0), np.minimum(place + region, count - 1)
    share = 1 / (last - first + 1)
    sums = np.concatenate([[0.0], np.cumsum(share)])
    turns = np.concatenate([[0.0], np.cumsum(share * place)])
    mass = sums[last + 1] - sums[first]
    return Axis(share, 1 / mass, (turns[last + 1] - turns[first]) / mass - place, mass, last - first + 1.0)


def matching_stiffness(scene: Scene) -> float:
    """The square of the clusters' angular frequency [1/s^2] that makes the lattice as stiff in a long, even stretch as its
    springs are.

    Stretched by e, a chain of springs stores k (e d)^2 / 2 a mass, a window w^2 m <r^2> e^2 / 2 for its one mass, where the
    mean square of the rest offsets along an axis is <r^2> = d^2 n (n + 1) / 3 for a half-width n: w^2 = 3 k / (n (n + 1) m).
    Windows that are cut off by the edge are softer.
    """
    springs, region = scene.springs, scene.method.region
    return 3 * springs.stiffness / (region * (region + 1) * scene.grid.mass) if springs else 0.0


def lattice_clusters(scene: Scene) -> Clusters:
    """The windows of a scene's grid in compressed form, row by row: what the tables stand for."""
    grid, region = scene.grid, scene.method.region
    row, column = np.divmod(np.arange(grid.particle_count), grid.columns)
    reach = np.arange(-region, region + 1)
    rows, columns = row[:, None, None] + reach[:, None], column[:, None, None] + reach
    inside = (rows >= 0) & (rows < grid.rows) & (columns >= 0) & (columns < grid.columns)
    members = (rows * grid.columns + columns)[inside]
    rest = scene.springs.rest_length if scene.springs else grid.spacing
    return Clusters(
        np.concatenate([[0], np.cumsum(inside.sum(axis=(1, 2)))]).astype(np.int32),
        members.astype(np.int32),
        np.ones(len(members)),
        np.full(grid.particle_count, matching_stiffness(scene)),
        np.broadcast_to(masses(scene), (grid.particle_count, 1))[:, 0].astype(np.float64),
        np.stack([column * rest, -row * rest], axis=1).astype(np.float64),
    )
