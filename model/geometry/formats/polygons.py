"""Polygons cut into triangles in their best-fit plane: fans of convex ones, ear clipping of the others."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot, norm

FLAT = 2.0**-20  # height over longest side of a triangle without an area: what float32, as in STL, cannot tell from 0
FANNED = 6  # corners: larger polygons are cut into better triangles than those of a fan, which all meet at one vertex
LEVEL = 1e-12  # of the squared extent: a polygon with a smaller area vector has no plane
MOST_PAIRS = 1 << 22  # pairs of edges that are checked for a crossing at once


def triangulated(position: np.ndarray, corners: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into triangles that cover them once, whatever their first corner.

    Each polygon is projected on the plane of its area vector (M. Newell: half the sum of the cross products of successive
    corners). Where it has at most FANNED corners and a fan from the first one covers it, it becomes that fan; a quadrilateral
    else becomes the other fan; any other polygon is cut by ear clipping (G. H. Meisters, "Polygons have ears", Amer. Math.
    Monthly 82 (1975); O(n^2)), the ear with the shortest diagonal first, so that no vertex gets many edges.

    Parameters
    ----------
    position : (vertices, 3) float array, finite
    corners : (sum of sizes,) int array
    sizes : (faces,) int array, 3 or more each

    Returns
    -------
    triangles : (sum of sizes - 2, 3) int64, polygon by polygon
    crossing : (n,) int64, faces that cross themselves, which have no area of their own: fans from their first corner
    """
    begins = np.cumsum(sizes) - sizes
    first = np.cumsum(sizes - 2) - (sizes - 2)
    triangles = np.empty((int((sizes - 2).sum()), 3), dtype=np.int64)
    crossing: list[int] = []
    for size in np.unique(sizes).tolist():
        number = np.flatnonzero(sizes == size)
        polygon = corners[begins[number][:, None] + np.arange(size)]
        rows = first[number][:, None] + np.arange(size - 2)
        triangles[rows] = polygon[:, _fan(size)]
        if size == 3:
            continue
        flat, has_plane = _projected(position[polygon])
        rest = has_plane.copy() if size > FANNED else has_plane & ~_covers(flat, _fan(size))
        if size == 4:
            other = rest & _covers(flat, _fan(4, 1))
            triangles[rows[other]] = polygon[other][:, _fan(4, 1)]
            rest &= ~other
        for k in np.flatnonzero(rest | (~has_plane & ~on_a_line(position[polygon]))).tolist():
            cut = ears(flat[k]) if has_plane[k] else None
            if cut is None:
                crossing.append(int(number[k]))
            else:
                triangles[rows[k]] = polygon[k][cut]
    return triangles, np.sort(np.array(crossing, dtype=np.int64))


def _fan(size: int, start: int = 0) -> np.ndarray:
    """Return the fan of a polygon from its corner `start`: (size - 2, 3)."""
    k = np.arange(size - 2)
    return np.stack([np.full(size - 2, start), (start + k + 1) % size, (start + k + 2) % size], axis=1)


def _projected(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, k, 2), polygons (n, k, 3) in their planes, counter-clockwise and of extent 1; (n,) bool: which have one."""
    local = points - points[:, :1]
    extent = np.abs(local).max(axis=(1, 2), keepdims=True)
    local = np.divide(local, extent, out=np.zeros_like(local), where=extent > 0)
    following = np.roll(local, -1, axis=1)
    normal = np.cross(local, following).sum(axis=1) / 2
    length = norm(normal)
    has_plane = length > LEVEL
    normal = np.where(has_plane[:, None], normal, [0.0, 0.0, 1.0]) / np.where(has_plane, length, 1.0)[:, None]
    least = np.abs(normal).argmin(axis=1)
    u = np.cross(normal, np.eye(3)[least])
    u /= norm(u)[:, None]
    v = np.cross(normal, u)
    return np.stack([dot(local, u[:, None]), dot(local, v[:, None])], axis=-1), has_plane


def on_a_line(points: np.ndarray) -> np.ndarray:
    """Return (n,) bool: True for polygons (n, k, 3) whose corners lie on one line, or at one point."""
    local = points - points[:, :1]
    far = np.take_along_axis(local, norm(local).argmax(axis=1)[:, None, None], axis=1)
    length = norm(far)[:, 0]
    off = norm(np.cross(local, far)).max(axis=1)
    return np.asarray(off <= FLAT * length**2)


def _turns(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return twice the signed areas of triangles (..., 2)."""
    one, two = b - a, c - a
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def _shape(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return twice the signed areas of triangles (..., 2) over their longest sides squared."""
    longest = np.maximum(np.maximum(_squares(b - a), _squares(c - b)), _squares(a - c))
    return np.divide(_turns(a, b, c), longest, out=np.zeros(np.shape(longest)), where=longest > 0)


def _squares(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)


def _covers(flat: np.ndarray, fan: np.ndarray) -> np.ndarray:
    """Return (n,) bool: True if a fan covers the polygon (n, k, 2) once: its triangles have areas and all turn left,
    and their angles at the fan's corner add up to less than 360 degrees."""
    a, b, c = (flat[:, fan[:, k]] for k in range(3))
    left = np.asarray((_shape(a, b, c) > FLAT).all(axis=1))
    apex, first, last = flat[:, fan[0, 0]], flat[:, fan[0, 1]], flat[:, fan[-1, 2]]
    if len(fan) > 2:  # two angles under half a turn each are less than a whole one
        one, two = b - a, c - a
        angles = np.arctan2(_turns(a, b, c), one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1])
        left &= (angles.sum(axis=1) < np.pi) & (_turns(apex, first, last) > 0)
    return left


def ears(flat: np.ndarray) -> np.ndarray | None:
    """Return the triangles (k - 2, 3) of a polygon (k, 2), counter-clockwise, by ear clipping; None if it crosses itself."""
    if _crosses(flat):
        return None
    left, triangles = list(range(len(flat))), []
    while len(left) > 3:
        ring = flat[left]
        before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
        quality = _shape(before, ring, after)
        order = np.lexsort((_squares(after - before), quality <= FLAT))  # flat ones last
        ear = next((k for k in order.tolist() if _is_ear(ring, k, quality[k])), None)
        if ear is None:
            return None
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    triangles.append((left[0], left[1], left[2]))
    if _turns(*flat[left]) < -FLAT:
        return None
    return np.array(triangles)


def _is_ear(ring: np.ndarray, k: int, quality: float) -> bool:
    """Return whether the corner k of `ring` (n, 2) can be cut off: convex, or flat, and no other corner in its triangle."""
    if quality < -FLAT:
        return False
    a, b, c = ring[k - 1], ring[k], ring[(k + 1) % len(ring)]
    inside = (_turns(a, b, ring) >= 0) & (_turns(b, c, ring) >= 0) & (_turns(c, a, ring) >= 0)
    for corner in (a, b, c):
        inside &= (ring != corner).any(axis=1)
    return not inside.any()


def _crosses(flat: np.ndarray) -> bool:
    """Return whether two edges of a polygon (k, 2) cross, each other's ends strictly on either side."""
    start, end = flat, np.roll(flat, -1, axis=0)
    step = max(1, MOST_PAIRS // len(flat))
    for begin in range(0, len(flat), step):
        a, b = start[begin : begin + step, None], end[begin : begin + step, None]
        apart = _turns(a, b, start[None]) * _turns(a, b, end[None]) < 0
        if (apart & (_turns(start[None], end[None], a) * _turns(start[None], end[None], b) < 0)).any():
            return True
    return False
