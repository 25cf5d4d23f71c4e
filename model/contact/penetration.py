"""Quality of a cloth's self-contacts in a state: the smallest gaps, and penetrations that mass-triangle contacts miss.

Not part of a step. float64 on the host, from positions alone: `measure(rows, columns, spacing, position, thickness)`.
Edges against edges: C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9; edges through triangles: T.
Moeller and B. Trumbore, "Fast, minimum storage ray/triangle intersection", Journal of Graphics Tools 2 (1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.measures import nearest_weights
from softlab.model.geometry.neighbours import SLACK
from softlab.model.geometry.sheets import cell_corners, split_cells

NEAR = 0.8  # of the thickness: nearer pairs of edges count as missed
BATCH = 1 << 20  # pairs per batch


@dataclass(frozen=True)
class ContactMeasure:
    """Gaps and crossings of pairs without a common mass that are at least the thickness apart in the flat sheet.

    `min_gap` [m]: of a mass and a triangle; `min_edge_gap` [m]: of two edges; both `inf` if there are no such pairs
    within the thickness. `edge_misses`: pairs of edges nearer than NEAR thicknesses. `crossings`: edges through a
    triangle without a common mass, at any distance in the sheet: 0 for a cloth that does not pass through itself.
    """

    min_gap: float
    min_edge_gap: float
    edge_misses: int
    crossings: int


def _cell_pairs(low: np.ndarray, high: np.ndarray, distance: float) -> np.ndarray:
    """Return pairs (n, 2) of cells of the sheet, first <= second, whose boxes (cells, 3) come within `distance` [m] of
    each other."""
    from scipy.spatial import cKDTree

    size = float((high - low).max(initial=0.0)) + distance
    pairs = cKDTree((low + high) / 2).query_pairs(size * SLACK, p=np.inf, output_type="ndarray")
    each = np.arange(len(low))
    cell, other = np.concatenate([np.stack([each, each], axis=1), pairs]).T
    near = (low[cell] < high[other] + distance).all(axis=1) & (low[other] < high[cell] + distance).all(axis=1)
    return np.stack([cell[near], other[near]], axis=1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("nk,nk->n", a, b)


def _edge_weights(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (s, t), (n,) in [0, 1]: the weights of the nearest points of segments p and q (n, 2, 3)."""
    d, e, r = p[:, 1] - p[:, 0], q[:, 1] - q[:, 0], p[:, 0] - q[:, 0]
    dd, ee, de, dr, er = _dot(d, d), _dot(e, e), _dot(d, e), _dot(d, r), _dot(e, r)
    one = np.ones_like(dd)
    full = dd * ee - de * de
    s = np.clip(np.divide(de * er - dr * ee, full, out=np.zeros_like(dd), where=full > 1e-14 * dd * ee), 0, 1)
    t = np.clip((de * s + er) / np.where(ee > 0, ee, one), 0, 1)
    return np.clip((de * t - dr) / np.where(dd > 0, dd, one), 0, 1), t


def _through(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return which segments p (n, 2, 3) pass through triangles q (n, 3, 3), (n,) bool; touching does not count."""
    segment, u, v = p[:, 1] - p[:, 0], q[:, 1] - q[:, 0], q[:, 2] - q[:, 0]
    h = np.cross(segment, v)
    volume = _dot(u, h)
    r = p[:, 0] - q[:, 0]
    k = np.cross(r, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        b, c, part = _dot(r, h) / volume, _dot(segment, k) / volume, _dot(v, k) / volume
        inside = b + c < 1
    return (volume != 0) & inside & (b > 0) & (c > 0) & (part > 0) & (part < 1)


class _Sheet:
    """The masses, edges and triangles of each cell of a sheet."""

    def __init__(self, rows: int, columns: int, spacing: float, position: np.ndarray):
        number = np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = (part.ravel() for part in cell_corners(number))
        self.corners = np.stack([a, b, c, d], axis=1)
        self.triangles = split_cells(number).reshape(-1, 2, 3)
        # all five edges of a cell: some belong to two cells, so that pairs are made unique afterwards
        self.edges = np.stack([np.stack(pair, axis=1) for pair in ((a, b), (a, c), (a, d), (c, d), (b, d))], axis=1)
        self.position = np.asarray(position, np.float64)
        self.flat = np.stack(np.divmod(np.arange(rows * columns), columns), axis=1) * spacing

    def gaps(
        self, first: np.ndarray, second: np.ndarray, s: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (current distance, distance in the flat sheet) [m] of points.

        The first points have the weights s (n, k) of masses `first` (n, k), the second ones t of `second`.
        """
        both = []
        for points in (self.position, self.flat):
            away = np.einsum("nk,nkd->nd", s, points[first]) - np.einsum("nk,nkd->nd", t, points[second])
            both.append(np.sqrt(_dot(away, away)))
        return both[0], both[1]


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return which pairs have no mass in common, (n,) bool."""
    return (first[:, :, None] != second[:, None, :]).all(axis=(1, 2))


def _pairs(cells: np.ndarray, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of a feature of one cell and a feature of the other, in both directions, each once, without
    pairs with a common mass: (n, k), (n, l) masses."""
    both = np.concatenate([cells, cells[cells[:, 0] != cells[:, 1]][:, ::-1]])
    left = np.repeat(first[both[:, 0]], second.shape[1], axis=1).reshape(-1, first.shape[2])
    right = np.tile(second[both[:, 1]], (1, first.shape[1], 1)).reshape(-1, second.shape[2])
    apart = _apart(left, right)
    return left[apart], right[apart]


def measure(rows: int, columns: int, spacing: float, position: np.ndarray, thickness: float) -> ContactMeasure:
    """Return the ContactMeasure of a state.

    `position`: (particles, 3) [m] in builder order; `thickness` [m]: of the scene's self_collision.
    """
    if min(rows, columns) < 2 or not np.isfinite(position).all():
        return ContactMeasure(np.inf, np.inf, 0, 0)
    sheet = _Sheet(rows, columns, spacing, position)
    where = sheet.position[sheet.corners]
    cells = _cell_pairs(where.min(axis=1), where.max(axis=1), thickness)
    gap = edge_gap = np.inf
    missed: list[np.ndarray] = []
    crossed: list[np.ndarray] = []
    for begin in range(0, len(cells), BATCH // 50):  # 25 pairs of edges, in both directions
        some = cells[begin : begin + BATCH // 50]
        mass, triangle = _pairs(some, sheet.corners[:, :, None], sheet.triangles)
        weights = nearest_weights(sheet.position[mass[:, 0]], sheet.position[triangle])
        now, flat = sheet.gaps(mass, triangle, np.ones((len(mass), 1)), weights)
        gap = min(gap, float(now[(flat >= thickness) & (now < thickness)].min(initial=np.inf)))
        edge, triangle = _pairs(some, sheet.edges, sheet.triangles)
        through = _through(sheet.position[edge], sheet.position[triangle])
        crossed.append(np.concatenate([edge[through], triangle[through]], axis=1))
        edge, other = _pairs(some, sheet.edges, sheet.edges)
        s, t = _edge_weights(sheet.position[edge], sheet.position[other])
        now, flat = sheet.gaps(edge, other, np.stack([1 - s, s], axis=1), np.stack([1 - t, t], axis=1))
        near = (flat >= thickness) & (now < thickness)
        edge_gap = min(edge_gap, float(now[near].min(initial=np.inf)))
        near &= now < NEAR * thickness
        numbers = [ends[near, 0] * rows * columns + ends[near, 1] for ends in (edge, other)]
        missed.append(np.sort(np.stack(numbers, axis=1), axis=1))
    return ContactMeasure(
        gap, edge_gap, len(np.unique(np.concatenate(missed), axis=0)), len(np.unique(np.concatenate(crossed), axis=0))
    )
