"""Small closed meshes with known volumes, for the tests of bodies."""

import numpy as np

from softlab.model.assets.baked_body import BakedBody
from softlab.model.assets.soft_body import SoftBody

Mesh = tuple[np.ndarray, np.ndarray]
SOFT = {"particle_spacing": 0.1, "cluster_spacing": 0.25, "cluster_radius": 0.3}


def box(size=(1.0, 1.0, 1.0), middle=(0.0, 0.0, 0.0)) -> Mesh:
    """Of `size` [m] about `middle`: 8 vertices, 12 triangles, outer sides outwards."""
    corner = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corner * np.array(size) / 2 + np.array(middle), np.array(triangles)


def turned_over(mesh: Mesh) -> Mesh:
    return mesh[0], mesh[1][:, ::-1]


def without_some(mesh: Mesh, *triangles: int) -> Mesh:
    return mesh[0], np.delete(mesh[1], triangles, axis=0)


def both(one: Mesh, other: Mesh) -> Mesh:
    return np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1] + len(one[0])])


def ball(radius=0.5, halvings=2) -> Mesh:
    """An octahedron whose triangles are cut in four `halvings` times, its vertices moved to the sphere."""
    from meshes import octahedron

    position, triangles = octahedron()
    for _ in range(halvings):
        ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        sides, number = np.unique(ends, axis=0, return_inverse=True)
        middle = len(position) + number.reshape(-1, 3)
        position = np.concatenate([position, position[sides].mean(axis=1)])
        a, b, c = triangles.T
        ab, bc, ca = middle.T
        triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        position /= np.linalg.norm(position, axis=1, keepdims=True)
    return position * radius, triangles


def blocks(cells, size=1.0) -> Mesh:
    """The surface of a set of cubes of `size`, which share the vertices between them."""
    solid, quads = set(cells), []
    for cell in cells:
        for axis in range(3):
            one, two = np.roll(np.eye(3, dtype=int), -axis, axis=0)[1:]
            for side in (0, 1):
                beyond = np.array(cell) + (2 * side - 1) * np.eye(3, dtype=int)[axis]
                if tuple(beyond) not in solid:
                    start = np.array(cell) + side * np.eye(3, dtype=int)[axis]
                    quad = [start, start + one, start + one + two, start + two]
                    quads.append(quad if side else quad[::-1])
    corners, number = np.unique(np.array(quads).reshape(-1, 3), axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    return corners * size, np.concatenate([number[:, [0, 1, 2]], number[:, [0, 2, 3]]])


def volume_of(mesh: Mesh) -> float:
    a, b, c = (mesh[0][corner] for corner in mesh[1].T)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def area_of(mesh: Mesh) -> float:
    a, b, c = (mesh[0][corner] for corner in mesh[1].T)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def rotation(vector) -> np.ndarray:
    """(3, 3): by the length of `vector` (3,) [rad] about it (B. O. Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def soft(mesh, **more) -> BakedBody:
    """A body of some 500 particles, unless told otherwise."""
    return SoftBody.from_mesh(mesh, **{**SOFT, **more})
