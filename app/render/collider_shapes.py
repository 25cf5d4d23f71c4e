"""Geometry of colliders and the ground for drawing: meshes, planes, shadows, and their part of the view. No OpenGL."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Box, Capsule, Collider, Plane, Sphere
from softlab.model.tables.colliders.surface_collider import SurfaceCollider, turn_matrix

RINGS, SECTORS = 20, 64  # of half a ball: flat enough that no edge shows
GROUND_STEPS = 8  # of the ground's height over the scene's size: it moves seldom, not with the lowest mass
GROUND_GAP = 0.03  # of the scene's size, between the lowest mass and the ground

EDGE = np.radians(45.0)  # between two facets at a vertex, from where on an edge is drawn sharp
WHOLE = 2.0  # times the masses' own size: a collider up to that is seen as a whole

UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Mesh:
    """`vertices` and unit `normals` (vertices, 3) float32 at time 0, `triangles` (triangles, 3) uint32, counter-clockwise
    from outside; `velocity` (3,) [m/s]; `spin` (3,) [rad/s] about `origin` (3,) [m]."""

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def turns(self) -> bool:
        """True if the mesh rotates."""
        return bool(self.spin.any())

    def rotated(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (vertices, normals) (vertices, 3) float32 at `time` [s], rotated by the spin alone."""
        turn = turn_matrix(self.spin * time).T
        vertices, normals = (self.vertices - self.origin) @ turn + self.origin, self.normals @ turn
        return _vectors(vertices), _vectors(normals)


@dataclass(frozen=True)
class Ground:
    """A plane to draw: `point` [m] and unit `normal` (3,), `across` and `along` (3,) unit vectors within it."""

    point: np.ndarray
    normal: np.ndarray
    across: np.ndarray
    along: np.ndarray


def plane_axes(normal: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (across, along, normal), each (3,), right-handed; a level plane's axes are x and -z."""
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    helper = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    across = helper - (helper @ n) * n
    across /= np.linalg.norm(across)
    return across, np.cross(n, across), n


def capsule_mesh(
    start: Sequence[float], end: Sequence[float], radius: float, velocity: Sequence[float] = (0.0, 0.0, 0.0)
) -> Mesh:
    """Return the mesh of the points at `radius` [m] from the segment; a ball if its length is 0."""
    ends = np.array([start, end], dtype=np.float64)
    axis = ends[1] - ends[0]
    across, along, axis = plane_axes(axis if np.linalg.norm(axis) > 0 else UP)
    # rings from the start's pole to the end's; the equator twice, once at each end of the cylinder between them
    latitude = np.concatenate([np.linspace(-np.pi / 2, 0, RINGS), np.linspace(0, np.pi / 2, RINGS)])
    angle = np.linspace(0, 2 * np.pi, SECTORS + 1)
    around = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * along
    normals = np.cos(latitude)[:, None, None] * around + np.sin(latitude)[:, None, None] * axis
    vertices = radius * normals + np.repeat(ends, RINGS, axis=0)[:, None]
    index = np.arange(2 * RINGS * (SECTORS + 1), dtype=np.uint32).reshape(2 * RINGS, SECTORS + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return _mesh(vertices, normals, np.stack([a, b, d, a, d, c], axis=-1), velocity)


def sphere_mesh(center: Sequence[float], radius: float, velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return the mesh of a ball."""
    return capsule_mesh(center, center, radius, velocity)


def box_mesh(center: Sequence[float], half_size: Sequence[float], velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return the mesh of a box along the axes; a corner is three vertices, one for each face's normal."""
    vertices: list[np.ndarray] = []
    normals: list[np.ndarray] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = sign
            across, along, _ = plane_axes(normal)
            corners = [normal + s * across + t * along for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            first = len(vertices)
            vertices += [np.asarray(center) + corner * half_size for corner in corners]
            normals += [normal] * 4
            faces.append([first, first + 1, first + 2, first, first + 2, first + 3])
    return _mesh(np.array(vertices), np.array(normals), np.array(faces), velocity)


def _mesh(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray, velocity: Sequence[float]) -> Mesh:
    indices = np.ascontiguousarray(faces.reshape(-1, 3), dtype=np.uint32)
    return Mesh(_vectors(vertices), _vectors(normals), indices, np.array(velocity, dtype=np.float64))


def _vectors(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array.reshape(-1, 3), dtype=np.float32)


def surface_mesh(collider: SurfaceCollider) -> Mesh:
    """Return a mesh with three vertices per triangle: smooth where facets meet at less than EDGE, with edges
    elsewhere."""
    corners = np.asarray(collider.origin) + collider.position[collider.triangles]
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # a file may tell a vertex again for each of its triangles
    _, place = np.unique(collider.position, axis=0, return_inverse=True)
    normals = corner_normals(place.reshape(-1)[collider.triangles], facets)
    mesh = _mesh(corners, normals, np.arange(collider.triangles.size), collider.velocity)
    return replace(mesh, spin=np.array(collider.spin, dtype=np.float64), origin=np.array(collider.origin))


def corner_normals(triangles: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return the normals (3 n, 3) of the corners of `triangles` (n, 3): the mean over the facets at the corner's vertex
    whose angle to the corner's facet is below EDGE, weighted by area. `facets` (n, 3): their normals, with their area
    as length."""
    vertex = triangles.ravel()
    order = np.argsort(vertex, kind="stable")  # corners, those of a vertex together
    valence = np.bincount(vertex)
    first, count = (np.cumsum(valence) - valence)[vertex], valence[vertex]
    # every corner with each one of its vertex
    corner = np.repeat(np.arange(len(vertex)), count)
    other = order[np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)]
    unit = facets / np.linalg.norm(facets, axis=1)[:, None]
    near = np.einsum("ij,ij->i", unit[corner // 3], unit[other // 3]) > np.cos(EDGE)
    corner, weighed = corner[near], facets[other[near] // 3]
    normals = np.stack([np.bincount(corner, axis, len(vertex)) for axis in weighed.T], axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def collider_mesh(collider: Collider) -> Mesh | None:
    """Return the mesh of a collider, or None for a plane, which has no end."""
    if isinstance(collider, Sphere):
        return sphere_mesh(collider.center, collider.radius, collider.velocity)
    if isinstance(collider, Capsule):
        return capsule_mesh(collider.start, collider.end, collider.radius, collider.velocity)
    if isinstance(collider, Box):
        return box_mesh(collider.center, collider.half_size, collider.velocity)
    if isinstance(collider, SurfaceCollider):
        return surface_mesh(collider)
    return None


def _extent(collider: Collider, time: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the lowest and the highest corner (3,) [m] of a collider, rotated as at `time` [s] and not moved; None for
    a plane."""
    if isinstance(collider, Sphere):
        return np.array(collider.center) - collider.radius, np.array(collider.center) + collider.radius
    if isinstance(collider, Capsule):
        ends = np.array([collider.start, collider.end])
        return ends.min(axis=0) - collider.radius, ends.max(axis=0) + collider.radius
    if isinstance(collider, Box):
        return np.subtract(collider.center, collider.half_size), np.add(collider.center, collider.half_size)
    if isinstance(collider, SurfaceCollider):
        origin = np.array(collider.origin)
        position = (
            collider.position @ turn_matrix(np.array(collider.spin) * time).T
            if any(collider.spin)
            else collider.position
        )
        return origin + position.min(axis=0), origin + position.max(axis=0)
    return None


def grounds(scene: Scene, time: float, lowest: float) -> list[Ground]:
    """Return the scene's planes at `time` [s]. Without planes and meshes below the scene: a level ground slightly below
    `lowest` [m]."""
    planes = [collider for _, collider in scene.colliders if isinstance(collider, Plane)]
    surfaces = []
    for plane in planes:
        across, along, normal = plane_axes(plane.normal)
        surfaces.append(Ground(np.array(plane.point) + time * np.array(plane.velocity), normal, across, along))
    if not surfaces:
        if any(isinstance(collider, SurfaceCollider) for _, collider in scene.colliders):
            return []  # it has a ground of its own
        size = scene.grid.extent
        step = size / GROUND_STEPS
        across, along, normal = plane_axes(UP)
        height = step * np.floor((lowest - GROUND_GAP * size) / step)
        surfaces.append(Ground(np.array([0.0, height, 0.0]), normal, across, along))
    return surfaces


def shadow_matrix(ground: Ground, light: np.ndarray) -> np.ndarray:
    """Return the matrix (4, 4) that projects a point along the direction to the `light` (3,) onto the ground."""
    matrix = np.eye(4)
    along = light / (ground.normal @ light)
    matrix[:3, :3] -= np.outer(along, ground.normal)
    matrix[:3, 3] = along * (ground.normal @ ground.point)
    return matrix


def line_distance(size: float) -> float:
    """Return the distance of the lines on the ground [m]: 1, 2 or 5 times a power of ten, about a fifth of the scene's
    size."""
    most = size / 5
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1, 2, 5) if step * power <= most * (1 + 1e-9)))


def with_colliders(scene: Scene, bounds: Sequence[float], time: float) -> tuple[float, ...]:
    """Return `bounds` (in the form of `finite_bounds`); in space enlarged to contain the colliders at `time` [s] by
    `collider_boxes`."""
    half = len(bounds) // 2
    low, high = np.array(bounds[:half]), np.array(bounds[half:])
    for near, far in collider_boxes(scene, bounds, time):
        low, high = np.minimum(low, near), np.maximum(high, far)
    return (*low.tolist(), *high.tolist())


def collider_boxes(scene: Scene, bounds: Sequence[float], time: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Return the lowest and highest corners (3,) [m] of the part of each collider, except planes, that a view of masses
    within `bounds` shows at `time` [s]. It is the whole collider if that is not much larger than the masses. Otherwise
    it extends at most half the masses' size beyond them on each side, since a ball as large as a planet, or one that
    flew off, would make the cloth invisibly small.

    It is the whole collider if that is not much larger than the masses, otherwise a part: a ball as large as a planet,
    or one that flew off, would leave nothing to see of the cloth.
    """
    low, high = np.array(bounds[:3]), np.array(bounds[3:])
    size = scene.grid.extent
    least, most = low - size / 2, high + size / 2
    for _, collider in scene.colliders:
        extent = _extent(collider, time)
        if extent is None:
            continue
        near, far = (corner + time * np.array(collider.velocity) for corner in extent)
        if (near <= most).all() and (far >= least).all():
            whole = (far - near).max() <= WHOLE * size
            yield (near, far) if whole else (np.maximum(near, least), np.minimum(far, most))
