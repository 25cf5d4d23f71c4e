"""The state as geometry for other programs: skins, particles, cloths, grids and colliders as triangles, lines and
points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.app.render import colours
from softlab.app.render.collider_shapes import collider_mesh, plane_axes
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

PLANE_EXTENT = 1.0  # relative to the scene's size: a plane extends so far on each side of the masses


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
    make = presentation_of(scene).pieces
    assert make is not None, "a world is exported member by member"
    pieces: list[Piece] = make(scene, position, matrices, inverse_mass)
    return pieces


def in_space(position: np.ndarray) -> np.ndarray:
    """Return positions (particles, 3) [m]; z is 0 for scenes in the plane."""
    return position if position.shape[1] == 3 else np.pad(position, ((0, 0), (0, 1)))


def skinned(
    position: np.ndarray, normal: np.ndarray, clusters: np.ndarray, weights: np.ndarray, matrices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, normal) (vertices, 3) float64: each vertex moved by the weighted mean of its clusters'
    `matrices` (clusters, 3, 4), as in the shaders; unit normals, 0 where they cancel."""
    moved, normals = np.zeros((2, *position.shape))
    for weight, cluster in zip(weights.T, clusters.T, strict=True):  # one after the other: a quarter of the memory
        blended = weight[:, None, None] * matrices[cluster]
        moved += np.einsum("vij,vj->vi", blended[:, :, :3], position) + blended[:, :, 3]
        normals += np.einsum("vij,vj->vi", blended[:, :, :3], normal)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return moved, np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def collider_pieces(scene: Scene, position: np.ndarray, time: float) -> Iterator[Piece]:
    """Iterate over the colliders at `time` [s]; a plane is a square below the masses, `position` (particles, 3) [m]."""
    names = {id(part): name for name, part in scene.parts.items()}
    for _, collider in scene.colliders:
        name, moved = names[id(collider)], time * np.array(collider.velocity)
        mesh = collider_mesh(collider)
        if mesh is not None:
            vertices, normals = mesh.rotated(time) if mesh.turns else (mesh.vertices, mesh.normals)
            yield Piece(name, vertices + moved, colours.COLLIDER, mesh.triangles, normals)
        elif isinstance(collider, Plane):
            across, along, normal = plane_axes(collider.normal)
            middle = position.mean(axis=0)
            middle = middle - ((middle - collider.point - moved) @ normal) * normal
            half_width = PLANE_EXTENT * scene.grid.extent + np.linalg.norm(position - middle, axis=1).max(initial=0.0)
            corners = [middle + half_width * (s * across + t * along) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            square = np.array([[0, 1, 2], [0, 2, 3]])
            yield Piece(name, np.array(corners), colours.GROUND, square, np.tile(normal, (4, 1)))
