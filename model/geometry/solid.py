"""Conversion of a triangle mesh into a solid, with safe repairs, which are reported. Small holes are filled, wide ones
on request; pieces that are inside out are reversed. A piece with reversed orientation inside another is a cavity, and
stays one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.waiting import work
from softlab.model.geometry.arithmetic.ordered import dot, mean, total
from softlab.model.geometry.edges import MeshEdges, NonManifold, components
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.mending.holes import caps, rims, width
from softlab.model.geometry.mending.welding import many
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh, with_triangles
from softlab.model.geometry.voxels import winding_numbers

PROBES = 16  # vertices of a piece that are asked whether they lie within the others
EMPTY = 2.0**-20  # volume over that of the box around the mesh: what float32 coordinates cannot tell from 0


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh, outer sides outwards: `position` (vertices, 3) float64 [m], `triangles` (n, 3) int32; `volume`
    [m^3], overlaps counted repeatedly; `area` [m^2]; `pieces` that are no cavities; `notes`: a sentence for each thing
    that was made good."""

    position: np.ndarray
    triangles: np.ndarray
    volume: float
    area: float
    pieces: int
    notes: tuple[str, ...]


CLOTH = 'a cloth: kind = "soft_sheet" or "mesh", or a mesh_collider'  # what a mesh without an inside can be instead
OTHERWISE = "set fill_holes = true (softlab cook: --fill-holes), or close it in the program that made it"


@work("closing the surface")
def solid(mesh: TriangleMesh, widest: float, instead: str = CLOTH, fill_holes: bool = False) -> Solid:
    """Return the body of a mesh. Holes up to `widest` [m] across are filled: no particle lies nearer to another; with
    `fill_holes` all of them. `instead`: advice in the message for a mesh that is not solid. Raises InputError (wider
    holes, nothing inside).
    """
    mesh = filled(mesh, np.inf if fill_holes else widest, instead)
    notes = list(mesh.repairs)
    triangles, pieces = _outwards(mesh.position, mesh.triangles, mesh.edges, notes)
    volume = total(_volumes(mesh.position, triangles))
    finest = float(np.finfo(np.float32).eps) * float(np.abs(mesh.position).max())
    box = float(np.prod(np.maximum(np.ptp(mesh.position, axis=0), finest)))
    if volume <= EMPTY * box:
        raise InputError(
            f"the mesh holds no volume ({volume:.3g} m^3): a flat sheet, or folded flat; give it a "
            f"thickness, or make it {instead}"
        )
    area = total(triangle_areas(mesh.position, triangles))
    return Solid(mesh.position, np.ascontiguousarray(triangles, dtype=np.int32), volume, area, pieces, tuple(notes))


def as_mesh(mesh: TriangleMesh | tuple[np.ndarray, np.ndarray], inside: bool = False) -> TriangleMesh:
    """Return the mesh, or that of (position (vertices, 3) [m], triangles (n, 3)), checked and mended; `inside`: see
    `triangle_mesh`. Raises InputError."""
    return mesh if isinstance(mesh, TriangleMesh) else triangle_mesh(*mesh, inside=inside)


def _volumes(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (triangles,) [m^3]: of the tetrahedra over each triangle, whose sum over a closed mesh is its volume."""
    a, b, c = (position[corner] - mean(position) for corner in triangles.T)
    return dot(a, np.cross(b, c)) / 6


def filled(mesh: TriangleMesh, widest: float, instead: str = CLOTH) -> TriangleMesh:
    """Return the mesh with every hole closed, none of which may be wider than `widest` [m]; slits without a width always.
    Raises InputError."""
    edges = mesh.edges
    if not edges.boundary.any():
        return mesh
    loops = rims(mesh.triangles, edges.boundary[edges.sides])
    across = [width(mesh.position, loop) for loop in loops]
    worst = int(np.argmax(across))
    if across[worst] > widest:
        edges_of = f"{len(loops[worst])} edges"
        others = f"{len(loops)} holes, the widest" if len(loops) > 1 else "a hole,"
        middle = (mesh.position[loops[worst]].min(axis=0) + mesh.position[loops[worst]].max(axis=0)) / 2
        where = ", ".join(f"{x:.4g}" for x in middle)
        limit = f" (holes up to {widest:.3g} m are filled)" if widest > 0 else ""
        raise InputError(
            f"the mesh is not closed ({others} {across[worst]:.3g} m across, with {edges_of}, at ({where})), so "
            f"it has no inside{limit}: {OTHERWISE}, or make it {instead}"
        )
    position, cap_triangles = caps(mesh.position, mesh.triangles, loops)
    hole = f"hole, up to {across[worst]:.3g} m across,", f"holes, up to {across[worst]:.3g} m across,"
    slit = "slit without a width", "slits without a width"
    were = "was" if len(loops) == 1 else "were"
    note = f"{many(len(loops), *(hole if across[worst] else slit))} {were} filled with {many(len(cap_triangles), 'triangle')}"
    try:
        return with_triangles(mesh, position, np.concatenate([mesh.triangles, cap_triangles]), [*mesh.repairs, note])
    except NonManifold:
        raise InputError(
            "the mesh is not closed, and its holes touch each other or run into a thin edge; close them in the program that "
            "made it"
        ) from None


def _outwards(
    position: np.ndarray, triangles: np.ndarray, edges: MeshEdges, notes: list[str]
) -> tuple[np.ndarray, int]:
    """Return (triangles with outer sides outwards, pieces that are no cavities)."""
    if edges.boundary.any():
        raise InputError(
            "the mesh is not closed, and its holes touch each other; close them in the program that made it"
        )
    label = components(len(position), edges.edges)[triangles[:, 0]]
    pieces, piece = np.unique(label, return_inverse=True)
    # about each piece's own corner, so that the sum is exact to its own size
    local = position[triangles] - position[pieces[piece]][:, None]
    each = dot(local[:, 0], np.cross(local[:, 1], local[:, 2]))
    volume = np.bincount(piece, each)
    if total(volume) < 0:  # the whole of it, with its cavities
        triangles, volume = triangles[:, [0, 2, 1]], -volume
        notes.append("the mesh was inside out, and turned over")
    inwards = volume < 0
    cavity = np.zeros(len(pieces), dtype=bool)
    if inwards.any():
        proper = np.where(inwards[piece][:, None], triangles[:, [0, 2, 1]], triangles)
        for k in np.flatnonzero(inwards):
            probe = np.unique(triangles[piece == k])
            probe = position[probe[:: max(1, len(probe) // PROBES)]]
            cavity[k] = bool((winding_numbers(probe, position, proper[piece != k]) > 0.5).all())
    flipped = inwards & ~cavity
    if flipped.any():
        triangles = np.where(flipped[piece][:, None], triangles[:, [0, 2, 1]], triangles)
        one = flipped.sum() == 1
        notes.append(f"{flipped.sum()} of {len(pieces)} pieces {'was' if one else 'were'} inside out, and turned over")
    return triangles, int((~cavity).sum())
