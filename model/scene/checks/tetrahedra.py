"""Checks of the parts together with tetrahedral bodies, and of their contacts. Each raises SceneError with the accepted
values."""

from __future__ import annotations

from collections.abc import Mapping

from softlab.model.base.errors import SceneError
from softlab.model.base.words import suggestion
from softlab.model.scene.members import OF_PARTICLES
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.attachment import check_attachment
from softlab.model.tables.cloth import COLLIDER_KINDS, CONSTRAINT_KINDS, Collider
from softlab.model.tables.kinds import KINDS
from softlab.model.tables.method import OF_TETRAHEDRA as TETRAHEDRAL_SOLVERS
from softlab.model.tables.motion import RELEASE
from softlab.model.tables.particle_contact import MAX_KINDS
from softlab.model.tables.regions import Region
from softlab.model.tables.selection import check_word
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS, Material, TetrahedralBody

SOLVERS_OF_TETRAHEDRA = ("xpbd", *TETRAHEDRAL_SOLVERS)
OF_TETRAHEDRA = (
    *TETRAHEDRAL_KINDS, "contact", "damping", "external", "gravity", "method", "motion", "region", "attachment", "material",
    "mesh", "wind", RELEASE, *(kind for kind in CONSTRAINT_KINDS if kind != "shear"), *COLLIDER_KINDS,
)  # fmt: skip
UNSTEADY = (*COLLIDER_KINDS, "motion")  # not supported by order 2 in time
NOT_SMOOTH = "is not smooth, which newton's second order in time requires"
MEETING = ("xpbd", "vbd")  # solvers that support contacts of tetrahedral bodies


def check_tetrahedra(scene: SceneParts) -> None:
    """Raise SceneError for a part that is not (yet) supported together with tetrahedral bodies."""
    known = ", ".join(OF_TETRAHEDRA)
    scene.refuse(KINDS.keys() - OF_TETRAHEDRA, f"is not supported together with tetrahedral bodies, which take {known}")
    for name, part in scene.tetrahedra.items():
        for word in part.pinned:
            check_word(f"{name}.pinned", word, scene.regions)
    for name, material in scene.materials.items():
        check_material(name, material, scene.tetrahedra, scene.regions)
    method = scene.method
    if method.solver not in SOLVERS_OF_TETRAHEDRA:
        reason = " or ".join(SOLVERS_OF_TETRAHEDRA)
        raise SceneError("method.solver", method.solver, f"must be {reason} for tetrahedral bodies")
    if method.ordering != "gauss-seidel":
        raise SceneError("method.ordering", method.ordering, "must be gauss-seidel for tetrahedral bodies")
    colliders = scene.parts_of(Collider)
    for name, attachment in scene.attachment_parts.items():
        check_attachment(name, attachment, scene.holdable, colliders)
        check_word(f"{name}.vertices", attachment.vertices, scene.regions)
    if scene.method.order > 1:
        scene.refuse(UNSTEADY, f"{NOT_SMOOTH}: --set method.order=1, or leave it out")
    if scene.method.rows == "blocks":
        for name, part in scene.tetrahedra.items():
            if part.material == "neo-hookean":
                raise SceneError(
                    f"{name}.material",
                    part.material,
                    "has no blocks: its scalar rows converge without; --set method.rows=scalar, or leave it out",
                )
    for name, part in scene.tetrahedra.items():
        if part.volume == "voxels" and scene.method.solver not in ("xpbd", "world"):
            reason = (
                f"is supported by xpbd only, not by {scene.method.solver}: --set method.solver=xpbd, or leave it out"
            )
            raise SceneError(f"{name}.volume", part.volume, reason)
    if scene.mesh and scene.method.solver != "xpbd":
        reason = f"is supported beside tetrahedral bodies by xpbd only, not by {scene.method.solver}: "
        raise SceneError(f"{scene.name_of('mesh')}.kind", "mesh", reason + "--set method.solver=xpbd, or leave it out")
    if not scene.mesh:
        scene.refuse(CONSTRAINT_KINDS, "applies to a cloth; add a table [mesh], or leave it out")
        scene.refuse(("wind",), "applies to a cloth; add a table [mesh], or leave it out")
    _check_surfaces(scene)


def unsteady(scene: SceneParts) -> list[str]:
    """Return the names of the parts that order 2 does not support."""
    return [name for name, kind in scene.kinds.items() if kind in UNSTEADY]


def _check_surfaces(scene: SceneParts) -> None:
    """Raise SceneError for contacts that surfaces of tetrahedral bodies, or their solver, do not support."""
    part, name = scene.contact, scene.name_of("contact") or "contact"
    if part is None:
        for body, of_body in scene.tetrahedra.items():
            if of_body.self_collision:
                raise SceneError(f"{body}.self_collision", True, "needs contacts: add a table [contact]")
        return
    if scene.method.solver not in MEETING:
        reason = (
            f"contacts of tetrahedral bodies are supported by {' or '.join(MEETING)}; without a [contact] they pass "
            "through each other"
        )
        raise SceneError(f"{name}.kind", "contact", f"is not supported by the solver {scene.method.solver}: {reason}")
    if len(scene.holdable) > MAX_KINDS:
        raise SceneError(name, len(scene.holdable), f"at most {MAX_KINDS} tetrahedral bodies that meet")
    for field in OF_PARTICLES:
        if getattr(part, field) != type(part).model_fields[field].default:
            raise SceneError(f"{name}.{field}", getattr(part, field), "applies to bodies of particles; leave it out")


def check_material(
    name: str, part: Material, bodies: Mapping[str, TetrahedralBody], regions: Mapping[str, Region]
) -> None:
    """Raise SceneError for a body or a region that does not exist."""
    for field, value, known in (("region", part.region, regions), ("body", part.body, bodies)):
        if value is not None and value not in known:
            reason = (
                f"must be one of {', '.join(known)}{suggestion(value, known)}"
                if known
                else "there is none in the scene"
            )
            raise SceneError(f"{name}.{field}", value, reason)
