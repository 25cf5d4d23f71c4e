"""Holes of a surface: its rims as loops, and triangles that close them."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import mean, norm
from softlab.model.geometry.edges import edge_uses
from softlab.model.geometry.formats.polygons import on_a_line, triangulated

LONGEST = 500  # edges of a rim that is cut as a polygon, in O(n^2)


def rims(triangles: np.ndarray, bare: np.ndarray) -> list[np.ndarray]:
    """Return the rims of `triangles` (n, 3), whose sides `bare` (n, 3) bool have no neighbour: loops of vertices along
    those sides in reverse, each from its lowest vertex and through no vertex twice."""
    end, start = triangles[bare].tolist(), triangles[:, [1, 2, 0]][bare].tolist()
    following: dict[int, list[int]] = {}
    for one, two in sorted(zip(start, end, strict=True), reverse=True):
        following.setdefault(one, []).append(two)
    loops = []
    for first in sorted(following):
        path: list[int] = []
        place: dict[int, int] = {}
        at = first
        while following.get(at) or at in place:
            if at in place:  # a loop is closed; what led to it goes on
                loop = path[place[at] :]
                del path[place[at] :]
                for vertex in loop:
                    del place[vertex]
                lowest = loop.index(min(loop))
                loops.append(np.array(loop[lowest:] + loop[:lowest]))
                if not following.get(at):
                    break
            place[at] = len(path)
            path.append(at)
            at = following[at].pop()
    return sorted(loops, key=lambda loop: int(loop[0]))


def width(position: np.ndarray, loop: np.ndarray) -> float:
    """Return the diagonal of the box around a rim [m]; 0 for a slit, whose vertices lie on a line. It comes from a
    triangle without area, which CAD programs write where a vertex lies on a longer edge."""
    if on_a_line(position[loop][None])[0]:
        return 0.0
    return float(norm(np.ptp(position[loop], axis=0)))


def caps(position: np.ndarray, triangles: np.ndarray, loops: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return (positions with added vertices, triangles that close the rims `loops`). A rim is triangulated as a polygon
    (model/geometry/formats/polygons.py). A rim that crosses itself in its best-fit plane, whose diagonal is an edge
    already, or with more than LONGEST edges, gets a vertex at its middle.
    """
    short = [loop for loop in loops if len(loop) <= LONGEST]
    sizes = np.array([len(loop) for loop in short], dtype=np.int64)
    cut, crossing = triangulated(position, np.concatenate([np.zeros(0, np.int64), *short]), sizes)
    each = np.repeat(np.arange(len(short)), sizes - 2)
    ends, uses = edge_uses(len(position), np.concatenate([triangles, cut]))
    over = ends[uses > 2]
    key = np.sort(np.stack([cut, cut[:, [1, 2, 0]]], axis=-1), axis=-1)
    count = len(position)
    bad = np.isin(key[..., 0] * count + key[..., 1], over[:, 0] * count + over[:, 1]).any(axis=1)
    middle = np.union1d(crossing, each[bad])
    patches, points = [cut[~np.isin(each, middle)]], [position]
    around = [short[k] for k in middle.tolist()] + [loop for loop in loops if len(loop) > LONGEST]
    for number, loop in enumerate(around):
        points.append(mean(position[loop])[None])
        patches.append(np.stack([np.full(len(loop), count + number), loop, np.roll(loop, -1)], axis=1))
    return np.concatenate(points), np.concatenate(patches)
