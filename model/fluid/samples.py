"""Samples of solids for a fluid: points of their bodies and surfaces, each with a volume and the particles that carry
it.

N. Akinci et al., "Versatile Rigid-Fluid Coupling for Incompressible SPH", SIGGRAPH 2012: a sample's volume is the one
that its neighbours among the samples leave. For the effect of samples see model/formulas/fluid/solids.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.geometry.lists import grouped, offsets_of
from softlab.model.particles.fluid_lattice import Lattice, poly6

CORNERS = 3  # particles that carry a sample, at most
CLOSE = 0.75  # rest distances between samples of a face, at most
LEAST = 0.55  # and those of one solid, at least: otherwise lists of neighbours would overflow


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of solids.

    `corners` (samples, 3) int32: the solids' particles that carry each; `weights` (samples, 3) float64: their weights,
    which sum to 1; `volume` (samples,) float64: in volumes of a fluid's particle; `lightness` (particles,) float64: for
    each of the solids' particles, the mass of a particle of the first fluid over its own, 0 where it cannot be moved.
    """

    corners: np.ndarray
    weights: np.ndarray
    volume: np.ndarray
    lightness: np.ndarray

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.volume)

    @property
    def mobility(self) -> np.ndarray:
        """Mobility of each sample, (samples,) float64: the sum of its particles' weights squared times their
        lightness."""
        return np.asarray((self.weights**2 * self.lightness[self.corners]).sum(axis=1))

    @cached_property
    def carriers(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (offsets (particles + 1,) int32, samples (n,) int32, weights (n,) float64): the samples that each
        particle carries, in their order."""
        there = self.weights != 0
        sample, corner = np.nonzero(there)
        particle = self.corners[sample, corner]
        order = np.lexsort((corner, sample, particle))
        counts = np.bincount(particle, minlength=len(self.lightness))
        return (
            offsets_of(counts).astype(np.int32),
            sample[order].astype(np.int32),
            self.weights[sample, corner][order],
        )

    def points(self, position: np.ndarray) -> np.ndarray:
        """Return the positions of the samples, (samples, 3) [m], for the solids' particles at `position` (particles,
        3)."""
        return np.asarray((self.weights[:, :, None] * position[self.corners]).sum(axis=1))


def particle_samples(particles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (corners, weights) of samples that are the particles themselves; `particles` (n,): their indices."""
    corners, weights = (
        np.repeat(particles[:, None], CORNERS, axis=1).astype(np.int32),
        np.zeros((len(particles), CORNERS)),
    )
    weights[:, 0] = 1
    return corners, weights


def triangle_samples(position: np.ndarray, triangles: np.ndarray, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (corners, weights) of samples of triangles (n, 3) int: their vertices, and points along their sides and
    inside.

    They are at most `apart` [m] from each other along a side. A point on several triangles occurs once.
    """
    samples: dict[tuple[tuple[int, ...], tuple[int, ...]], tuple[tuple[int, ...], tuple[float, ...]]] = {}
    sides = norm(position[triangles] - position[np.roll(triangles, 1, axis=1)]).max(axis=1)
    for corners, longest in zip(np.sort(triangles, axis=1), sides, strict=True):
        steps = max(1, int(np.ceil(longest / apart)))
        for i in range(steps + 1):
            for j in range(steps + 1 - i):
                counts = i, j, steps - i - j
                has = [(int(corner), count) for corner, count in zip(corners, counts, strict=True) if count]
                last = has[-1][0]
                carried = tuple(corner for corner, _ in has) + (last,) * (CORNERS - len(has))
                weights = tuple(count / steps for _, count in has) + (0.0,) * (CORNERS - len(has))
                samples.setdefault((carried, tuple(round(weight * 1e6) for weight in weights)), (carried, weights))
    unique = list(samples.values())
    return (
        np.array([one for one, _ in unique], np.int32).reshape(-1, CORNERS),
        np.array([one for _, one in unique], np.float64).reshape(-1, CORNERS),
    )


def thinned(points: np.ndarray, least: float) -> np.ndarray:
    """Return the indices (selected,) int64, ascending, of a subset of `points` (n, 3) that are at least `least` [m]
    apart."""
    pairs = cKDTree(points).query_pairs(least * (1 - 1e-9), output_type="ndarray")
    later = grouped(pairs.min(axis=1), pairs.max(axis=1), len(points))
    selected = np.ones(len(points), bool)
    for k in range(len(points)):
        if selected[k]:
            selected[later[k]] = False
    return np.flatnonzero(selected)


def sample_volumes(points: np.ndarray, lattice: Lattice, support: float, solid: bool) -> np.ndarray:
    """Return the volumes of one solid's samples at `points` (samples, 3) [m], (samples,) float64, in volumes of a
    fluid's particle.

    1 / sum of the kernel over the samples. In a `solid` body, filled with samples, those at the surface get the volume
    of interior ones: the smallest within the support.
    """
    pairs = cKDTree(points).query_pairs(support, output_type="ndarray")
    kernel = poly6(norm(points[pairs[:, 0]] - points[pairs[:, 1]]), support, points.shape[1])
    total = np.full(len(points), float(poly6(np.zeros(1), support, points.shape[1])[0]))
    for end in (0, 1):
        total += np.bincount(pairs[:, end], kernel, len(points))
    volume = 1 / total / lattice.volume
    if not solid:
        return np.asarray(volume)
    least = volume.copy()
    for one, other in ((0, 1), (1, 0)):
        np.minimum.at(least, pairs[:, one], volume[pairs[:, other]])
    return least


def joined_samples(
    solids: Sequence[tuple[np.ndarray, np.ndarray]], volumes: Sequence[np.ndarray], lightness: np.ndarray
) -> Samples:
    """Return the concatenated samples of several solids, from (corners, weights) and volume of each."""
    return Samples(
        np.concatenate([corners for corners, _ in solids]),
        np.concatenate([weights for _, weights in solids]),
        np.concatenate(volumes),
        np.asarray(lightness, np.float64),
    )
