"""The sheets of a mesh with edges of more than two triangles that bound a volume, as a surface whose edges have two.

The triangles fall into sheets between those edges. The winding number (A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust
Inside-Outside Segmentation using Generalized Winding Numbers", ACM Trans. Graph. 32 (2013), equation 5) decides which of them
have an inside on one side only; walls within a volume and fins outside are left out.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softlab.model.base.waiting import steps
from softlab.model.geometry.arithmetic.ordered import dot, norm
from softlab.model.geometry.edges import components, edge_uses, mesh_edges
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.mending.welding import flip_mask, many
from softlab.model.geometry.voxels import winding_numbers

PROBES = 3  # triangles of a sheet at which the winding number is taken
SMALL = 4  # triangles: of a sheet with so few, one; none where it hangs on the others by less than half of its outline
DIGITS = 9  # of an angle around an edge, in turns: triangles nearer to each other stand at one angle
TOGETHER = 16  # probes between two reports


def bounding(
    position: np.ndarray, triangles: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sheets of `triangles` (n, 3) that bound a volume; add notes on the others to `notes`.

    Returns
    -------
    source : (m,) int64, the vertex of `position` at which each vertex lies; several where sheets touch
    points : (m + added, 3) float64, where they lie, and the middles of edges that a surface passes more than once
    triangles : (k, 3) int64, of those vertices, two at most at an edge
    """
    fins = int((edge_uses(len(position), triangles)[1] > 2).sum())
    source, cut = split(triangles, _pairs(len(position), triangles))
    edges = mesh_edges(len(source), cut)
    over = flip_mask(edges)
    triangles = np.where(over[:, None], triangles[:, [0, 2, 1]], triangles)
    sheet = components(len(triangles), edges.triangles[edges.inner])
    bounds = _bounds(position, triangles, sheet)
    note = f"{many(fins, 'edge')} of more than two triangles: the inside was found by winding numbers"
    if not bounds.any():  # nothing encloses anything, which `solid` says
        bounds[:] = True
    if not bounds.all():
        left, sheets = many(int((~bounds).sum()), "triangle"), many(len(np.unique(sheet[~bounds])), "sheet")
        note += f", and {left} of {sheets} that bound no volume were left out"
    notes.append(note)
    pairs = _pairs(len(position), triangles[bounds], position)
    source, cut = split(triangles[bounds], pairs)
    return source, *_passed_once(position[source], cut, pairs)


def _bounds(position: np.ndarray, triangles: np.ndarray, sheet: np.ndarray) -> np.ndarray:
    """Return (triangles,) bool: True if the triangle's sheet bounds a volume. On a triangle, the winding number of the
    other triangles is the mean of both sides: 1/2 for a surface with an inside, an integer for a wall or a fin; near
    1/2 (plus an integer) if holes are small.
    """
    order = np.argsort(sheet, kind="stable")
    numbers, first, count = np.unique(sheet[order], return_index=True, return_counts=True)
    if len(numbers) == 1:
        return np.ones(len(triangles), dtype=bool)
    number = np.searchsorted(numbers, sheet)
    asked = np.flatnonzero(~(_hangs(position, triangles, number) & (count <= SMALL)))
    area = triangle_areas(position, triangles)
    probes, of = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for k in asked.tolist():
        members = order[first[k] : first[k] + count[k]]
        ends = np.cumsum(area[members])
        parts = (np.arange(PROBES) + 0.5) / PROBES if count[k] > SMALL else np.array([0.5])
        probes.append(members[np.minimum(np.searchsorted(ends, parts * ends[-1]), count[k] - 1)])
        of.append(np.full(len(parts), k))
    around = _winding_of_others(position, triangles, np.concatenate(probes))
    bounds = np.zeros(len(numbers), dtype=bool)
    for k in asked.tolist():
        bounds[k] = np.abs(np.median(around[np.concatenate(of) == k]) % 1 - 0.5) < 0.25
    return bounds[number]


def _hangs(position: np.ndarray, triangles: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Return (sheets,) bool: True if more than half of a sheet's outline has no neighbour; `number` (triangles,): the
    sheet of each."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    _, side, uses = np.unique(
        np.minimum(start, end) * len(position) + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    length = norm(position[end] - position[start])
    beside = uses[side]
    sheets = np.repeat(number, 3)
    free = np.bincount(sheets[beside == 1], length[beside == 1], number.max() + 1)
    outline = np.bincount(sheets[beside != 2], length[beside != 2], number.max() + 1)
    return np.asarray(free > outline / 2)


def _winding_of_others(position: np.ndarray, triangles: np.ndarray, probes: np.ndarray) -> np.ndarray:
    """Return (probes,): at the middle of each of these triangles, the winding number of all others."""
    middles = _middles(position, triangles[probes])
    winding = np.empty(len(probes))
    begins = range(0, len(probes), TOGETHER)
    for begin in steps(begins, len(begins), "inside by winding numbers"):
        some = slice(begin, begin + TOGETHER)
        winding[some] = winding_numbers(middles[some], position, triangles)
    self_winding = [
        winding_numbers(middle[None], position, triangles[k : k + 1])[0]
        for middle, k in zip(middles, probes, strict=True)
    ]
    return np.asarray(winding - self_winding)


def _middles(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (n, 3): the middles of `triangles` (n, 3)."""
    a, b, c = (position[corner] for corner in triangles.T)
    return np.asarray((a + b + c) / 3)


def _pairs(vertex_count: int, triangles: np.ndarray, position: np.ndarray | None = None) -> np.ndarray:
    """Return (n, 2) int64, pairs of sides (3 triangle + corner) that are joined: those of edges with two triangles; with a
    `position`, at other edges with an inside between them, too."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    two = first[count == 2]
    pairs = [np.stack([order[two], order[two + 1]], axis=1)]
    if position is not None:
        for begin, several in zip(first[count > 2], count[count > 2], strict=True):
            pairs.append(_around(position, triangles, order[begin : begin + several]))
    return np.concatenate(pairs)


def _around(position: np.ndarray, triangles: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return pairs of `sides` (n,) of one edge with an inside between them, by their angles around it.

    Seen along the edge from its lower vertex, a triangle that passes it that way has its outer side at larger angles, one
    that passes it the other way at smaller ones: they close and open an inside. Each is paired with its match, as brackets
    are, so that insides that overlap are closed, too; of triangles at one angle, as where two bodies touch, those that close
    come first.
    """
    triangle, corner = np.divmod(sides, 3)
    start, end = triangles[triangle, corner], triangles[triangle, (corner + 1) % 3]
    low, high = min(start[0], end[0]), max(start[0], end[0])
    axis = position[high] - position[low]
    axis = axis / norm(axis)
    away = position[triangles[triangle, (corner + 2) % 3]] - position[low]
    away = away - dot(away, axis)[:, None] * axis
    across = np.cross(axis, away[0])
    angle = np.arctan2(dot(away, across[None]), dot(away, away[:1]) * norm(across))
    turn = np.round(angle / (2 * np.pi) % 1, DIGITS) % 1
    opens = start != low
    order = np.lexsort((opens, turn))
    depth = np.cumsum(np.where(opens[order], 1, -1))
    order = np.roll(order, -1 - int(np.argmin(depth)))  # from where the least is open
    pairs, waiting = [], []
    for side, opening in zip(sides[order].tolist(), opens[order].tolist(), strict=True):
        if opening:
            waiting.append(side)
        elif waiting:
            pairs.append((waiting.pop(), side))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _passed_once(position: np.ndarray, triangles: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, triangles) with a vertex at the middle of edges that a surface passes more than once.

    If the triangles around both ends are connected, an edge keeps four triangles although `pairs` (n, 2) of sides
    define which are neighbours: each pair except the first, and each unpaired side, gets a separate vertex there.
    """
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * len(position) + np.maximum(start, end)
    _, number, uses = np.unique(key, return_inverse=True, return_counts=True)
    if not (uses > 2).any():
        return position, triangles
    group = components(len(key), pairs)  # of each side: the lower one of its pair
    several = np.flatnonzero(uses[number] > 2)
    lowest = np.full(len(uses), len(key))
    np.minimum.at(lowest, number[several], group[several])
    parted = several[group[several] != lowest[number[several]]]
    groups, which = np.unique(group[parted], return_inverse=True)
    middle = np.full(len(key), -1)
    middle[parted] = len(position) + which
    added = (position[start[groups]] + position[end[groups]]) / 2
    rows = middle.reshape(-1, 3)
    divided = (rows >= 0).any(axis=1)
    fans = [_fanned(*row) for row in zip(triangles[divided].tolist(), rows[divided].tolist(), strict=True)]
    return np.concatenate([position, added]), np.concatenate([triangles[~divided], *fans])


def _fanned(corners: list[int], middles: list[int]) -> np.ndarray:
    """Return the triangles of one whose sides have a vertex at their middle, or -1: a fan from the first such vertex."""
    first = next(k for k in range(3) if middles[k] >= 0)
    ring = [middles[first]]
    for k in (first + 1, first + 2, first + 3):
        ring += [corners[k % 3], middles[k % 3]]
    ring = [vertex for vertex in ring[:-1] if vertex >= 0]
    return np.array([(ring[0], one, two) for one, two in pairwise(ring[1:])])


def split(triangles: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give every fan of triangles its separate vertex: corners stay together that the `pairs` (n, 2) of sides join.

    A. Gueziec, G. Taubin, F. Lazarus, W. Horn, "Cutting and Stitching", IEEE Trans. Vis. Comput. Graph. 7 (2001).

    Returns (the old vertex of each new one (m,), triangles (n, 3) of new ones).
    """
    corner = triangles.ravel()
    one, two = pairs.T
    after = [side - side % 3 + (side + 1) % 3 for side in (one, two)]
    same = corner[one] == corner[two]  # both pass the edge the same way
    ends = [
        np.stack([one, np.where(same, two, after[1])], axis=1),
        np.stack([after[0], np.where(same, after[1], two)], axis=1),
    ]
    label = components(len(corner), np.concatenate(ends))
    representative, number = np.unique(label, return_inverse=True)
    order = np.argsort(corner[representative], kind="stable")  # in the order of the old vertices
    rank = np.empty(len(representative), dtype=np.int64)
    rank[order] = np.arange(len(representative))
    return corner[representative[order]], rank[number].reshape(-1, 3)
