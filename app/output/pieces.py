"""Parts of a state for other programs: skins, particles, cloths, grids and colliders as triangles, lines and points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from softlab.app.render import colours
from softlab.app.render.collider_shapes import collider_mesh, plane_axes
from softlab.model.core.spare import copies_there
from softlab.model.geometry.normals import mesh_normals
from softlab.model.particles.body_set import Copy
from softlab.model.scene.scene import Scene
from softlab.model.scene.sheets import scene_normals, triangles_of
from softlab.model.tables.cloth import Plane

PLANE_REACH = 1.0  # relative to the scene's size: a plane extends so far on each side of the masses


@dataclass(frozen=True, eq=False)
class Piece:
    """One object: `vertices` (n, 3) [m] in one `colour`, (red, green, blue) in 0 to 1 as displayed on a screen.

    With `triangles` (m, 3), counter-clockwise from outside, and `normals` (n, 3) it is a surface; with `lines`, rows of
    indices of vertices, each a line through them, it is lines; else points.
    """

    name: str
    vertices: np.ndarray
    colour: tuple[float, float, float]
    triangles: np.ndarray | None = None
    normals: np.ndarray | None = None
    lines: tuple[np.ndarray, ...] = ()


def pieces_of(
    scene: Scene, position: np.ndarray, matrices: np.ndarray | None = None, inverse_mass: np.ndarray | None = None
) -> list[Piece]:
    """Return the moving parts of a state.

    `position` (particles, dimensions) [m]; for bodies `matrices` (clusters, 3, 4) of ClusterFrames, without those that
    are inactive by `inverse_mass`, as in State (None: when the scene starts). A body without a skin is its particles; a
    sheet without triangles its lines; one without springs its masses.
    """
    if scene.bodies:
        assert matrices is not None
        there = copies_there(scene, inverse_mass)
        return [_body(scene, copy, position, matrices) for copy in scene.body_set.copies if there[copy.number]]
    if scene.tetrahedra:
        return _skins(scene, position)
    if scene.fluids:
        fluid, flat = scene.fluid_set.fluid, position if position.shape[1] == 3 else np.pad(position, ((0, 0), (0, 1)))
        return [
            Piece(name, np.ascontiguousarray(flat[fluid == number]), colours.BODIES[(number + 1) % len(colours.BODIES)])
            for number, name in enumerate(scene.fluids)
        ]
    name = next((name for name, part in scene.parts.items() if part is scene.grid), "grid")
    triangles = triangles_of(scene) if scene.cloth else np.zeros((0, 3), np.int32)
    if len(triangles):
        return [Piece(name, position, colours.CLOTH_FRONT, triangles, scene_normals(scene, position))]
    flat = position if position.shape[1] == 3 else np.pad(position, ((0, 0), (0, 1)))
    index = np.arange(len(position)).reshape(scene.grid.rows, scene.grid.columns)
    held = bool(scene.springs or scene.cloth_springs)
    lines = tuple(line for line in (*index, *index.T) if len(line) > 1) if held else ()
    return [Piece(name, flat, colours.INK, lines=lines)]


def _skins(scene: Scene, position: np.ndarray) -> list[Piece]:
    """Return the skins of tetrahedral bodies, deformed with their tetrahedra, and of a cloth beside them."""
    skin = scene.tetrahedra_set.skin
    points = skin.points(position)
    normals = mesh_normals(points, skin.faces)
    found = []
    for number, (name, triangles) in enumerate(zip(scene.holdable, skin.triangles, strict=True)):
        low, high = int(triangles.min()), int(triangles.max()) + 1
        colour = colours.BODIES[number % len(colours.BODIES)]
        found.append(Piece(name, points[low:high], colour, triangles - low, normals[low:high]))
    return found


def _body(scene: Scene, copy: Copy, position: np.ndarray, matrices: np.ndarray) -> Piece:
    """Return a copy of a body: its skin deformed by its clusters (linear blend skinning, model/assets/skin.py), or else
    its particles."""
    colour, baked = colours.BODIES[copy.number % len(colours.BODIES)], copy.baked
    several = scene.bodies[copy.name].count + scene.bodies[copy.name].spare > 1
    first = next(one.number for one in scene.body_set.copies if one.name == copy.name) if several else 0
    name = f"{copy.name}-{copy.number - first + 1}" if several else copy.name
    skin = baked.skin
    if skin is None or not len(skin.triangles):
        own = slice(copy.first_particle, copy.first_particle + len(baked.position))
        return Piece(name, position[own], colour)
    own = slice(copy.first_cluster, copy.first_cluster + baked.clusters.count)
    vertices, normals = skinned(skin.position, skin.normal, skin.clusters, skin.weights, matrices[own])
    return Piece(name, vertices, colour, skin.triangles, normals)


def skinned(
    position: np.ndarray, normal: np.ndarray, clusters: np.ndarray, weights: np.ndarray, matrices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, normal) (vertices, 3) float64: each vertex moved by the weighted mean of its clusters'
    `matrices` (clusters, 3, 4), as in the shaders; unit normals, 0 where they cancel."""
    moved, turned = np.zeros((2, *position.shape))
    for weight, cluster in zip(weights.T, clusters.T, strict=True):  # one after the other: a quarter of the memory
        own = weight[:, None, None] * matrices[cluster]
        moved += np.einsum("vij,vj->vi", own[:, :, :3], position) + own[:, :, 3]
        turned += np.einsum("vij,vj->vi", own[:, :, :3], normal)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return moved, np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)


def collider_pieces(scene: Scene, position: np.ndarray, time: float) -> Iterator[Piece]:
    """Iterate over the colliders at `time` [s]; a plane is a square below the masses, `position` (particles, 3) [m]."""
    names = {id(part): name for name, part in scene.parts.items()}
    for _, collider in scene.colliders:
        name, moved = names[id(collider)], time * np.array(collider.velocity)
        mesh = collider_mesh(collider)
        if mesh is not None:
            vertices, normals = mesh.turned(time) if mesh.turns else (mesh.vertices, mesh.normals)
            yield Piece(name, vertices + moved, colours.COLLIDER, mesh.triangles, normals)
        elif isinstance(collider, Plane):
            across, along, normal = plane_axes(collider.normal)
            middle = position.mean(axis=0)
            middle = middle - ((middle - collider.point - moved) @ normal) * normal
            reach = PLANE_REACH * scene.grid.extent + np.linalg.norm(position - middle, axis=1).max(initial=0.0)
            corners = [middle + reach * (s * across + t * along) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            square = np.array([[0, 1, 2], [0, 2, 3]])
            yield Piece(name, np.array(corners), colours.GROUND, square, np.tile(normal, (4, 1)))
