"""Attachments of vertices of tetrahedral bodies and a cloth as constraints for both backends' executors.

Attachments that are pinned, and follow the object that they are attached to, are in
model/particles/tetrahedra_set.py.
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


def attachment_parts(body_set: TetrahedraSet) -> frozenset[str]:
    """Return the parts of a plan for the set's attachments.

    Raises SceneError for an attachment without vertices, or to something that does not exist.
    """
    check_attachments(body_set)
    soft = [attachment for attachment in body_set.attachments.values() if not pins(attachment, body_set.names)]
    return frozenset(part_of(_model_of(body_set, attachment)) for attachment in soft)


def _model_of(body_set: TetrahedraSet, attachment: Attachment) -> str:
    """Return the model of CORNERS of an attachment."""
    if body_set.sheet and attachment.to == body_set.sheet.name:
        return "cloth"
    return "bodies" if attachment.to in body_set.names else "world"


def attachment_projections(parts: frozenset[str], iterated: bool, constants: tuple[str, str, str]) -> list[Projection]:
    """Return the projections of the kinds of attachments that are among `parts`."""
    return [
        Projection(
            f"{KIND}_{model}", formula, corners, formula.COUNTS[corners], formula.MULTIPLIERS, soft=iterated,
            constants=constants, flags=(("corners", corners),),
        )
        for model, corners in CORNERS.items() if part_of(model) in parts
    ]  # fmt: skip


def attachment_sets(body_set: TetrahedraSet) -> tuple[ConstraintSet, ...]:
    """Return the constraint sets of attachments, sorted by colours, cached with the bodies. Raises SceneError."""
    if body_set not in _known:
        _known[body_set] = _sets(body_set)
    return _known[body_set]


def _sets(body_set: TetrahedraSet) -> tuple[ConstraintSet, ...]:
    rows: dict[str, list[Rows]] = {model: [] for model in CORNERS}
    makers = {"world": _to_world, "bodies": _to_body, "cloth": _to_cloth}
    for name, attachment in body_set.attachments.items():
        if not pins(attachment, body_set.names):
            model = _model_of(body_set, attachment)
            rows[model].append(makers[model](body_set, name, attachment))
    sets = []
    for model, some in rows.items():
        if some:
            corners, values = (np.concatenate(column) for column in zip(*some, strict=True))
            sets.append(coloured(KIND, model, corners, values, body_set.particle_count))
    return tuple(sets)


def check_attachments(body_set: TetrahedraSet) -> None:
    """Raise SceneError for an attachment without vertices."""
    for name, attachment in body_set.attachments.items():
        if not len(body_set.chosen(attachment.vertices, attachment.body)):
            raise SceneError(f"{name}.vertices", attachment.vertices, f"no vertex of {attachment.body} lies there")


def contact_free(body_set: TetrahedraSet) -> np.ndarray:
    """Return the particles that attach one body to another, or to a cloth, (particles,) bool.

    They coincide with it: contacts between bodies must ignore them, and the triangles of which they are corners.
    """
    free = np.zeros(body_set.particle_count, bool)
    for one in attachment_sets(body_set):
        if one.model != "world":
            free[one.corners] = True
    return free


def stored(body_set: TetrahedraSet, position: np.ndarray) -> float:
    """Return the energy [J] of compliant attachments at `position` (particles, 3)."""
    total = 0.0
    for one in attachment_sets(body_set):
        corners, compliance = np.asarray(position, np.float64)[one.corners], one.values[:, -1]
        there = one.values[:, :3]
        if one.model != "world":
            there = np.einsum("nk,nki->ni", one.values[:, :-1], corners[:, 1:])
        gives = compliance > 0
        total += float((((corners[:, 0] - there) ** 2).sum(axis=1)[gives] / compliance[gives]).sum() / 2)
    return total


def _to_world(body_set: TetrahedraSet, name: str, attachment: Attachment) -> Rows:
    vertices = body_set.chosen(attachment.vertices, attachment.body)
    places = body_set.position[vertices] if attachment.point is None else np.tile(attachment.point, (len(vertices), 1))
    return vertices[:, None].astype(np.int32), np.column_stack([places, np.full(len(vertices), attachment.compliance)])


def _to_body(body_set: TetrahedraSet, name: str, attachment: Attachment) -> Rows:
    vertices, number = body_set.chosen(attachment.vertices, attachment.body), body_set.names.index(attachment.to or "")
    start = int(body_set.first_particle[number])
    stop = [*body_set.first_particle[1:], body_set.particle_count][number]
    tetrahedra = body_set.tetrahedra[body_set.body == number]
    mesh = TetrahedralMesh(body_set.position[start:stop], tetrahedra - start)
    carried = carriers(mesh, body_set.position[vertices])
    _check_near(body_set, name, attachment, float(carried.beyond(mesh.position, mesh.tetrahedra).max()))
    corners = np.column_stack([vertices, tetrahedra[carried.tetrahedron]])
    return corners.astype(np.int32), np.column_stack([carried.weights, np.full(len(vertices), attachment.compliance)])


def _to_cloth(body_set: TetrahedraSet, name: str, attachment: Attachment) -> Rows:
    """Return the rows of attachments to a cloth: each vertex keeps its position relative to the nearest triangle.

    Its distance from the triangle at rest is removed by the constraint.
    """
    assert body_set.sheet is not None
    vertices, sheet = body_set.chosen(attachment.vertices, attachment.body), body_set.sheet
    points = body_set.position[vertices]
    number, weights, away = nearest_of(points, sheet.position[sheet.mesh.triangles])
    _check_near(body_set, name, attachment, float(away.max()))
    corners = np.column_stack([vertices, sheet.mesh.triangles[number] + body_set.first_particle[-1]])
    return corners.astype(np.int32), np.column_stack([weights, np.full(len(vertices), attachment.compliance)])


def _check_near(body_set: TetrahedraSet, name: str, attachment: Attachment, beyond: float) -> None:
    """Raise SceneError if a vertex is farther from its attachment [m] than a mean edge."""
    if beyond > body_set.spacing:
        reason = f"a vertex of {attachment.body} lies {beyond:.3g} m outside of it; attach vertices that touch it"
        raise SceneError(f"{name}.to", attachment.to, reason)
