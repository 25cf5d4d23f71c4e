"""Lengths, areas and unit vectors between points."""

from __future__ import annotations

from collections.abc import Sequence
from math import fmod

import numpy as np

from softlab.model.geometry.arithmetic.functions import sine_and_cosine
from softlab.model.geometry.arithmetic.ordered import combined, dot, norm, product


def edge_lengths(position: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return (edges,) float64 [m]: between the two points of `position` (points, 3) [m] that each row of `ends` (edges,
    2) names."""
    return norm(position[ends[:, 1]] - position[ends[:, 0]])


def triangle_areas(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (triangles,) float64 [m^2]: of `triangles` (n, 3) between points of `position` (points, 3) [m]."""
    a, b, c = (position[corner] for corner in triangles.T)
    return norm(np.cross(b - a, c - a)) / 2


def unit(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (..., 3) made 1 long; 0 where they are 0."""
    length = norm(vectors)[..., None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def rotation_matrix(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return (3, 3) float64: the rotation about `axis` (3,), 1 long, by `angle` [rad], by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = sine_and_cosine(float(angle))
    matrix: np.ndarray = np.eye(3) + s * cross + (1 - c) * product(cross, cross)
    return matrix


def rotation_about(axis: Sequence[float], degrees: float) -> np.ndarray:
    """Return (3, 3) float64: the rotation about an `axis` of any length; the identity for a zero axis."""
    along = np.asarray(axis, dtype=np.float64)
    return rotation_matrix(along / (float(norm(along)) or 1.0), np.radians(fmod(degrees, 360.0)))


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return dot(a, b)


def nearest_weights(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (n, 3) barycentric weights of the point of triangles q (n, 3, 3) nearest to points p (n, 3)."""
    u, v, r = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0], p - q[:, 0]
    uu, uv, vv, ru, rv = _dots(u, u), _dots(u, v), _dots(v, v), _dots(r, u), _dots(r, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        b, c = (vv * ru - uv * rv) / (uu * vv - uv * uv), (uu * rv - uv * ru) / (uu * vv - uv * uv)
    inside = (b >= 0) & (c >= 0) & (b + c <= 1)
    best = np.where(inside[:, None], np.stack([1 - b - c, b, c], axis=1), 0.0)
    least = np.where(inside, -1.0, np.inf)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        side = q[:, j] - q[:, i]
        square = _dots(side, side)
        part = np.clip(_dots(p - q[:, i], side) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        off = p - q[:, i] - part[:, None] * side
        weights = np.zeros_like(best)
        weights[:, i], weights[:, j] = 1 - part, part
        nearer = _dots(off, off) < least
        best[nearer], least = weights[nearer], np.where(nearer, _dots(off, off), least)
    return best


def nearest_of(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nearest of the triangles `corners` (m, 3, 3) to each of `points` (n, 3), by testing every pair.

    Returns (number (points,), the first of equally near ones; weights (points, 3) of its nearest point; distance (points,)
    [m]).
    """
    number, weights, away = np.zeros(len(points), np.int64), np.zeros((len(points), 3)), np.zeros(len(points))
    for place, point in enumerate(points):
        nearest_on_each = nearest_weights(np.broadcast_to(point, (len(corners), 3)), corners)
        off = norm(combined(nearest_on_each, corners) - point)
        number[place] = off.argmin()
        weights[place], away[place] = nearest_on_each[number[place]], off[number[place]]
    return number, weights, away
