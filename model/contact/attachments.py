"""Attachments of vertices of tetrahedral bodies and a cloth as constraints for both backends' executors.

Attachments that are pinned, and follow what they are attached to, are in model/particles/tetrahedra_set.py.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.formulas.constraints import attachment as formula
from softlab.model.geometry.measures import nearest_of
from softlab.model.geometry.tetrahedra.embedding import carriers
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh
from softlab.model.particles.constraints import ConstraintSet, Projection, coloured
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.tables.attachment import Attachment, pins

KIND = "attachment"
CORNERS = {
    "world": formula.WORLD,
    "bodies": formula.BODY,
    "cloth": formula.CLOTH,
}  # in the order of projection, after everything else
Rows = tuple[np.ndarray, np.ndarray]
_known: WeakKeyDictionary[TetrahedraSet, tuple[ConstraintSet, ...]] = WeakKeyDictionary()


def part_of(model: str) -> str:
    """Return the part of a plan for attachments of that model."""
    return f"{KIND}-{model}"


def attachment_parts(found: TetrahedraSet) -> frozenset[str]:
    """Return the parts of a plan for the set's attachments.

    Raises SceneError for an attachment without vertices, or to something that does not exist.
    """
    check_attachments(found)
    soft = [held for held in found.attachments.values() if not pins(held, found.names)]
    return frozenset(part_of(_model_of(found, held)) for held in soft)


def _model_of(found: TetrahedraSet, held: Attachment) -> str:
    """Return the model of CORNERS of an attachment."""
    if found.sheet and held.to == found.sheet.name:
        return "cloth"
    return "bodies" if held.to in found.names else "world"


def attachment_projections(parts: frozenset[str], iterated: bool, constants: tuple[str, str, str]) -> list[Projection]:
    """Return the projections of attachments in a scene of such parts."""
    return [
        Projection(
            f"{KIND}_{model}", formula.make, corners, formula.COUNTS[corners], formula.MULTIPLIERS, soft=iterated,
            constants=constants, flags=(("corners", corners),),
        )
        for model, corners in CORNERS.items() if part_of(model) in parts
    ]  # fmt: skip


def attachment_sets(found: TetrahedraSet) -> tuple[ConstraintSet, ...]:
    """Return the constraint sets of attachments, sorted by colours, cached with the bodies. Raises SceneError."""
    if found not in _known:
        _known[found] = _sets(found)
    return _known[found]


def _sets(found: TetrahedraSet) -> tuple[ConstraintSet, ...]:
    rows: dict[str, list[Rows]] = {model: [] for model in CORNERS}
    makers = {"world": _to_world, "bodies": _to_body, "cloth": _to_cloth}
    for name, held in found.attachments.items():
        if not pins(held, found.names):
            model = _model_of(found, held)
            rows[model].append(makers[model](found, name, held))
    made = []
    for model, some in rows.items():
        if some:
            corners, values = (np.concatenate(column) for column in zip(*some, strict=True))
            made.append(coloured(KIND, model, corners, values, found.particle_count))
    return tuple(made)


def check_attachments(found: TetrahedraSet) -> None:
    """Raise SceneError for an attachment without vertices."""
    for name, held in found.attachments.items():
        if not len(found.chosen(held.vertices, held.body)):
            raise SceneError(f"{name}.vertices", held.vertices, f"no vertex of {held.body} lies there")


def contact_free(found: TetrahedraSet) -> np.ndarray:
    """Return the particles that attach one body to another, or to a cloth, (particles,) bool.

    They coincide with it: contacts between bodies must ignore them, and the triangles of which they are corners.
    """
    free = np.zeros(found.particle_count, bool)
    for one in attachment_sets(found):
        if one.model != "world":
            free[one.corners] = True
    return free


def stored(found: TetrahedraSet, position: np.ndarray) -> float:
    """Return the energy [J] of compliant attachments at `position` (particles, 3)."""
    total = 0.0
    for one in attachment_sets(found):
        corners, compliance = np.asarray(position, np.float64)[one.corners], one.values[:, -1]
        there = one.values[:, :3]
        if one.model != "world":
            there = np.einsum("nk,nki->ni", one.values[:, :-1], corners[:, 1:])
        gives = compliance > 0
        total += float((((corners[:, 0] - there) ** 2).sum(axis=1)[gives] / compliance[gives]).sum() / 2)
    return total


def _to_world(found: TetrahedraSet, name: str, held: Attachment) -> Rows:
    vertices = found.chosen(held.vertices, held.body)
    places = found.position[vertices] if held.point is None else np.tile(held.point, (len(vertices), 1))
    return vertices[:, None].astype(np.int32), np.column_stack([places, np.full(len(vertices), held.compliance)])


def _to_body(found: TetrahedraSet, name: str, held: Attachment) -> Rows:
    vertices, number = found.chosen(held.vertices, held.body), found.names.index(held.to or "")
    start = int(found.first_particle[number])
    stop = [*found.first_particle[1:], found.particle_count][number]
    tetrahedra = found.tetrahedra[found.body == number]
    mesh = TetrahedralMesh(found.position[start:stop], tetrahedra - start)
    carried = carriers(mesh, found.position[vertices])
    _check_near(found, name, held, float(carried.beyond(mesh.position, mesh.tetrahedra).max()))
    corners = np.column_stack([vertices, tetrahedra[carried.tetrahedron]])
    return corners.astype(np.int32), np.column_stack([carried.weights, np.full(len(vertices), held.compliance)])


def _to_cloth(found: TetrahedraSet, name: str, held: Attachment) -> Rows:
    """Return the rows of attachments to a cloth: each vertex keeps its place in the nearest triangle, or beside it.

    Its distance from the triangle at rest is removed by the constraint.
    """
    assert found.sheet is not None
    vertices, sheet = found.chosen(held.vertices, held.body), found.sheet
    points = found.position[vertices]
    number, weights, away = nearest_of(points, sheet.position[sheet.mesh.triangles])
    _check_near(found, name, held, float(away.max()))
    corners = np.column_stack([vertices, sheet.mesh.triangles[number] + found.first_particle[-1]])
    return corners.astype(np.int32), np.column_stack([weights, np.full(len(vertices), held.compliance)])


def _check_near(found: TetrahedraSet, name: str, held: Attachment, beyond: float) -> None:
    """Raise SceneError where a vertex is farther from what it is attached to [m] than a mean edge."""
    if beyond > found.spacing:
        told = f"a vertex of {held.body} lies {beyond:.3g} m outside of it; attach what touches it"
        raise SceneError(f"{name}.to", held.to, told)
