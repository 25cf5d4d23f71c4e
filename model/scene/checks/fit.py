"""Checks of a scene's parts against each other. Each raises SceneError with the accepted values."""

from __future__ import annotations

from softlab.model.base.errors import SceneError
from softlab.model.scene.checks.flow import check_flow
from softlab.model.scene.checks.fluids import check_among_solids, check_fluids
from softlab.model.scene.checks.solver import OF_MESHES
from softlab.model.scene.checks.tetrahedra import check_tetrahedra
from softlab.model.scene.members import members_of
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.bodies import BODY_KINDS, Placed
from softlab.model.tables.cloth import CLOTH_KINDS, COLLIDER_KINDS, SPRING_KINDS
from softlab.model.tables.kinds import KINDS
from softlab.model.tables.method import OF_FLUIDS, OF_WORLDS
from softlab.model.tables.particle_contact import MAX_KINDS

GRID_ONLY = ("springs",)
FLUIDS_ONLY = ("domain", "emitter", "sink", "foam")
NO_FLUID = "applies to fluids; leave it out"
WITH_FLUIDS = ("fluid", "emitter", "sink", "domain", "foam", "gravity", "external", "method", *COLLIDER_KINDS)
OF_BODIES = (*BODY_KINDS, "contact", "damping", "gravity", "method", *COLLIDER_KINDS)  # supported together with bodies


def check_fit(scene: SceneParts) -> None:
    """Raise SceneError for a part that the scene's kind of particles does not support."""
    CHECKS[scene.content](scene)


def check_members(scene: SceneParts) -> None:
    """Build the members of a world, which checks each as a scene of its own. Raises SceneError."""
    if "fluid" in scene.members:
        check_among_solids(scene.members["fluid"])


def _check_sheet(scene: SceneParts) -> None:
    """Raise SceneError for a part that a grid, or a cloth, does not support."""
    scene.refuse(FLUIDS_ONLY, NO_FLUID)
    scene.refuse(("region", "attachment", "material"), "applies to tetrahedral bodies; leave it out")
    of_cloth = {*CLOTH_KINDS, *COLLIDER_KINDS, "self_collision"} - {"cloth", *OF_MESHES}
    refused, owner = (GRID_ONLY, "grid") if scene.cloth else (of_cloth, "cloth")
    scene.refuse(
        refused,
        f"belongs to a {owner}; a cloth has {', '.join(SPRING_KINDS)}, wind and colliders, a grid has {', '.join(GRID_ONLY)}",
    )


def _check_tetrahedra(scene: SceneParts) -> None:
    scene.refuse(FLUIDS_ONLY, NO_FLUID)
    check_tetrahedra(scene)


def _check_world(scene: SceneParts) -> None:
    """Raise SceneError for a part that a world does not support: one that no member knows, or that one of them
    refuses."""
    method = scene.method
    if method.solver != OF_WORLDS:
        reason = f"must be {OF_WORLDS} where {' and '.join(members_of(scene.kinds))} are in one scene"
        raise SceneError("method.solver", method.solver, reason)
    if method.tetrahedra != "xpbd" and "tetrahedra" not in members_of(scene.kinds):
        raise SceneError("method.tetrahedra", method.tetrahedra, "applies to tetrahedral bodies; this scene has none")
    for name, part in scene.parts_of(Placed).items():
        if part.spare:
            raise SceneError(
                f"{name}.spare", part.spare, "spare copies are supported in scenes of bodies only; leave it out"
            )
    scene.refuse(("emitter", "sink"), "is not supported together with bodies; leave it out")


def _check_fluids(scene: SceneParts) -> None:
    """Raise SceneError for a part that is not (yet) supported together with fluids."""
    reason = f"is not supported together with fluids, which take {', '.join(WITH_FLUIDS)}"
    scene.refuse(KINDS.keys() - WITH_FLUIDS, reason)
    check_fluids(scene.fluids, scene.domain, scene.name_of("domain"))
    if scene.method.solver != OF_FLUIDS:
        raise SceneError("method.solver", scene.method.solver, f"must be {OF_FLUIDS} for fluids")
    check_flow(scene)


def _check_bodies(scene: SceneParts) -> None:
    """Raise SceneError for a part that is not supported together with bodies."""
    scene.refuse(FLUIDS_ONLY, NO_FLUID)
    scene.refuse(KINDS.keys() - OF_BODIES, f"is not supported together with bodies, which take {', '.join(OF_BODIES)}")
    _check_contact(scene)
    if not scene.method.matches_shapes:
        raise SceneError("method.solver", scene.method.solver, "must be shape-matching for bodies")


def _check_contact(scene: SceneParts) -> None:
    """Raise SceneError where bodies need contacts that the scene does not have, or there are too many kinds of
    bodies."""
    if scene.contact is not None and len(scene.bodies) > MAX_KINDS:
        raise SceneError("contact", len(scene.bodies), f"at most {MAX_KINDS} kinds of bodies; use copies")
    if scene.contact is not None and scene.contact.distance is not None:
        reason = "applies to tetrahedral bodies; particles have a radius"
        raise SceneError(f"{scene.name_of('contact')}.distance", scene.contact.distance, reason)
    for name, body in scene.bodies.items():
        if scene.contact is None:
            for field in ("group", "avoids", "adhesion", "self_collision", "radius"):
                if field in body.model_fields_set and getattr(body, field) not in (None, 0, ()):
                    raise SceneError(f"{name}.{field}", getattr(body, field), "needs contacts: add a table [contact]")


CHECKS = {
    "world": _check_world,
    "fluids": _check_fluids,
    "tetrahedra": _check_tetrahedra,
    "bodies": _check_bodies,
    "sheet": _check_sheet,
}
