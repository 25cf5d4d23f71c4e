"""Parts of a surface in a voxel that no line of probes hits, connected with the parts that they see through the inside
of the body.

A straight way from one point of the inside to another, within a voxel, that no triangle of that voxel crosses: so the two
belong to one piece.
"""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot
from softlab.model.geometry.lists import ranges

NEAREST = 8  # of what lies in the voxel, that a part looks at
MOST = 1 << 24  # triangles looked through at most, or a part stays alone: seconds
BATCH = 1 << 18
TOUCHING = 1e-9  # of a triangle's size: a way so near to its rim is crossed by it


def in_sight(
    place: np.ndarray,
    triangles: np.ndarray,
    low: np.ndarray,
    pairs: tuple[np.ndarray, np.ndarray],
    lonely: tuple[np.ndarray, np.ndarray],
    seen: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> np.ndarray:
    """Return (n, 2): pairs of `lonely`, and the nodes that they see.

    `pairs`: (triangle, voxel) (pairs,); `low` (voxels, 3): the corner that each voxel begins at; `lonely`: (pair (m,), the
    part that it is of (m,)), by voxel, of parts of which nothing is known; `seen`: (voxel (k,), point (k, 3), node (k,)) of
    stretches of the inside.
    """
    (triangle, voxel), (alone, part) = pairs, lonely
    none = np.zeros((0, 2), dtype=np.int64)
    if not len(alone) or len(alone) > MOST >> 10:
        return none
    corners = place[triangles[triangle[alone]]]
    start = np.array([_middle(each, at) for each, at in zip(corners, low[voxel[alone]], strict=True)])
    inwards = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # the visible targets: stretches, and the other parts
    owner = np.concatenate([seen[0], voxel[alone]])
    point, node = np.concatenate([seen[1], start]), np.concatenate([seen[2], alone])
    facing = np.concatenate([np.zeros_like(seen[1]), inwards])
    order = np.argsort(owner, kind="stable")
    begin, end = (np.searchsorted(owner[order], voxel[alone], side) for side in ("left", "right"))
    if (end - begin).sum() > MOST:
        return none
    source, entry = ranges(begin, end - begin)
    target = order[entry]
    offset = point[target] - start[source]
    ahead = dot(offset, inwards[source]) > 0
    back = dot(offset, facing[target])
    other = np.concatenate([np.full(len(seen[0]), -1), part])[target]
    candidate = ahead & ((other < 0) | ((back < 0) & (other != part[source])))
    source, target, offset = source[candidate], target[candidate], offset[candidate]
    order = np.lexsort((dot(offset, offset), source))
    source, target, offset = source[order], target[order], offset[order]
    rank = np.arange(len(source)) - np.searchsorted(source, source)
    source, target, offset = (array[rank < NEAREST] for array in (source, target, offset))
    by_voxel = np.argsort(voxel, kind="stable")
    begin, end = (np.searchsorted(voxel[by_voxel], voxel[alone[source]], side) for side in ("left", "right"))
    if (end - begin).sum() > MOST:
        return none
    blocked = np.zeros(len(source), dtype=bool)
    ends = np.cumsum(end - begin)
    first = 0
    while first < len(source):
        last = max(first + 1, int(np.searchsorted(ends, (ends[first - 1] if first else 0) + BATCH, "right")))
        number, entry = ranges(begin[first:last], (end - begin)[first:last])
        number, other = number + first, by_voxel[entry]
        foreign = (other != alone[source[number]]) & (other != node[target[number]])
        number, other = number[foreign], other[foreign]
        hit = _crossed(start[source[number]], offset[number], place[triangles[triangle[other]]])
        blocked[number[hit]] = True
        first = last
    free = ~blocked
    return np.stack([alone[source[free]], node[target[free]]], axis=1)


def _crossed(start: np.ndarray, offset: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return (n,) bool: True if the segment from `start` along `offset` (n, 3) crosses its triangle of `corners` (n, 3,
    3).

    T. Moeller, B. Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", Journal of Graphics Tools 2 (1997).
    """
    one, two, away = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], start - corners[:, 0]
    normal, cross_away = np.cross(offset, two), np.cross(away, one)
    size = dot(one, normal)
    with np.errstate(all="ignore"):
        u, v, t = (dot(*both) / size for both in ((away, normal), (offset, cross_away), (two, cross_away)))
        crossed: np.ndarray = (u >= -TOUCHING) & (v >= -TOUCHING) & (u + v <= 1 + TOUCHING) & (t > 0) & (t < 1)
    return crossed


def _middle(corners: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Return (3,): a point of the triangle `corners` (3, 3) within the voxel at `low` (3,): the mean of the corners of
    its remaining part there (I. E. Sutherland, G. W. Hodgman, "Reentrant Polygon Clipping", CACM 17 (1974))."""
    polygon = [tuple(corner) for corner in corners]
    for axis in range(3):
        for sign, limit in ((1.0, low[axis]), (-1.0, low[axis] + 1)):
            clipped = []
            for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
                here, there = sign * (a[axis] - limit), sign * (b[axis] - limit)
                if here >= 0:
                    clipped.append(a)
                if here * there < 0:
                    part = here / (here - there)
                    clipped.append(tuple(p + part * (q - p) for p, q in zip(a, b, strict=True)))
            polygon = clipped or polygon
    return np.array(polygon).mean(axis=0)
