"""Lengths, areas and directions of what lies between points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def edge_lengths(position: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(edges,) float64 [m]: between the two points of `position` (points, 3) [m] that each row of `ends` (edges, 2) names."""
    return np.linalg.norm(position[ends[:, 1]] - position[ends[:, 0]], axis=1)


def triangle_areas(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(triangles,) float64 [m^2]: of `triangles` (n, 3) between points of `position` (points, 3) [m]."""
    a, b, c = (position[corner] for corner in triangles.T)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def unit(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (..., 3) made 1 long; 0 where they are 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def rotation_matrix(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) float64: the rotation about `axis` (3,), 1 long, by `angle` [rad], by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def turned_about(axis: Sequence[float], degrees: float) -> np.ndarray:
    """(3, 3) float64: the rotation about an `axis` of any length; by 0 degrees where it has none."""
    along = np.asarray(axis, dtype=np.float64)
    return rotation_matrix(along / (float(np.linalg.norm(along)) or 1.0), np.radians(degrees))
