"""The order in which tetrahedra of voxels are projected: those of a voxel one after the other, voxels by eight colours.

Voxels whose places are alike in whether they are even, along each of three axes, share no vertex (source: the colours of
VoxelMesh, model/geometry/tetrahedra/voxels.py); of copies of one voxel those that do share one get colours of their own. The
longest side of a body counts first: all layers of even place across it come before all others. So no even layer waits for
another, nor does an odd one, and a body can be cut into slabs that meet twice in a sweep.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from model.core.errors import InputError
from model.geometry.lists import offsets_of
from model.tetrahedra.body_set import TetrahedraSet

# Of five the large one, which touches all others, comes last: a sweep then leaves less undone than with it first. At 30
# substeps a frame the bar of `softlab tetrahedra` sags 1.0907 (1 MPa) and 2.084 (10 MPa) times as far as its mesh says,
# 1.0940 and 2.230 with it first, 1.0900 and 2.032 by greedy colours of single tetrahedra.
LAST = {5: np.array([1, 2, 3, 4, 0])}


def voxel_order(found: TetrahedraSet, chosen: np.ndarray, run: int) -> tuple[np.ndarray, np.ndarray]:
    """(order (n,), starts (colours + 1,) int32) of the `chosen` tetrahedra (n,), `run` of them a voxel: in each colour by
    body and place. Raises InputError: voxels of one colour share a vertex, which those that the lab makes do not."""
    first = chosen[::run]
    place, body, vertices = found.voxel[first], found.body[first], found.tetrahedra[chosen].reshape(len(first), -1)
    level, odd = _levels(np.column_stack([body, place]), vertices), place.astype(np.int64) % 2
    colour = (odd[:, 0] * (level.max() + 1) + level) * 4 + 2 * odd[:, 1] + odd[:, 2]
    order = np.lexsort((place[:, 2], place[:, 1], place[:, 0], body, colour))
    sizes = np.bincount(colour)
    starts = offsets_of(sizes[sizes > 0])
    owner = np.empty(found.particle_count, np.int64)
    for start, stop in pairwise(starts):
        members = order[start:stop]
        owner[vertices[members]] = members[:, None]
        if (owner[vertices[members]] != members[:, None]).any():
            raise InputError("voxels of a body that do not touch share a vertex: its file is no good; cook it again")
    return (order[:, None] * run + LAST.get(run, np.arange(run))).ravel(), (starts * run).astype(np.int32)


def _levels(place: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """(voxels,) int64: 0; of copies at the same `place` (voxels, 4) that share a vertex 0, 1, ..."""
    level = np.zeros(len(place), np.int64)
    _, number, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    several = np.flatnonzero(count[number] > 1)
    taken: dict[int, list[set[int]]] = {}
    for one in several.tolist():
        own, levels = set(vertices[one].tolist()), taken.setdefault(int(number[one]), [])
        free = next((n for n, held in enumerate(levels) if not own & held), len(levels))
        if free == len(levels):
            levels.append(set())
        levels[free] |= own
        level[one] = free
    return level
