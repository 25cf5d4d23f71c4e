"""The constraints of a mesh, sorted by colours, as arrays for both backends; and their energies.

A new kind of constraint is an entry of MODELS: its projection (model/formulas/constraints), its corners and values on a
mesh, and its violation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.variant import check_returns
from softlab.model.core.build import Body
from softlab.model.formulas import bending as bending_formulas
from softlab.model.formulas import distance as distance_formulas
from softlab.model.formulas.constraints import dihedral, distance, isometric, tether, volume
from softlab.model.geometry.arithmetic.ordered import combined, dot, mean, norm
from softlab.model.geometry.measures import edge_lengths, triangle_areas
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.topology import mesh_of
from softlab.model.geometry.voxels import winding_numbers
from softlab.model.particles.constraints import ConstraintSet, Projection, coloured
from softlab.model.position_based.attachments import UNREACHED, vertex_attachments
from softlab.model.position_based.rest_shape import check_flat
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import CONSTRAINT_KINDS
from softlab.model.tables.xpbd import MAX_ANCHORS

FLAT = 1e-9  # of the edge: a shorter vector k at rest is the rounding of a flat hinge's coordinates
SHAKE = 1e-4  # of the mean edge
FLAT_TETRAHEDRON = 1e-3  # six times the volume, over the mean edge cubed: flatter ones are omitted
Arrays = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Model:
    """A constraint's projection, of `corners`, `values` and `multipliers`, and its `operations`.

    `build(mesh, kind)`: (corners (n, corners) int32, values (n, values) float64) of the scene's part `kind` on a mesh.
    `violation(position (vertices, 3), corners, values)`: (violations, divisor of the stiffness), with the energy
    stiffness / divisor * violation^2 / 2 [J]. `can_damp`: it supports a damper.
    """

    formulas: ModuleType
    corners: int
    values: int
    operations: int
    build: Callable[[TriangleMesh, str], Arrays]
    violation: Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray | float]]
    multipliers: int = 1
    can_damp: bool = False

    def __post_init__(self) -> None:
        check_returns(self.formulas.project, 2)


def constraint_sets(scene: Scene) -> tuple[ConstraintSet, ...]:
    """Return the scene's constraints in the order of projection: edges, then bending, those it has. Cached with the
    mesh."""
    part = scene.mesh
    assert part is not None
    mesh = mesh_of(part)
    known = _known.setdefault(mesh, {})
    for kind, name in wanted(scene):
        if (kind, name) not in known:
            if name == "isometric":
                check_flat(scene.name_of(kind), quarter_tangents(mesh.position, mesh.edges.winged))
            corners, values = MODELS[name].build(mesh, kind)
            known[kind, name] = coloured(kind, name, corners, values, len(mesh.position))
    return tuple(known[name] for name in wanted(scene))


def wanted(scene: Scene) -> tuple[tuple[str, str], ...]:
    """Return (kind, model) of the scene's constraints."""
    return tuple((kind, model_of(kind, getattr(part, "model", None))) for kind, part in scene.constraints.items())


def model_of(kind: str, stated: str | None = None) -> str:
    """Return the model of a kind of part: `stated` by the part, or the kind's own name, or distances."""
    return stated or (kind if kind in MODELS else "distance")


_known: WeakKeyDictionary[TriangleMesh, dict[tuple[str, str], ConstraintSet]] = WeakKeyDictionary()  # colouring is slow


def attachment_set(scene: Scene, body: Body) -> ConstraintSet:
    """Return the long-range attachments of every vertex to all its anchors. These are pinned, so that each attachment
    moves one vertex alone, and all have one colour."""
    anchors, reaches = vertex_attachments(scene, body, np.float64)
    attached = (body.inverse_mass > 0) & (reaches[:, 0] < UNREACHED)
    vertices = np.flatnonzero(attached).astype(np.int32)
    corners = np.concatenate([vertices[:, None], anchors[attached]], axis=1)
    return ConstraintSet("attachments", "tether", corners, reaches[attached], np.array([0, len(vertices)], np.int32))


def tether_of(anchors: int) -> Projection:
    """Return the projection of attachments to that number of anchors."""
    return Projection(
        f"attachments_{anchors}", tether, 1 + anchors, anchors, moves=1, soft=False, flags=(("anchors", anchors),)
    )


def projection_of(kind: str, parts: frozenset[str]) -> Projection:
    """Return the projection of a kind of part in a scene of such parts (model/position_based/mesh_plan.py)."""
    if kind == "attachments":
        return tether_of(next(n for n in range(1, MAX_ANCHORS + 1) if f"attachments-{n}" in parts))
    name = model_of(kind, next((name for name in MODELS if f"{kind}-{name}" in parts), None))
    model, soft, damped = MODELS[name], f"{kind}-compliance" in parts, f"{kind}-damping" in parts
    return Projection(
        f"{kind}_{name}",
        model.formulas,
        model.corners,
        model.values,
        model.multipliers,
        soft=soft,
        damped=damped,
        flags=(("soft", soft), ("damped", damped)) if model.can_damp else (),
        constants=(f"constraint_{kind}_compliance", f"constraint_{kind}_damping", f"constraint_{kind}_stiffening"),
    )


def projections_of(parts: frozenset[str]) -> tuple[Projection, ...]:
    """Return the projections of a scene of such parts, in the order of projection."""
    kinds = [kind for kind in (*CONSTRAINT_KINDS, "attachments") if kind in parts]
    return tuple(projection_of(kind, parts) for kind in kinds)


def operations_of(projection: Projection) -> int:
    """Return the floating-point operations of one constraint."""
    if projection.formulas is tether:
        return distance_formulas.OPERATIONS_ATTACHMENT
    if projection.formulas is distance:
        each = distance_formulas.OPERATIONS_SOFT if projection.soft else distance_formulas.OPERATIONS_RIGID
        return each + distance_formulas.OPERATIONS_DAMPER * projection.damped
    return next(model.operations for model in MODELS.values() if model.formulas is projection.formulas)


# ---------------------------------------------------------------------- distances


def _distances(mesh: TriangleMesh, kind: str) -> Arrays:
    ends, rest = _ends(mesh, kind)
    return ends, rest[:, None]


def _ends(mesh: TriangleMesh, kind: str) -> Arrays:
    """Return (ends (n, 2) int32, rest lengths (n,) [m]): edges; for `bending` the lines between wings."""
    ends = mesh.edges.winged[:, 2:] if kind == "bending" else mesh.edges.edges
    return ends, edge_lengths(mesh.position, ends)


def _stretch(position: np.ndarray, corners: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    return edge_lengths(position, corners) - values[:, 0], 1.0


# ---------------------------------------------------------------------- hinges


def _thirds(mesh: TriangleMesh) -> np.ndarray:
    """Return a third of both triangles' areas [m^2], (hinges,)."""
    return triangle_areas(mesh.position, mesh.triangles)[mesh.edges.triangles[mesh.edges.inner]].sum(axis=1) / 3


def _cotangents(apex: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cotangent of the angle at `apex` between the directions to `one` and `other` (n, 3), (n,)."""
    u, v = one - apex, other - apex
    return dot(u, v) / norm(np.cross(u, v))


def isometric_values(mesh: TriangleMesh) -> np.ndarray:
    """Return K of the edge's ends and wings (Bergou et al. 2006, eq. 5), length of k at rest [m], area [m^2]; (hinges,
    6)."""
    a, b, c, d = (mesh.position[corner] for corner in mesh.edges.winged.T)
    at_a = _cotangents(a, b, c), _cotangents(a, b, d)
    at_b = _cotangents(b, a, c), _cotangents(b, a, d)
    parts = np.stack([at_b[0] + at_b[1], at_a[0] + at_a[1], -at_a[0] - at_b[0], -at_a[1] - at_b[1]], axis=1)
    k = combined(parts, np.stack([a - a, b - a, c - a, d - a], axis=1))
    length, edge = norm(k), norm(b - a)
    length[length < FLAT * edge] = 0.0
    return np.column_stack([parts, length, _thirds(mesh)])


def dihedral_values(mesh: TriangleMesh) -> np.ndarray:
    """Return edge [m], tan(theta/4) at rest, area [m^2]; (hinges, 3)."""
    tangent = quarter_tangents(mesh.position, mesh.edges.winged)
    tangent[np.abs(tangent) < FLAT] = 0.0
    ends = mesh.edges.winged[:, :2]
    return np.column_stack([edge_lengths(mesh.position, ends), tangent, _thirds(mesh)])


def quarter_tangents(position: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Return tan(theta/4) of each hinge, in [-1, 1], (hinges,) float64."""
    a, b, c, d = (np.asarray(position, np.float64)[corner] for corner in hinges.T)
    e, f, g = b - a, c - a, d - a
    n, m = np.cross(e, f), np.cross(g, e)
    size = norm(n) * norm(m)
    sine = norm(e) * dot(g, n)
    return quarter_tangent(sine, dot(n, m)) * (size > 0)


def quarter_tangent(sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return tan(theta/4) in [-1, 1], (n,), from sines and cosines times a common factor of at least 0; 0 where both
    are 0. Up to a right angle by tan(theta/2) = sin / (1 + cos), beyond it by its inverse, both without cancellation;
    and tan(x/2) = t / (1 + sqrt(1 + t^2)) of t = tan(x)."""
    whole = np.sqrt(sine * sine + cosine * cosine)
    size = np.where(whole > 0, whole + np.abs(cosine), 1.0)
    ratio = np.abs(sine) / size
    root = np.sqrt(1 + ratio * ratio)
    return np.copysign(np.where(cosine >= 0, ratio / (1 + root), 1 / (ratio + root)), sine)


def _curvature(position: np.ndarray, corners: np.ndarray, values: np.ndarray) -> Arrays:
    k = combined(values[:, :4], position[corners] - position[corners[:, :1]])
    return norm(k) - values[:, 4], values[:, 5]


def _angle(position: np.ndarray, corners: np.ndarray, values: np.ndarray) -> Arrays:
    return 4 * values[:, 0] * (quarter_tangents(position, corners) - values[:, 1]), values[:, 2]


# ---------------------------------------------------------------------- volumes


def tetrahedra_within(mesh: TriangleMesh) -> np.ndarray:
    """Return the Delaunay tetrahedra of the vertices with centres inside the closed mesh, (n, 4) int32, of positive
    volumes. Vertices are perturbed by SHAKE of an edge for it: with five on one sphere it is not unique. Raises
    InputError: an open mesh, or one with nothing inside."""
    from scipy.spatial import Delaunay, QhullError

    p, edge = mesh.position, mean(edge_lengths(mesh.position, mesh.edges.edges))
    if mesh.boundary_loops:
        raise InputError(
            f"volume: needs a closed mesh; this one has {mesh.boundary_loops} rims: close them, or leave it out"
        )
    shaken = p + SHAKE * edge * np.random.default_rng(0).uniform(-1, 1, p.shape)
    try:
        corners = Delaunay(shaken).simplices.astype(np.int32)
    except QhullError:
        corners = np.zeros((0, 4), np.int32)
    inside = np.abs(winding_numbers(p[corners].mean(axis=1), p, mesh.triangles)) > 0.5
    corners = corners[inside & (np.abs(sixfold_volumes(p, corners)) > FLAT_TETRAHEDRON * edge**3)]
    if not len(corners):
        raise InputError("volume: nothing lies inside this mesh; leave it out")
    inverted = sixfold_volumes(p, corners) < 0
    corners[inverted] = corners[inverted][:, [0, 2, 1, 3]]
    return corners[np.lexsort(corners.T[::-1])]


def sixfold_volumes(position: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return six times the signed volumes of tetrahedra, (n,) float64 [m^3]."""
    a, b, c, d = (position[corner] for corner in corners.T)
    return dot(b - a, np.cross(c - a, d - a))


def _volumes(mesh: TriangleMesh, kind: str) -> Arrays:
    corners = tetrahedra_within(mesh)
    rest = sixfold_volumes(mesh.position, corners)
    return corners, np.stack([rest, 6 * rest], axis=1)


def _compression(position: np.ndarray, corners: np.ndarray, values: np.ndarray) -> Arrays:
    return sixfold_volumes(position, corners) - values[:, 0], values[:, 1]


# ---------------------------------------------------------------------- edges, strains and energies of a mesh


def edges_of(scene: Scene, kind: str = "structural") -> tuple[np.ndarray, np.ndarray]:
    """Return (ends (n, 2) int32, rest lengths (n,) [m]) of a mesh: its edges; for `bending` the lines between wings."""
    part = scene.mesh
    assert part is not None
    ends, rest = _ends(mesh_of(part), kind)
    return np.ascontiguousarray(ends), rest


def edge_strain(scene: Scene, position: np.ndarray, kind: str = "structural") -> np.ndarray:
    """Return (length - rest) / rest of the lines of `edges_of`, (n,) float64."""
    ends, rest = edges_of(scene, kind)
    return (edge_lengths(np.asarray(position, dtype=np.float64), ends) - rest) / rest


def mesh_energy(scene: Scene, position: np.ndarray, kind: str) -> float:
    """Return the energy [J] of a mesh's constraints of a kind at `position` (vertices, 3)."""
    (rows,) = (one for one in constraint_sets(scene) if one.kind == kind)
    violation, divisor = MODELS[rows.model].violation(np.asarray(position, np.float64), rows.corners, rows.values)
    return float(np.sum(scene.constraints[kind].storing_stiffness / divisor * violation**2) / 2)


MODELS = {
    "distance": Model(distance, 2, 1, distance_formulas.OPERATIONS_SOFT, _distances, _stretch, can_damp=True),
    "isometric": Model(
        isometric, 4, 6, bending_formulas.OPERATIONS_ISOMETRIC,
        lambda mesh, kind: (mesh.edges.winged, isometric_values(mesh)), _curvature, multipliers=3,
    ),
    "dihedral": Model(
        dihedral, 4, 3, bending_formulas.OPERATIONS_DIHEDRAL,
        lambda mesh, kind: (mesh.edges.winged, dihedral_values(mesh)), _angle,
    ),
    "volume": Model(volume, 4, 2, volume.OPERATIONS, _volumes, _compression),
}  # fmt: skip
