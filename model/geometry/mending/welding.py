"""Repairs of triangles into a surface: merges vertices at one position, removes degenerate and duplicate triangles,
makes orientations consistent."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.arithmetic.ordered import dot, norm
from softlab.model.geometry.edges import MeshEdges, components, edge_uses
from softlab.model.geometry.formats.polygons import FLAT

NEAR = 1e-8  # of the diagonal of the box around a mesh: rims nearer to each other were torn by rounding


def many(count: int, one: str, several: str = "") -> str:
    """Return a count with its noun: `1 piece`, `2 pieces`."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def add_note(notes: list[str], count: int, one: str, several: str) -> None:
    """Append a sentence on `count` items to `notes`, unless the count is 0."""
    if count:
        notes.append(many(count, one, several))


def welded(position: np.ndarray, triangles: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices, and leave out triangles without an area and copies; append the repairs to `notes`.

    Vertices at exactly one place are merged; where that gives edges of more than two triangles, only those on rims, so that a
    piece which is closed as it is numbered stays as it is. Then vertices on rims that are nearer than NEAR to each other are
    merged where that closes a rim: seams of surfaces by formula are off by rounding (sin 2 pi = -2.4e-16).

    Returns
    -------
    place : (vertices,) int64, the vertex that stands for each
    triangles : (n, 3) int64, of such vertices

    Raises InputError where no triangle has an area.
    """
    place = places(position)
    pending: list[str] = []
    cleaned = _cleaned(position, place[triangles], pending)
    apart = 0
    if (place != np.arange(len(place))).any() and (edge_uses(len(position), cleaned)[1] > 2).any():
        on_rims, rim_welded = _merged_on_rims(position, triangles, place)
        if not (edge_uses(len(position), rim_welded)[1] > 2).any():
            apart = int((place != np.arange(len(place))).sum() - (on_rims != np.arange(len(place))).sum())
            place, pending = on_rims, []
            cleaned = _cleaned(position, place[triangles], pending)
    merged = int((place != np.arange(len(place))).sum())
    one = "vertex at the place of another was merged with it"
    add_note(notes, merged, one, "vertices at the place of another were merged")
    notes += pending
    if apart:
        notes.append(
            f"{many(apart, 'vertex', 'vertices')} at the place of another kept apart: merging would make edges of more than "
            "two triangles"
        )
    return _seams_closed(position, place, cleaned, notes)


def places(position: np.ndarray) -> np.ndarray:
    """Return (vertices,) int64: the first vertex at exactly the same place as each."""
    order = np.lexsort(position.T)
    ordered = position[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])[: len(order)]
    place = np.empty(len(order), dtype=np.int64)
    place[order] = order[new][np.cumsum(new) - 1]  # lexsort is stable: the first of equal ones has the lowest index
    return place


def _cleaned(position: np.ndarray, triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    return _without_copies(len(position), without_flat(position, triangles, notes), notes)


def _merged_on_rims(position: np.ndarray, triangles: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices,): `place` for vertices on rims of the mesh in its numbering, the vertex itself for others; and
    the triangles."""
    cleaned = _cleaned(position, triangles, [])
    ends, uses = edge_uses(len(position), cleaned)
    rim = np.zeros(len(position), dtype=bool)
    rim[ends[uses == 1]] = True
    used = np.zeros(len(position), dtype=bool)
    used[cleaned] = True
    merge = rim | ~used
    first = np.full(len(position), len(position), dtype=np.int64)
    np.minimum.at(first, place[merge], np.flatnonzero(merge))  # the first of those that are merged at each place
    representative = np.arange(len(position))
    representative[merge] = first[place[merge]]
    return representative, _cleaned(position, representative[triangles], [])


def _seams_closed(
    position: np.ndarray, place: np.ndarray, triangles: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (place, triangles) with near vertices of rims merged, each group only where an edge gets its second triangle."""
    ends, uses = edge_uses(len(position), triangles)
    rim = np.unique(ends[uses == 1])
    if not len(rim):
        return place, triangles
    near = NEAR * float(norm(np.ptp(position[triangles].reshape(-1, 3), axis=0)))
    group = _groups(position[rim], near)
    for _ in range(2):  # the second time without groups that close nothing
        represent = np.arange(len(position))
        represent[rim] = rim[group]
        if (represent[rim] == rim).all():
            return place, triangles
        pending: list[str] = []
        cleaned = _cleaned(position, represent[triangles], pending)
        now, uses_now = edge_uses(len(position), cleaned)
        if (uses_now > 2).sum() > (uses > 2).sum():
            return place, triangles
        closed = _closed_vertices(position, represent, ends[uses == 1], now[uses_now == 1])
        useful = np.zeros(len(position), dtype=bool)
        useful[represent[closed]] = True
        stays = ~useful[rim[group]]
        if not stays.any() or (group[stays] == np.flatnonzero(stays)).all():
            break
        group[stays] = np.flatnonzero(stays)
    count = int((represent != np.arange(len(position))).sum())
    left = int((uses_now == 1).sum())
    notes.append(
        f"{many(count, 'vertex', 'vertices')} on rims within {NEAR:g} of the mesh's size of another "
        f"{'was' if count == 1 else 'were'} merged, which closed seams: of {int((uses == 1).sum())} edges on rims {left} "
        f"{'is' if left == 1 else 'are'} left"
    )
    notes += pending
    return represent[place], cleaned


def _groups(points: np.ndarray, near: float) -> np.ndarray:
    """Return (n,) int64: the lowest of `points` (n, 3) that a chain of distances up to `near` joins to each."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(near, output_type="ndarray")
    return components(len(points), pairs)


def _closed_vertices(position: np.ndarray, represent: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the ends of edges on rims `before` (n, 2) that are on no rim `after` the merging."""
    count = len(position)
    key = np.sort(represent[before], axis=1)
    gone = ~np.isin(key[:, 0] * count + key[:, 1], after[:, 0] * count + after[:, 1])
    return np.unique(before[gone])


def without_flat(position: np.ndarray, triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    """Return the triangles (n, 3) that have an area; append the number of the others to `notes`. Raises InputError if
    none has one."""
    a, b, c = (position[corner] for corner in triangles.T)
    one, two, three = b - a, c - b, a - c
    longest = np.maximum(np.maximum(dot(one, one), dot(two, two)), dot(three, three))
    normal = np.cross(one, two)
    has_area = np.sqrt(dot(normal, normal)) > FLAT * longest
    if not has_area.any():
        raise InputError(
            f"none of its {len(triangles)} triangles has an area; is it a set of lines or points? Export it with faces"
        )
    add_note(
        notes, int((~has_area).sum()), "triangle without area was left out", "triangles without area were left out"
    )
    return triangles[has_area]


def _without_copies(vertex_count: int, triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    low, middle, high = np.sort(triangles, axis=1).T
    _, pair = np.unique(low * vertex_count + middle, return_inverse=True)
    _, first = np.unique(pair * vertex_count + high, return_index=True)
    count = len(triangles) - len(first)
    add_note(notes, count, "duplicate triangle was left out", "duplicate triangles were left out")
    return triangles[np.sort(first)] if count else triangles


def flip_mask(edges: MeshEdges) -> np.ndarray:
    """Return (triangles,) bool: those to turn over so that every two neighbours pass their edge in opposite directions.

    The lesser part of each surface; of equal parts the one without the first triangle. Each triangle stands twice in a
    graph, as it is and turned over, joined to the neighbours it agrees with: a surface has two sides where that falls in two.
    Raises InputError for a surface with one side.
    """
    count = len(edges.corners)
    over = np.zeros(count, dtype=bool)
    if not edges.alike.any():
        return over
    one, two = edges.triangles[edges.inner].T.astype(np.int64)
    other = two + count * edges.alike
    label = components(
        2 * count,
        np.concatenate([np.stack([one, other], 1), np.stack([one + count, (other + count) % (2 * count)], 1)]),
    )
    as_is, reverse = label[:count], label[count:]
    if (as_is == reverse).any():
        triangle = int(np.argmax(as_is == reverse))
        raise InputError(
            f"the surface of triangle {triangle} has one side only (a Moebius strip): walking across its edges leads back to "
            "it the other way round; cut it open along a row of edges, or make it a mesh_collider, which takes it as it is"
        )
    over = as_is > reverse  # the sheet with the surface's first triangle has the lowest label
    surface = np.minimum(as_is, reverse)
    part = np.bincount(surface, over, count)
    return np.asarray(over ^ (2 * part > np.bincount(surface, minlength=count))[surface])
