"""Volume, centre and second moments of the inside of a surface, of points with weights, and of tetrahedra."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import combined, determinant, dot, mean, total

ONES = np.ones(4)
Moments = tuple[float, np.ndarray, np.ndarray]  # volume, centre (3,), second moments about the axes through it (3,)


def surface_moments(position: np.ndarray, triangles: np.ndarray) -> Moments:
    """Moments of the inside of a closed surface, `position` (vertices, 3) [m], `triangles` (n, 3): [m^3], [m], [m^5].

    The exact sums over the tetrahedra between each triangle and one point (D. Eberly, "Polyhedral Mass Properties", 2002).
    """
    middle = mean(position)
    corners = np.concatenate([np.zeros((len(triangles), 1, 3)), position[triangles] - middle], axis=1)
    volume, centre, second = tetrahedra_moments(corners, determinant(corners[:, 1:]) / 6)
    return volume, centre + middle, second


def tetrahedra_moments(corners: np.ndarray, weights: np.ndarray) -> Moments:
    """Moments of tetrahedra with such `corners` (n, 4, 3) [m], each evenly filled with its weight (n,)."""
    volume, sums = float(total(weights)), combined(ONES, corners)
    centre = total(weights[:, None] * sums) / (4 * volume)
    local = corners - centre
    squares = dot(np.moveaxis(local, 1, 2), np.moveaxis(local, 1, 2)) + combined(ONES, local) ** 2
    return volume, centre, _about_axes(total(weights[:, None] * squares) / 20)


def point_moments(position: np.ndarray, weights: np.ndarray) -> Moments:
    """Moments of points at `position` (n, 3) [m] with `weights` (n,)."""
    volume = float(total(weights))
    centre = total(weights[:, None] * position) / volume
    return volume, centre, _about_axes(total(weights[:, None] * (position - centre) ** 2))


def _about_axes(squares: np.ndarray) -> np.ndarray:
    """Return (3,): of the sums of x^2, y^2, z^2 those of y^2 + z^2, z^2 + x^2, x^2 + y^2."""
    about: np.ndarray = squares[[1, 2, 0]] + squares[[2, 0, 1]]
    return about
