"""Fields whose zero is a surface: tubes, polygons and strokes in a plane, cut from a plate, blended; and letters of strokes.

Distances [m], under 0 inside, exact but for unions and blends: I. Quilez, "Distance functions" (2008 on), and for blends his
"Smooth minimum" (quadratic).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

import numpy as np

from softlab.model.geometry.arithmetic.functions import cosine, sine
from softlab.model.geometry.surfaces.surface_nets import Field


def _segments(points: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (distance, place along in [0, 1]) (n, segments) of `points` (n, d) from the segments between `nodes` (k,
    d)."""
    start, span = nodes[:-1], np.diff(nodes, axis=0).T
    away = [points[:, axis, None] - start[:, axis] for axis in range(len(span))]
    along = np.clip(_dot(away, span) / _dot(span, span), 0, 1)
    left = [(one - along * step) ** 2 for one, step in zip(away, span, strict=True)]
    return np.sqrt(sum(left[1:], start=left[0])), along


def _dot(a: Iterable[np.ndarray], b: Iterable[np.ndarray]) -> np.ndarray:
    """Return sums of products over axes in the order x + z + y, which `einsum` uses on a processor with AVX-512, so
    that bodies have the same bits on all processors."""
    x, y, *z = (one * other for one, other in zip(a, b, strict=True))
    return sum(z, start=x) + y


def tube(nodes: Sequence[tuple[float, ...]] | np.ndarray, radii: Sequence[float] | np.ndarray) -> Field:
    """A round tube through `nodes` (k, 3) [m], whose radius [m] changes evenly from node to node."""
    line, radius = np.asarray(nodes, dtype=float), np.asarray(radii, dtype=float)

    def field(points: np.ndarray) -> np.ndarray:
        distance, along = _segments(points, line)
        return (distance - radius[:-1] - along * np.diff(radius)).min(axis=1)

    return field


def outline(nodes: np.ndarray, radius: float) -> Field:
    """A stroke of a pen with a round tip through `nodes` (k, 2) [m]."""

    def field(points: np.ndarray) -> np.ndarray:
        return _segments(points[:, :2], nodes)[0].min(axis=1) - radius

    return field


def polygon(corners: np.ndarray, radius: float) -> Field:
    """Return the field of a closed polygon of `corners` (k, 2) [m], grown by `radius` [m]."""
    closed = np.concatenate([corners, corners[:1]])
    (ax, ay), (bx, by) = closed[:-1].T, closed[1:].T

    def field(points: np.ndarray) -> np.ndarray:
        x, y = points[:, :1], points[:, 1:2]
        passed = (ay <= y) != (by <= y)
        with np.errstate(divide="ignore", invalid="ignore"):
            right = passed & (x < ax + (y - ay) / (by - ay) * (bx - ax))
        distance = _segments(points[:, :2], closed)[0].min(axis=1)
        return np.where(right.sum(axis=1) % 2 == 1, -distance, distance) - radius

    return field


def extruded(flat: Field, depth: float, edge: float) -> Field:
    """Return the field of the part of a plate of `depth` [m] about z = 0 inside `flat`, its edges rounded with radius
    `edge` [m]."""

    def field(points: np.ndarray) -> np.ndarray:
        across, away = flat(points) + edge, np.abs(points[:, 2]) - depth / 2 + edge
        return (
            np.minimum(np.maximum(across, away), 0)
            + np.sqrt(np.maximum(across, 0) ** 2 + np.maximum(away, 0) ** 2)
            - edge
        )

    return field


def union(fields: Sequence[Field]) -> Field:
    """Return the distance field of the union of the strokes."""

    def field(points: np.ndarray) -> np.ndarray:
        return np.min([one(points) for one in fields], axis=0)

    return field


def blended(fields: Sequence[Field], width: float) -> Field:
    """Their union with hollows filled where two surfaces are about `width` [m] apart."""

    def field(points: np.ndarray) -> np.ndarray:
        total = fields[0](points)
        for one in fields[1:]:
            other = one(points)
            near = np.maximum(width - np.abs(total - other), 0)
            total = np.minimum(total, other) - near * near / (4 * width)
        return total

    return field


def _arc(x: float, y: float, wide: float, high: float, first: float, last: float) -> np.ndarray:
    """Return (k, 2): of an ellipse with half axes `wide` and `high` about (x, y), from one angle to another [degrees]."""
    angle = np.radians(np.linspace(first, last, max(2, round(abs(last - first) / 12) + 1)))
    return np.stack([x + wide * cosine(angle), y + high * sine(angle)], axis=1)


@cache
def letters() -> dict[str, list[np.ndarray]]:
    """Return the middle lines of letters: strokes (k, 2) [m], from -0.39 to 0.39 along y, so that a stroke 0.22 wide
    ends at 1 m."""
    top, low = 0.39, -0.39
    glyphs: dict[str, list[Sequence[tuple[float, float]] | np.ndarray]] = {
        "A": [[(-0.36, low), (0, top), (0.36, low)], [(-0.26, -0.18), (0.26, -0.18)]],
        "B": [
            [(-0.22, low), (-0.22, top), (0.03, top)],
            _arc(0.03, 0.2, 0.19, 0.19, 90, -90),
            [(-0.22, 0.01), (0.03, 0.01)],
            _arc(0.03, -0.19, 0.2, 0.2, 90, -90),
            [(-0.22, low), (0.03, low)],
        ],
        "E": [[(0.22, top), (-0.22, top), (-0.22, low), (0.22, low)], [(-0.22, 0), (0.14, 0)]],
        "F": [[(0.22, top), (-0.22, top), (-0.22, low)], [(-0.22, 0), (0.14, 0)]],
        "J": [np.concatenate([[(0.2, top)], _arc(0, -0.19, 0.2, 0.2, 0, -180)])],
        "L": [[(-0.2, top), (-0.2, low), (0.22, low)]],
        "O": [_arc(0, 0, 0.32, 0.39, 90, 450)],
        "S": [np.concatenate([_arc(0, 0.19, 0.24, 0.2, 20, 270), _arc(0, -0.19, 0.24, 0.2, 90, -160)])],
        "T": [[(-0.3, top), (0.3, top)], [(0, top), (0, low)]],
        "Y": [[(-0.28, top), (0, 0.02), (0.28, top)], [(0, 0.02), (0, low)]],
    }
    return {name: [np.asarray(stroke, dtype=float) for stroke in strokes] for name, strokes in glyphs.items()}
