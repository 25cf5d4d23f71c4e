"""The pieces of a body within each voxel of a lattice, and their connections across the voxels' sides.

Within a voxel, pieces are connected by triangles with a common edge that passes through it; by the two ends of an
inside segment along a line of probes parallel to an axis; and by such segments with a common probe. Across a side, they
are connected by a triangle that passes through it; by two triangles that meet at an edge on it; and by an inside
segment that passes through it. All of these are facts about the body, so that pieces that do not touch are never
connected, however near. There are PROBES x PROBES lines per voxel and axis; a piece that none of them hits is connected
with what it sees (sight.py). A piece whose surface consists of parts that neither finds counts as several, each of
which is still connected with its neighbours across the sides. Bodies that overlap each other by less than a voxel /
PROBES may stay apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot
from softlab.model.geometry.edges import MeshEdges, components
from softlab.model.geometry.lists import ranges
from softlab.model.geometry.tetrahedra.meeting import Cells, across_edges, over_edges, positions
from softlab.model.geometry.tetrahedra.sight import in_sight
from softlab.model.geometry.voxels import crossings

PROBES = 4  # lines a voxel, along each of two axes
SIGHT_SAMPLES = 4  # triangles of a part that no line meets, from which is looked


@dataclass(frozen=True, eq=False)
class Chords:
    """The inside along the lines of probes of one axis, in cut voxels: `piece` (n,) int64 that each lies in; `line` (n, 2):
    where, along the two axes that follow, `low` and `high` (n,): from where to where, all in voxels from the voxel's first
    corner; `ends` (n,): how many of the two ends, 0 to 2, are the surface."""

    piece: np.ndarray
    line: np.ndarray
    low: np.ndarray
    high: np.ndarray
    ends: np.ndarray

    def nearest(self, chosen: np.ndarray, axis: int, local: np.ndarray) -> np.ndarray:
        """Return (n, 3): of the `chosen` chords (n,), which lie along `axis`, the points nearest to `local` (n, 3)."""
        points = np.empty((len(chosen), 3))
        points[:, [(axis + 1) % 3, (axis + 2) % 3]] = self.line[chosen]
        points[:, axis] = np.clip(local[:, axis], self.low[chosen], self.high[chosen])
        return points


@dataclass(frozen=True, eq=False)
class Pieces:
    """`voxel` (pieces,) int64: the voxel that each piece lies in, ascending. `of_pair` (pairs,) int64: the piece of each
    triangle in a voxel. `joined`: of each axis (n, 2) int64, pieces that hang together across a side, the lower voxel's
    first. `cut` (pieces,) bool: the surface passes through its voxel; `chords`: of each axis; `overlapping`: the body
    overlaps itself somewhere."""

    voxel: np.ndarray
    of_pair: np.ndarray
    joined: tuple[np.ndarray, np.ndarray, np.ndarray]
    cut: np.ndarray
    chords: tuple[Chords, Chords, Chords]
    overlapping: bool

    def nearest(self, voxel: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return (points,) int64: the piece of each point's `voxel` (points,) whose inside, along the lines, is nearest
        to the point at `local` (points, 3), in voxels from the voxel's first corner."""
        first, end = np.searchsorted(self.voxel, voxel), np.searchsorted(self.voxel, voxel, "right")
        piece, away = first.copy(), np.full(len(voxel), np.inf)
        several = np.flatnonzero(end - first > 1)
        for axis, chords in enumerate(self.chords):
            order = np.argsort(chords.piece, kind="stable")
            owner = chords.piece[order]
            begin, stop = np.searchsorted(owner, first[several]), np.searchsorted(owner, end[several])
            number, entry = ranges(begin, stop - begin)
            point, chord = several[number], order[entry]
            off = local[point] - chords.nearest(chord, axis, local[point])
            square = dot(off, off)
            closest = np.full(len(voxel), np.inf)
            np.minimum.at(closest, point, square)
            better = (square == closest[point]) & (square < away[point])
            piece[point[better]] = chords.piece[chord[better]]
            away = np.minimum(away, closest)
        return piece


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Stretches of the inside along one axis, a part for each voxel they pass through.

    `voxel` (parts,): it; `stretch` (parts,): ascending; `line` (parts, 2): of probes, in the two axes that follow `axis`;
    `low`, `high` (parts,): the ends, in voxels; `first`, `last` (parts,): the triangle that it begins and ends with, or -1.
    `overlapping`: some of the inside is there several times.
    """

    axis: int
    voxel: np.ndarray
    stretch: np.ndarray
    line: np.ndarray
    low: np.ndarray
    high: np.ndarray
    first: np.ndarray
    last: np.ndarray
    overlapping: bool


def pieces_of(
    place: np.ndarray, triangles: np.ndarray, edges: MeshEdges, cells: Cells, pairs: tuple[np.ndarray, np.ndarray]
) -> Pieces:
    """Return the pieces of the closed mesh of `place` (vertices, 3), in voxels, and `triangles` (n, 3), whose edges are
    `edges`. `pairs`: (triangle, number of a voxel) (pairs,), ascending, as `triangles_in_voxels` finds them."""
    triangle, voxel = pairs
    count, patches = len(triangle), across_edges(place, edges, cells, pairs)
    label = components(count, patches)
    several = np.bincount(voxel[label == np.arange(count)], minlength=len(cells)) > 1
    key = triangle * len(cells) + voxel
    whole = count + np.arange(len(cells))  # a node for each voxel that holds one piece
    single = ~several[voxel]
    ends = [patches, np.stack([np.flatnonzero(single), whole[voxel[single]]], axis=1)]
    owner = [voxel, np.arange(len(cells))]
    counted = [several[voxel], ~several]
    used, crossing, seen, lines = count + len(cells), [], [], []
    probe = np.cumsum(several) - 1  # of the voxels with several patches
    for axis in range(3):
        parts = _stretches(place, triangles, cells, axis)
        ambiguous = several[parts.voxel]
        node = np.where(ambiguous, used + np.cumsum(ambiguous) - 1, whole[parts.voxel])
        lines.append((parts, node))
        for of in (parts.first, parts.last):
            at, located = positions(key, np.where(of >= 0, of * len(cells) + parts.voxel, -1))
            ends.append(np.stack([node[located], at[located]], axis=1))
        ends.append(_probes_of(parts, np.flatnonzero(ambiguous), node, probe, cells))
        owner.append(parts.voxel[ambiguous])
        seen.append((parts.voxel[ambiguous], _middles(parts, np.flatnonzero(ambiguous), cells), node[ambiguous]))
        counted.append(np.ones(int(ambiguous.sum()), dtype=bool))
        used += int(ambiguous.sum())
        step = np.diff(cells.index[parts.voxel, axis])
        on = np.flatnonzero((parts.stretch[1:] == parts.stretch[:-1]) & (step == 1))
        at_side = over_edges(place, triangles, edges, cells, pairs, axis)
        known = (at_side < count) | ~several[np.maximum(at_side - count, 0)]
        crossing.append(np.concatenate([np.stack([node[on], node[on + 1]], axis=1), at_side[known.all(axis=1)]]))
    for group in ends:  # probes stand behind all other nodes: so far they count down from -1
        group[group < 0] = used - 1 - group[group < 0]
    nodes = used + int(several.sum()) * PROBES**3
    label = components(nodes, np.concatenate(ends))[:used]
    alone = several[voxel]
    alone[np.isin(label[:count], label[count:])] = False  # what some stretch begins or ends with
    middles = tuple(np.concatenate(group) for group in zip(*seen, strict=True))
    lonely = _some_of_each(np.flatnonzero(alone), label)
    lonely = lonely[np.argsort(voxel[lonely], kind="stable")]
    more = in_sight(place, triangles, cells.index, pairs, (lonely, label[lonely]), (middles[0], middles[1], middles[2]))
    if len(more):
        label = components(nodes, np.concatenate([*ends, more]))[:used]
    return _numbered(label, np.concatenate(owner), np.concatenate(counted), crossing, cells, pairs, lines)


def _some_of_each(pairs: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Return SIGHT_SAMPLES of the `pairs` of each label, evenly spread, or all if there are fewer."""
    pairs = pairs[np.argsort(label[pairs], kind="stable")]
    _, first, count = np.unique(label[pairs], return_index=True, return_counts=True)
    owner, rank = ranges(np.zeros(len(first), dtype=np.int64), count)
    return pairs[(rank * SIGHT_SAMPLES) // count[owner] != ((rank - 1) * SIGHT_SAMPLES) // count[owner]]


def _numbered(
    label: np.ndarray,
    owner: np.ndarray,
    counted: np.ndarray,
    crossing: list[np.ndarray],
    cells: Cells,
    pairs: tuple[np.ndarray, np.ndarray],
    lines: list[tuple[_Stretches, np.ndarray]],
) -> Pieces:
    """Number the pieces of nodes with a `label` in the voxel `owner` (nodes,); only `counted` nodes make pieces."""
    place, number = np.unique(label[counted], return_inverse=True)
    voxel = np.zeros(len(place), dtype=np.int64)
    voxel[number] = owner[counted]
    order = np.argsort(voxel, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    piece = rank[np.searchsorted(place, label).clip(max=len(place) - 1)]
    triangle, cell = pairs
    of_pair = piece[: len(triangle)]
    key = triangle * len(cells) + cell
    joined = []
    for axis in range(3):
        beside = cells.beside(axis)
        other, located = positions(key, np.where(beside[cell] >= 0, triangle * len(cells) + beside[cell], -1))
        through = np.stack([of_pair[located], of_pair[other[located]]], axis=1)
        ends = np.concatenate([through, piece[crossing[axis]]])
        both = np.unique(ends[:, 0] * len(place) + ends[:, 1])
        joined.append(np.stack(np.divmod(both, len(place)), axis=1))
    passed = np.zeros(len(cells), dtype=bool)
    passed[cell] = True
    x, y, z = (_chords(parts, piece[node], passed, cells) for parts, node in lines)
    overlapping = any(parts.overlapping for parts, _ in lines)
    return Pieces(
        voxel[order], of_pair, (joined[0], joined[1], joined[2]), passed[voxel[order]], (x, y, z), overlapping
    )


def _chords(parts: _Stretches, piece: np.ndarray, passed: np.ndarray, cells: Cells) -> Chords:
    """Return the chords: parts of stretches in voxels that the surface has `passed` (voxels,) through, of `piece`
    (parts,)."""
    selected = np.flatnonzero(passed[parts.voxel])
    start = cells.index[parts.voxel[selected], parts.axis]
    low, high = (np.clip(ends[selected] - start, 0.0, 1.0) for ends in (parts.low, parts.high))
    ends = (parts.first[selected] >= 0).astype(np.float64) + (parts.last[selected] >= 0)
    return Chords(piece[selected], (parts.line[selected] % PROBES + 0.5) / PROBES, low, high, ends)


def _stretches(place: np.ndarray, triangles: np.ndarray, cells: Cells, axis: int) -> _Stretches:
    """Along `axis`, on PROBES x PROBES lines through each voxel."""
    across, along = [(axis + 1) % 3, (axis + 2) % 3], cells.counts[axis]
    scaled = np.column_stack([place[:, across] * PROBES - 0.5, place[:, axis]])
    lines = cells.counts[across] * PROBES
    row, column, height, sign, triangle = crossings(scaled, triangles, np.append(lines, along))
    line = column * lines[1] + row
    order = np.lexsort((height, line))
    line, height, triangle = line[order], np.clip(height[order], 0, along), triangle[order]
    winding = -np.cumsum(sign[order])
    begin = np.flatnonzero((line[1:] == line[:-1]) & (winding[:-1] > 0) & (height[:-1] < height[1:]))
    low, high = height[begin], height[begin + 1]
    first = np.floor(low).astype(np.int64)
    length = np.maximum(np.ceil(high).astype(np.int64) - first, 1)
    stretch, cell = ranges(first, length)
    probes = np.stack(np.divmod(line[begin], lines[1]), axis=1)[stretch]
    index = np.empty((len(cell), 3), dtype=np.int64)
    index[:, axis], index[:, across] = cell, probes // PROBES
    voxel = cells.number(index)
    starts, ends = cell == first[stretch], cell == (first + length - 1)[stretch]
    some = voxel >= 0  # all of them, but for a surface that only rounding puts into a voxel
    return _Stretches(
        axis,
        voxel[some],
        stretch[some],
        probes[some],
        low[stretch][some],
        high[stretch][some],
        np.where(starts, triangle[begin][stretch], -1)[some],
        np.where(ends, triangle[begin + 1][stretch], -1)[some],
        bool((winding[begin] > 1).any()),
    )


def _probes_of(
    parts: _Stretches, selected: np.ndarray, node: np.ndarray, probe: np.ndarray, cells: Cells
) -> np.ndarray:
    """Return (n, 2): each of the parts `selected` with the probes on it, numbered from -1 down by `probe` and place."""
    voxel, across = parts.voxel[selected], [(parts.axis + 1) % 3, (parts.axis + 2) % 3]
    start = cells.index[voxel, parts.axis]
    low, high = ((ends[selected] - start) * PROBES - 0.5 for ends in (parts.low, parts.high))
    first = np.maximum(np.floor(low) + 1, 0).astype(np.int64)
    last = np.minimum(np.ceil(high) - 1, PROBES - 1).astype(np.int64)
    part, along = ranges(first, np.maximum(last - first + 1, 0))
    local = np.empty((len(part), 3), dtype=np.int64)
    local[:, parts.axis], local[:, across] = along, (parts.line[selected] % PROBES)[part]
    number = probe[voxel[part]] * PROBES**3 + (local[:, 0] * PROBES + local[:, 1]) * PROBES + local[:, 2]
    return np.stack([node[selected][part], -1 - number], axis=1)


def _middles(parts: _Stretches, selected: np.ndarray, cells: Cells) -> np.ndarray:
    """Return (n, 3): the middle of each of the parts `selected`, in voxels."""
    across = [(parts.axis + 1) % 3, (parts.axis + 2) % 3]
    start = cells.index[parts.voxel[selected], parts.axis]
    point = np.empty((len(selected), 3))
    point[:, across] = (parts.line[selected] + 0.5) / PROBES
    point[:, parts.axis] = (np.maximum(parts.low[selected], start) + np.minimum(parts.high[selected], start + 1)) / 2
    return point
