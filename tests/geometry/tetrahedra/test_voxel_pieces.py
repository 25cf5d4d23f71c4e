"""Which pieces of a body there are in each voxel, and which hang together: held against counting cells.

Bodies of blocks, thick and thin, in voxels that are no multiples of them, or that meet their sides: within each voxel the
connected parts of half blocks are labelled one by one, as are those that touch across its sides.
"""

import numpy as np
import pytest
from closed_meshes import blocks
from scipy import ndimage

from softlab.model.base.errors import InputError
from softlab.model.geometry.mesh import triangle_mesh
from softlab.model.geometry.solid import solid
from softlab.model.geometry.tetrahedra.meeting import Cells
from softlab.model.geometry.tetrahedra.overlap import triangles_in_voxels
from softlab.model.geometry.tetrahedra.pieces import pieces_of
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh
from softlab.model.geometry.voxels import runs_inside


def some_blocks(chance):
    """(n, 3): cells of a heap at random, or of a worm."""
    size = int(chance.integers(3, 8))
    if chance.random() < 0.5:
        return np.argwhere(chance.random((size, size, size)) < chance.choice([0.1, 0.3, 0.5, 0.7, 0.9]))
    filled, at = np.zeros((size, size, size), bool), chance.integers(0, size, 3)
    for _ in range(int(chance.integers(5, 80))):
        filled[tuple(at)] = True
        axis = chance.integers(3)
        at[axis] = np.clip(at[axis] + chance.choice([-1, 1]), 0, size - 1)
    return np.argwhere(filled)


def counted(cells, counts, each, shift):
    """(parts in each voxel, pairs of parts that touch across a side along each axis, whether any touch by an edge alone)."""
    fine = np.zeros(counts * each, bool)
    for x, y, z in 2 * cells + shift:
        fine[x : x + 2, y : y + 2, z : z + 2] = True
    label, parts, unclear = np.zeros(fine.shape, int), np.zeros(counts, int), False
    for voxel in np.ndindex(*counts):
        there = tuple(slice(i * n, i * n + n) for i, n in zip(voxel, each, strict=True))
        found, parts[voxel] = ndimage.label(fine[there])
        unclear |= parts[voxel] != ndimage.label(fine[there], np.ones((3, 3, 3)))[1]
        label[there] = np.where(found, found + label.max(), 0)
    joined = []
    for axis, n in enumerate(each):
        along = np.moveaxis(label, axis, 0)
        low, high = along[n - 1 : -1 : n], along[n::n]
        joined.append(len(np.unique(np.stack([low, high], axis=-1)[(low > 0) & (high > 0)], axis=0)))
    return parts, joined, unclear


def case(seed):
    """What the lab finds and what counting does, of one body; None where blocks touch by an edge alone."""
    chance = np.random.default_rng(seed)
    cells = some_blocks(chance)
    if not len(cells):
        return None
    cells -= cells.min(axis=0)
    try:
        mesh = triangle_mesh(*blocks([tuple(int(x) for x in cell) for cell in cells]))
    except InputError:
        return None
    hull = solid(mesh, 0.0)
    edge, scale = float(chance.choice([1.5, 2, 2.5, 3, 4])), chance.choice([1, 1, 0.5, 0.25, 0.05], 3)
    size = (cells.max(axis=0) + 1) * scale
    origin = size / 2 - np.ceil(size / edge) * edge / 2
    origin = np.round(origin / scale * 2) / 2 * scale  # half blocks stand on the lattice
    counts = np.ceil((size - origin) / edge - 1e-9).astype(int)
    place = (hull.position * scale - origin) / edge
    place = np.where(abs(place - np.round(place)) < 1e-9, np.round(place), place)
    triangle, through = triangles_in_voxels(place, hull.triangles, counts)
    centres = runs_inside(place, hull.triangles, 1.0, (np.full(3, 0.5), counts))
    lattice = Cells(np.concatenate([through, *(index for index, _ in centres.points())]), counts)
    found = pieces_of(place, hull.triangles, mesh.edges, lattice, (triangle, lattice.number(through)))
    each, shift = np.round(2 * edge / scale).astype(int), np.round(-origin / scale * 2).astype(int)
    parts, joined, unclear = counted(cells, counts, each, shift)
    if unclear:
        return None
    got = np.zeros(counts, int)
    np.add.at(got, tuple(lattice.index[found.voxel].T), 1)
    return (got.tolist(), [len(ends) for ends in found.joined]), (parts.tolist(), joined)


@pytest.mark.parametrize("part", range(4))
def test_pieces_and_what_joins_them_are_those_that_counting_finds(part):
    found = {seed: case(seed) for seed in range(100 * part, 100 * part + 100)}
    judged = {seed: answer for seed, answer in found.items() if answer}
    assert len(judged) > 15
    assert not [seed for seed, (got, wanted) in judged.items() if got != wanted]


def test_some_of_those_bodies_have_doubled_voxels():
    assert sum(bool(answer) and np.max(answer[1][0]) > 1 for answer in map(case, range(100))) > 1


def test_a_thin_plate_whose_triangles_end_at_the_lattice_is_not_torn():
    """No line of probes along the plate is within it, and no triangle passes from one voxel to the next."""
    position, triangles = blocks([(x, y, 0) for x in range(4) for y in range(3)])
    body = voxel_mesh((position * [1, 1, 0.01], triangles), edge=1.0)
    assert body.mesh.pieces() == 1 and len(body.mesh.position) == 5 * 4 * 2 and body.doubled == 0


def test_a_thin_plate_is_not_torn_from_a_block_whose_side_is_the_lattice_s():
    """The block's voxel is inside throughout: all that joins them are edges on the side between, with a triangle in it."""
    position, triangles = blocks([(0, 0, 0), (0, 0, 1), (0, 0, 2), (1, 0, 1)])
    position[:, 2] = np.array([0, 0.45, 0.55, 1])[np.round(position[:, 2]).astype(int)]
    body = voxel_mesh((position, triangles), edge=1.0)
    assert body.mesh.pieces() == 1 and len(body.mesh.position) == 12 and body.doubled == 0


def test_the_legs_of_a_v_are_two_where_their_triangles_meet_elsewhere():
    """The triangles of the inner sides share an edge with each other, far below the voxel that both legs are in."""
    outline = np.array([(0, 0), (1, 4), (0.8, 4), (0, 0.9), (-0.8, 4), (-1, 4)], dtype=float)
    front, back = (np.column_stack([outline, np.full(6, z)]) for z in (0.3, 0.0))
    cap = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    k, after = np.arange(6), (np.arange(6) + 1) % 6
    wall = np.concatenate([np.stack([k, k + 6, after], 1), np.stack([after, k + 6, after + 6], 1)])
    body = voxel_mesh((np.concatenate([front, back]), np.concatenate([cap, cap[:, ::-1] + 6, wall])), edge=2.0)
    assert body.doubled == 1 and body.mesh.pieces() == 1
    assert len(body.mesh.tetrahedra) == 3 * 5 and len(body.mesh.position) == 8 + 2 * 4


def test_copies_that_share_all_their_vertices_are_one():
    """A slit through the middle one of 27 voxels, and no farther: what lies on both sides of it hangs together around it."""
    slit = {(4, y, z) for y in (3, 4, 5) for z in (3, 4, 5)}
    cells = [cell for cell in np.ndindex(9, 9, 9) if cell not in slit]
    body = voxel_mesh(blocks(cells), edge=3.0)
    assert len(body.mesh.tetrahedra) == 27 * 5 and body.doubled == 0 and body.mesh.pieces() == 1
    assert set(body.mesh.face_counts) == {1, 2}
