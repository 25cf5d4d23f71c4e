"""The constraints of a mesh, sorted by colours, as arrays that both backends read; and the energies they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from model.formulas import bending as formulas
from model.geometry.mesh import TriangleMesh
from model.geometry.topology import edge_lengths, mesh_of, triangle_areas
from model.scene.cloth import Bending
from model.scene.scene import Scene
from model.xpbd.colouring import colour


@dataclass(frozen=True)
class Family:
    """Constraints of one kind: colour c is those from `starts[c]` to before `starts[c + 1]`; no two of it share a vertex.

    `corners` (constraints, 2 or 4) int32: the ends of a distance, or a hinge's edge and its wings (MeshEdges.winged).
    `values` (constraints, n) float64. A distance: rest length [m]. An isometric hinge: K of a, b, c, d, length of k at rest
    [m], (A_c + A_d) / 3 [m^2]. A dihedral one: edge at rest [m], tan(theta/4) at rest, (A_c + A_d) / 3 [m^2].
    """

    kind: str  # of the scene's part
    model: str  # distance, isometric, dihedral
    corners: np.ndarray
    values: np.ndarray
    starts: np.ndarray

    @property
    def colours(self) -> int:
        return len(self.starts) - 1


FLAT = 1e-9  # of the edge: a shorter vector k at rest is made of the rounded coordinates of a flat hinge


def families(scene: Scene) -> tuple[Family, ...]:
    """The scene's constraints: edges, then bending, those it has. Kept with the mesh."""
    part = scene.mesh
    assert part is not None
    mesh = mesh_of(part)
    made = _made.setdefault(mesh, {})
    for name in wanted(scene):
        if name not in made:
            made[name] = _family(mesh, *name)
    return tuple(made[name] for name in wanted(scene))


def wanted(scene: Scene) -> tuple[tuple[str, str], ...]:
    """(kind, model) of the families of the scene."""
    found = {"structural": "distance"} if "structural" in scene.cloth_springs else {}
    bending = scene.cloth_springs.get("bending")
    if isinstance(bending, Bending):
        found["bending"] = bending.model
    return tuple(found.items())


_made: WeakKeyDictionary[TriangleMesh, dict[tuple[str, str], Family]] = WeakKeyDictionary()  # colouring takes a while


def _family(mesh: TriangleMesh, kind: str, model: str) -> Family:
    if kind == "structural":
        corners, values = mesh.edges.edges, edge_lengths(mesh)[:, None]
    elif model == "distance":
        corners = mesh.edges.winged[:, 2:]
        values = _lengths(mesh.position, corners)[:, None]
    else:
        corners = mesh.edges.winged
        values = (isometric_values if model == "isometric" else dihedral_values)(mesh)
    found = colour(corners, len(mesh.position))
    return Family(kind, model, np.ascontiguousarray(corners[found.order]), values[found.order], found.starts)


def _lengths(position: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(position[ends[:, 1]] - position[ends[:, 0]], axis=1)


def _thirds(mesh: TriangleMesh) -> np.ndarray:
    """(hinges,): a third of both triangles' areas [m^2]."""
    return triangle_areas(mesh)[mesh.edges.triangles[mesh.edges.inner]].sum(axis=1) / 3


def _cotangents(apex: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,): of the angle at `apex` between the ways to `one` and `other` (n, 3)."""
    u, v = one - apex, other - apex
    return np.einsum("nk,nk->n", u, v) / np.linalg.norm(np.cross(u, v), axis=1)


def isometric_values(mesh: TriangleMesh) -> np.ndarray:
    """(hinges, 6): K of the edge's ends and of the wings (Bergou et al. 2006, eq. 5), length of k at rest [m], area [m^2]."""
    a, b, c, d = (mesh.position[corner] for corner in mesh.edges.winged.T)
    at_a = _cotangents(a, b, c), _cotangents(a, b, d)
    at_b = _cotangents(b, a, c), _cotangents(b, a, d)
    parts = np.stack([at_b[0] + at_b[1], at_a[0] + at_a[1], -at_a[0] - at_b[0], -at_a[1] - at_b[1]], axis=1)
    k = np.einsum("nc,cnk->nk", parts, np.stack([a - a, b - a, c - a, d - a]))
    length, edge = np.linalg.norm(k, axis=1), np.linalg.norm(b - a, axis=1)
    length[length < FLAT * edge] = 0.0
    return np.column_stack([parts, length, _thirds(mesh)])


def dihedral_values(mesh: TriangleMesh) -> np.ndarray:
    """(hinges, 3): edge [m], tan(theta/4) at rest, area [m^2]."""
    tangent = quarter_tangents(mesh.position, mesh.edges.winged)
    tangent[np.abs(tangent) < FLAT] = 0.0
    ends = mesh.edges.winged[:, :2]
    return np.column_stack([_lengths(mesh.position, ends), tangent, _thirds(mesh)])


def quarter_tangents(position: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """(hinges,) float64: tan(theta/4) of each, in [-1, 1]."""
    a, b, c, d = (np.asarray(position, np.float64)[corner] for corner in hinges.T)
    e, f, g = b - a, c - a, d - a
    n, m = np.cross(e, f), np.cross(g, e)
    size = np.linalg.norm(n, axis=1) * np.linalg.norm(m, axis=1)
    sine = np.linalg.norm(e, axis=1) * np.einsum("nk,nk->n", g, n)
    return np.tan(np.arctan2(sine, np.einsum("nk,nk->n", n, m)) / 4) * (size > 0)


def edges_of(scene: Scene, kind: str = "structural") -> tuple[np.ndarray, np.ndarray]:
    """(ends (n, 2) int32, rest lengths (n,) [m]) of a mesh: its edges; of `bending` the ways between wings."""
    part = scene.mesh
    assert part is not None
    mesh = mesh_of(part)
    ends = mesh.edges.winged[:, 2:] if kind == "bending" else mesh.edges.edges
    return np.ascontiguousarray(ends), _lengths(mesh.position, ends)


def edge_strain(scene: Scene, position: np.ndarray, kind: str = "structural") -> np.ndarray:
    """(n,) float64: (length - rest) / rest of what `edges_of` tells the ends of."""
    ends, rest = edges_of(scene, kind)
    return (_lengths(np.asarray(position, dtype=np.float64), ends) - rest) / rest


def mesh_energy(scene: Scene, position: np.ndarray, kind: str) -> float:
    """The energy [J] that a mesh's constraints of a kind hold at `position` (vertices, 3)."""
    springs = scene.cloth_springs[kind]
    (family,) = (f for f in families(scene) if f.kind == kind)
    corners, values, p = family.corners, family.values, np.asarray(position, np.float64)
    stiffness: float | np.ndarray = springs.storing_stiffness
    if family.model == "distance":
        held = _lengths(p, corners) - values[:, 0]
    elif family.model == "isometric":
        k = np.einsum("nc,nck->nk", values[:, :4], p[corners] - p[corners[:, :1]])
        held = np.linalg.norm(k, axis=1) - values[:, 4]
        stiffness = stiffness / values[:, 5]
    else:
        held = 4 * values[:, 0] * (quarter_tangents(p, corners) - values[:, 1])
        stiffness = stiffness / values[:, 2]
    return float(np.sum(stiffness * held**2) / 2)


OPERATIONS = {"isometric": formulas.OPERATIONS_ISOMETRIC, "dihedral": formulas.OPERATIONS_DIHEDRAL}
