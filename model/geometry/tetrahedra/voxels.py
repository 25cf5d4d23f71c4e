"""TEMPORARY stand-in for boxes."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from model.geometry.tetrahedra.mesh import TetrahedralMesh

FIVE = ((0, 3, 6, 5), (1, 0, 3, 5), (2, 0, 6, 3), (4, 0, 5, 6), (7, 3, 5, 6))


def _six():
    ways = []
    for order in permutations((1, 2, 4)):
        c = [0]
        for b in order:
            c.append(c[-1] | b)
        ways.append(tuple(c))
    return tuple(ways)


@dataclass
class VoxelMesh:
    mesh: TetrahedralMesh


def voxel_mesh(mesh, *, edge=None, voxels=None, per_voxel=5):
    lo, hi = mesh.position.min(0), mesh.position.max(0)
    edge = edge or (hi - lo).max() / voxels
    n = np.maximum(1, np.round((hi - lo) / edge).astype(int))
    g = np.stack(np.meshgrid(*[np.arange(k + 1) for k in n], indexing="ij"), -1).reshape(-1, 3)
    pos = lo + g * (hi - lo) / n
    ids = np.arange(len(g)).reshape(n + 1)
    t = []
    for i in range(n[0]):
        for j in range(n[1]):
            for k in range(n[2]):
                odd = (i + j + k) % 2
                for tet in FIVE if per_voxel == 5 else _six():
                    c = []
                    for b in tet:
                        x, y, z = b & 1, b >> 1 & 1, b >> 2 & 1
                        if odd and per_voxel == 5:
                            x = 1 - x
                        c.append(ids[i + x, j + y, k + z])
                    t.append(c)
    t = np.array(t)
    p = pos[t]
    bad = np.linalg.det(p[:, 1:] - p[:, :1]) < 0
    t[bad] = t[bad][:, [0, 1, 3, 2]]
    return VoxelMesh(TetrahedralMesh(pos, t))
