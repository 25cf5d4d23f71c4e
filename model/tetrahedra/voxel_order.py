"""The order in which tetrahedra of voxels are projected: those of a voxel one after the other, voxels by eight
colours.

Voxels with the same parity along each of three axes have no common vertex (colours of VoxelMesh,
model/geometry/tetrahedra/voxels.py); copies of one voxel that have one get further colours. The longest side of a body
counts first: all even layers across it come before all odd ones. So no even layer depends on another even one in a
sweep, nor an odd one on another odd one, and a body can be cut into slabs that exchange twice per sweep.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.lists import offsets_of
from softlab.model.particles.tetrahedra_set import TetrahedraSet

REMEDY = "its file is invalid; cook it again"
FIVE = 5  # of a voxel; the large one, which touches all others, comes first in a mesh


def voxel_order(body_set: TetrahedraSet, chosen: np.ndarray, run: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (order (n,), starts (colours + 1,) int32, corners (n, 4) int32) of the `chosen` tetrahedra (n,), `run` per
    voxel.

    In each colour they are sorted by body and place. Raises InputError: voxels of one colour share a vertex, or five
    tetrahedra are not one between four, which does not occur in bodies that the lab makes.
    """
    first = chosen[::run]
    place, body = body_set.voxel[first], body_set.body[first]
    vertices = body_set.tetrahedra[chosen].reshape(len(first), -1)
    level, odd = _levels(np.column_stack([body, place]), vertices), place.astype(np.int64) % 2
    colour = (odd[:, 0] * (level.max() + 1) + level) * 4 + 2 * odd[:, 1] + odd[:, 2]
    order = np.lexsort((place[:, 2], place[:, 1], place[:, 0], body, colour))
    sizes = np.bincount(colour)
    starts = offsets_of(sizes[sizes > 0])
    owner = np.empty(body_set.particle_count, np.int64)
    for start, stop in pairwise(starts):
        members = order[start:stop]
        owner[vertices[members]] = members[:, None]
        if (owner[vertices[members]] != members[:, None]).any():
            raise InputError(f"voxels of a body that do not touch share a vertex: {REMEDY}")
    corners = body_set.tetrahedra[chosen].reshape(-1, run, 4)[order]
    inside = np.broadcast_to(np.arange(run), corners.shape[:2])
    if run == FIVE:
        inside, corners = _around(corners)
    whole = (order[:, None] * run + inside).ravel()
    return whole, (starts * run).astype(np.int32), np.ascontiguousarray(corners.reshape(-1, 4))


def _around(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (order of a voxel's tetrahedra (voxels, 5), their corners (voxels, 5, 4)).

    The large one, with the corners c0 ... c3, is last, preceded by the four with another corner in place of c0,
    of c1, ..., as in Projection.around. Last, the large one leaves a smaller residual in a sweep than first: with it
    the bar of `softlab tetrahedra`, 2 voxels across, sags 1.090 (1 MPa) and 2.06 (10 MPa) times as far as its mesh
    predicts at 30 substeps per frame; greedy colours of single tetrahedra give 1.090 and 2.03.
    """
    core, small = corners[:, 0], corners[:, 1:]
    shared = (small[..., None] == core[:, None, None]).any(axis=3)  # corners of a small one that the large one has, too
    left_out = (core[:, None, :, None] != small[:, :, None]).all(axis=3)  # corners of the large one only
    if not ((shared.sum(axis=2) == 3).all() and (left_out.sum(axis=(1, 2)) == 4).all() and left_out.any(axis=1).all()):
        raise InputError(f"five tetrahedra of a voxel are not one between four: {REMEDY}")
    which = left_out.argmax(axis=1)  # (voxels, 4): the small one without corner m of the large one
    small, shared = (
        np.take_along_axis(small, which[..., None], axis=1),
        np.take_along_axis(shared, which[..., None], axis=1),
    )
    apex = np.take_along_axis(small, shared.argmin(axis=2)[..., None], axis=2)
    others = core[:, (np.arange(4)[:, None] + np.arange(1, 4)) % 4]
    rotated = np.concatenate([np.concatenate([apex, others], axis=2), core[:, None]], axis=1)
    return np.concatenate([which + 1, np.zeros((len(which), 1), np.int64)], axis=1), rotated


def _levels(place: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Return 0, or 0, 1, ... for copies at the same `place` (voxels, 4) with a common vertex, (voxels,) int64."""
    level = np.zeros(len(place), np.int64)
    _, number, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    several = np.flatnonzero(count[number] > 1)
    taken: dict[int, list[set[int]]] = {}
    for one in several.tolist():
        vertices_here, levels = set(vertices[one].tolist()), taken.setdefault(int(number[one]), [])
        free = next((n for n, used in enumerate(levels) if not vertices_here & used), len(levels))
        if free == len(levels):
            levels.append(set())
        levels[free] |= vertices_here
        level[one] = free
    return level
