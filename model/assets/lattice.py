"""Windows of regular lattices: a cluster around every mass, and the tables that are the same along each axis.

The window of a mass contains the existing masses at most `region` places away along each axis. All coefficients are 1,
so that a mass has an equal weight in each of the windows that contain it: 1 over their number, which is the size of its
own. As windows are cut off by straight edges, weights, masses, rest offsets and numbers are products, or sums, of one
number for each axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.assets.clusters import Clusters, matching_factor
from softlab.model.base.types import Real
from softlab.model.geometry.lists import Lists, offsets_of

TABLE = 5  # rows of an axis's table
T_WEIGHT, T_INVERSE, T_CENTRE, T_MASS, T_COUNT = range(TABLE)


@dataclass(frozen=True)
class Axis:
    """Values along an axis of a lattice, float64.

    `weight`: weight of a mass in each of its windows, 1 over their number along this axis; `inverse_mass`: 1 over the
    `mass`, the sum of weights in the window; `centre` [spacings]: centre of mass of the window, relative to its middle;
    `count`: of the window's members.
    """

    weight: np.ndarray
    inverse_mass: np.ndarray
    centre: np.ndarray
    mass: np.ndarray
    count: np.ndarray

    def table(self, real: Real) -> np.ndarray:
        """Return the kernels' table, (TABLE, n) in the arithmetic `real`, in the order of the T_ constants."""
        return np.stack([self.weight, self.inverse_mass, self.centre, self.mass, self.count]).astype(real)


def matching_axis(count: int, region: int) -> Axis:
    """Return the tables of an axis of `count` masses.

    >>> matching_axis(3, 1).centre.round(3).tolist()
    [0.4, 0.0, -0.4]
    """
    place = np.arange(count)
    first, last = np.maximum(place - region, 0), np.minimum(place + region, count - 1)
    weight = 1 / (last - first + 1)
    sums = np.concatenate([[0.0], np.cumsum(weight)])
    turns = np.concatenate([[0.0], np.cumsum(weight * place)])
    mass = sums[last + 1] - sums[first]
    return Axis(weight, 1 / mass, (turns[last + 1] - turns[first]) / mass - place, mass, last - first + 1.0)


def windows(counts: Sequence[int], region: int) -> Lists:
    """Return the members, ascending, of the window around each mass of a lattice of `counts` masses along its axes.

    Masses are numbered along the last axis first.
    """
    at, inside = np.zeros((1, 1), np.int64), np.ones((1, 1), bool)
    for count in counts:
        side = min(region, count - 1)
        place = np.arange(count)[:, None] + np.arange(-side, side + 1)
        there = (place >= 0) & (place < count)
        at = (at[:, None, :, None] * count + place[:, None, :]).reshape(len(at) * count, -1)
        inside = (inside[:, None, :, None] & there[:, None, :]).reshape(at.shape)
    return Lists(offsets_of(inside.sum(axis=1)), at[inside].astype(np.int32))


@dataclass(frozen=True)
class Lattice:
    """A block of `counts` equal masses along x, y and z, `spacing` [m] apart at rest, with windows of the half-width
    `region`.

    Masses and their windows are numbered x first, then y, then z.
    """

    counts: tuple[int, int, int]
    region: int
    spacing: float

    @property
    def size(self) -> int:
        """Number of masses, and of windows."""
        return self.counts[0] * self.counts[1] * self.counts[2]

    @property
    def axes(self) -> tuple[Axis, Axis, Axis]:
        """Tables along x, y and z."""
        x, y, z = (matching_axis(count, self.region) for count in self.counts)
        return x, y, z

    def positions(self) -> np.ndarray:
        """Return the positions, (size, 3) float64 [m], with the block's centre at the origin."""
        x, y, z = (self.spacing * (np.arange(count) - 0.5 * (count - 1)) for count in self.counts)
        grid = np.meshgrid(z, y, x, indexing="ij")
        return np.stack([grid[2].ravel(), grid[1].ravel(), grid[0].ravel()], axis=1)

    def clusters(self, position: np.ndarray, mass: np.ndarray, stiffness: float) -> Clusters:
        """Return the windows in compressed form, as represented by the tables, for direct summation."""
        members = windows(self.counts[::-1], self.region)
        coefficients, stiffnesses = np.ones(len(members.indices)), np.full(self.size, float(stiffness))
        return Clusters(members.offsets, members.indices, coefficients, stiffnesses, mass, position)


V_SPACING, V_MATCHING, V_TURN = range(3)  # indices of a lattice kernel's values besides tables
VALUES = V_TURN + 9


@dataclass(frozen=True, eq=False)
class LatticeCopies:
    """Consecutive copies of a lattice: first particle and first cluster of the first copy, number of copies,
    `stiffness` of all clusters [1/s^2], and the initial rotation (3, 3) `turn`, to which the clusters' rotations are
    relative.
    """

    lattice: Lattice
    first_particle: int
    first_cluster: int
    copies: int
    stiffness: float
    turn: np.ndarray

    def values(self, substep: float, iterations: int) -> np.ndarray:
        """Return the kernels' values, (VALUES,) float64.

        The spacing [m], the fraction of the displacement to their goals by which masses move in one of `iterations` of
        a substep [s], the rotation by rows.
        """
        factor = matching_factor(self.stiffness, substep, iterations)
        return np.array([self.lattice.spacing, factor, *self.turn.ravel()])
