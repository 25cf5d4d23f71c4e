"""What does not go together in a scene: each check raises SceneError, with what would do."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from model.core.errors import SceneError
from model.fluid.flow import check_flow
from model.fluid.fluid_set import check_among_solids, check_fluids
from model.scene.attachment import check_attachment
from model.scene.bodies import BODY_KINDS
from model.scene.cloth import CLOTH_KINDS, COLLIDER_KINDS, CONSTRAINT_KINDS, SPRING_KINDS
from model.scene.members import OF_PARTICLES, SUBSTEPS, members_of
from model.scene.method import OF_FLUIDS, OF_WORLDS, Method
from model.scene.method import OF_TETRAHEDRA as TETRAHEDRAL_SOLVERS
from model.scene.motion import motions_of_pins
from model.scene.particle_contact import MAX_KINDS
from model.scene.parts import Elastic
from model.scene.scene_parts import KINDS, SceneParts
from model.scene.tetrahedra import TETRAHEDRAL_KINDS
from model.scene.xpbd import XPBD_KINDS
from model.tetrahedra.matter import check_material
from model.tetrahedra.selection import check_word

OF_MESHES = tuple(kind for kind in CONSTRAINT_KINDS if kind not in SPRING_KINDS)
NOT_OF_MESHES = ("shear", "fold", "motion", "load", "self_collision")
GRID_ONLY = ("springs", "manufactured")
MATCHED = ("grid", "springs", "damping", "gravity", "external", "perturbation", "method")  # by clusters of masses
SOLVERS_OF_TETRAHEDRA = ("xpbd", *TETRAHEDRAL_SOLVERS)
OF_TETRAHEDRA = (
    *TETRAHEDRAL_KINDS, "contact", "damping", "external", "gravity", "method", "motion", "region", "attachment", "material",
    "mesh", "wind", *(kind for kind in CONSTRAINT_KINDS if kind != "shear"), *COLLIDER_KINDS,
)  # fmt: skip
WITH_FLUIDS = ("fluid", "emitter", "sink", "domain", "foam", "gravity", "external", "method", *COLLIDER_KINDS)
OF_A_FLUID: dict[str, Any] = {"solver": OF_FLUIDS, "dt": 1 / 60, "substeps": 4, "iterations": 10}  # unless told
OF_BODIES = (*BODY_KINDS, "contact", "damping", "gravity", "method", *COLLIDER_KINDS)  # what goes with them


def check_fit(scene: SceneParts) -> None:
    """Raise SceneError for a part that belongs to the other kind of sheet."""
    if scene.is_world:
        _check_world(scene)
        return
    if scene.fluids:
        _check_fluids(scene)
        return
    _refuse(scene, ("domain", "emitter", "sink", "foam", "wetting"), "is for fluids; leave it out")
    if scene.tetrahedra:
        _check_tetrahedra(scene)
        return
    if scene.bodies:
        _check_bodies(scene)
        return
    _refuse(scene, ("region", "attachment", "material"), "is for tetrahedral bodies; leave it out")
    of_cloth = {*CLOTH_KINDS, *COLLIDER_KINDS, "self_collision"} - {"cloth", *OF_MESHES}
    _refuse(
        scene,
        GRID_ONLY if scene.cloth else of_cloth,
        f"belongs to a {'grid' if scene.cloth else 'cloth'}; a cloth has {', '.join(SPRING_KINDS)}, wind and colliders, a "
        f"grid has {', '.join(GRID_ONLY)}",
    )


def _refuse(scene: SceneParts, kinds: Collection[str], why: str) -> None:
    """Raise SceneError for the first part of one of the `kinds`."""
    for name, kind in scene.kinds.items():
        if kind in kinds:
            raise SceneError(f"{name}.kind", kind, why)


def _check_world(scene: SceneParts) -> None:
    """Raise SceneError for what does not go with a world: what no member knows, what one of them refuses."""
    method, wet = scene.one("method"), "fluid" in members_of(scene.kinds)
    if method is None:
        usual: dict[str, Any] = OF_A_FLUID if wet else {"substeps": SUBSTEPS}
        scene.parts["method"], scene.kinds["method"] = Method(**usual | {"solver": OF_WORLDS}), "method"
    elif method.solver != OF_WORLDS:
        told = f"must be {OF_WORLDS} where {' and '.join(members_of(scene.kinds))} are in one scene"
        raise SceneError("method.solver", method.solver, told)
    elif method.tetrahedra != "xpbd" and "tetrahedra" not in members_of(scene.kinds):
        raise SceneError("method.tetrahedra", method.tetrahedra, "is for tetrahedral bodies, of which here are none")
    elif wet:
        _take_untold(scene, method)
    for name, part in scene.all_of(*BODY_KINDS).items():
        if part.spare:
            raise SceneError(f"{name}.spare", part.spare, "bodies wait in scenes of bodies alone; leave it out")
    _refuse(scene, ("emitter", "sink"), "goes with fluids alone yet, without bodies; leave it out")
    members = scene.members  # made here, so that each is checked as a scene of its own
    if "fluid" in members:
        check_among_solids(members["fluid"])


def _check_fluids(scene: SceneParts) -> None:
    """Raise SceneError for what does not go with fluids, or not yet."""
    _refuse(scene, KINDS.keys() - WITH_FLUIDS, f"does not go with fluids yet, which have {', '.join(WITH_FLUIDS)}")
    check_fluids(scene.fluids, scene.domain, scene.name_of("domain"))
    method = scene.one("method")
    if method is None:
        scene.parts["method"], scene.kinds["method"] = Method(**OF_A_FLUID), "method"
    elif method.solver != OF_FLUIDS:
        raise SceneError("method.solver", method.solver, f"must be {OF_FLUIDS} for fluids")
    else:
        _take_untold(scene, method)
    check_flow(scene)


def _take_untold(scene: SceneParts, method: Method) -> None:
    """Give the method what fluids take, in the fields that the scene does not tell."""
    untold = {field: value for field, value in OF_A_FLUID.items() if field not in method.model_fields_set}
    scene.parts[scene.name_of("method")] = method.model_copy(update=untold)


def _check_bodies(scene: SceneParts) -> None:
    """Raise SceneError for what does not go with bodies."""
    _refuse(scene, KINDS.keys() - OF_BODIES, f"does not go with bodies, which have {', '.join(OF_BODIES)}")
    _check_contact(scene)
    method = scene.one("method")
    if method is None:
        scene.parts["method"], scene.kinds["method"] = Method(solver="shape-matching"), "method"
    elif not method.matches_shapes:
        raise SceneError("method.solver", method.solver, "must be shape-matching for bodies")


def _check_tetrahedra(scene: SceneParts) -> None:
    """Raise SceneError for what does not go with tetrahedral bodies, or not yet."""
    told = ", ".join(OF_TETRAHEDRA)
    _refuse(scene, KINDS.keys() - OF_TETRAHEDRA, f"does not go with tetrahedral bodies, which have {told}")
    for name, part in scene.tetrahedra.items():
        for word in part.pinned:
            check_word(f"{name}.pinned", word, scene.regions)
    for name, material in scene.materials.items():
        check_material(name, material, scene.tetrahedra, scene.regions)
    method = scene.one("method")
    if method is None:
        scene.parts["method"], scene.kinds["method"] = Method(solver="xpbd", substeps=SUBSTEPS), "method"
    elif method.solver not in SOLVERS_OF_TETRAHEDRA:
        told = " or ".join(SOLVERS_OF_TETRAHEDRA)
        raise SceneError("method.solver", method.solver, f"must be {told} for tetrahedral bodies")
    elif method.ordering != "gauss-seidel":
        raise SceneError("method.ordering", method.ordering, "must be gauss-seidel for tetrahedral bodies")
    colliders = dict(scene.all_of(*COLLIDER_KINDS))
    for name, held in scene.held_parts.items():
        check_attachment(name, held, scene.holdable, colliders)
        check_word(f"{name}.vertices", held.vertices, scene.regions)
    if scene.method.rows == "blocks":
        for name, part in scene.tetrahedra.items():
            if part.material == "neo-hookean":
                raise SceneError(
                    f"{name}.material", part.material, "has no blocks: its rows balance each other at rest"
                )
    for name, part in scene.tetrahedra.items():
        if part.volume == "voxels" and scene.method.solver not in ("xpbd", "world"):
            told = (
                f"goes with xpbd alone, and not with {scene.method.solver}: --set method.solver=xpbd, or leave it out"
            )
            raise SceneError(f"{name}.volume", part.volume, told)
    if scene.mesh and scene.method.solver != "xpbd":
        told = f"goes with tetrahedral bodies under xpbd alone, and not under {scene.method.solver}: "
        raise SceneError(f"{scene.name_of('mesh')}.kind", "mesh", told + "--set method.solver=xpbd, or leave it out")
    if not scene.mesh:
        _refuse(scene, CONSTRAINT_KINDS, "holds a cloth together: add one, a table [mesh], or leave it out")
        _refuse(scene, ("wind",), "blows on a cloth alone: add one, a table [mesh], or leave it out")
    _check_surfaces(scene)


MEETING = ("xpbd", "vbd")  # solvers under which tetrahedral bodies meet


def _check_surfaces(scene: SceneParts) -> None:
    """Raise SceneError for contacts that surfaces of tetrahedral bodies do not know, or a solver of them does not."""
    part, name = scene.contact, scene.name_of("contact", default="contact")
    if part is None:
        for body, of_body in scene.tetrahedra.items():
            if of_body.self_collision:
                raise SceneError(f"{body}.self_collision", True, "needs contacts: add a table [contact]")
        return
    if scene.method.solver not in MEETING:
        told = f"tetrahedral bodies meet under {' or '.join(MEETING)}; without a [contact] they pass through each other"
        raise SceneError(f"{name}.kind", "contact", f"is not known to the solver {scene.method.solver}: {told}")
    if len(scene.holdable) > MAX_KINDS:
        raise SceneError(name, len(scene.holdable), f"at most {MAX_KINDS} tetrahedral bodies that meet")
    for field in OF_PARTICLES:
        if getattr(part, field) != type(part).model_fields[field].default:
            raise SceneError(f"{name}.{field}", getattr(part, field), "is for bodies of particles; leave it out")


def check_solver(scene: SceneParts) -> None:
    """Raise SceneError for a part that the scene's solver does not know."""
    solver, integrator = scene.method.solver, scene.method.integrator
    if scene.is_world:  # whose members are checked
        return
    if solver == OF_WORLDS:
        told = "is for parts of several families, such as bodies beside tetrahedral ones"
        raise SceneError("method.solver", solver, told)
    if scene.method.sleeping_speed > 0 and not scene.tetrahedra:
        raise SceneError(
            "method.sleeping_speed", scene.method.sleeping_speed, "is for tetrahedral bodies; leave it out"
        )
    if scene.method.rows == "blocks" and not scene.tetrahedra:
        raise SceneError("method.rows", "blocks", "is for tetrahedral bodies; leave it out")
    if solver == OF_FLUIDS and not scene.fluids:
        raise SceneError("method.solver", solver, "is for fluids; take mass-spring, xpbd, pbd or shape-matching")
    if solver in TETRAHEDRAL_SOLVERS and not scene.tetrahedra:
        raise SceneError(
            "method.solver", solver, "is for tetrahedral bodies; take mass-spring, xpbd, pbd or shape-matching"
        )
    if not scene.cloth and not scene.method.position_based and integrator.startswith("implicit-euler"):
        raise SceneError(
            "method.integrator", integrator, "is for a cloth; a grid takes velocity-verlet, rk4 and other explicit ones"
        )  # fmt: skip
    for name, kind in scene.kinds.items():
        part = scene.parts[name]
        if scene.method.position_based:
            if kind == "manufactured":
                raise SceneError(f"{name}.kind", kind, f"belongs to the solver mass-spring, not to {solver}")
        elif kind in XPBD_KINDS:
            raise SceneError(
                f"{name}.kind", kind, "needs a position-based solver: --set method.solver=xpbd, or leave it out"
            )
        elif isinstance(part, Elastic) and part.inextensible:
            raise SceneError(
                f"{name}.compliance", 0.0,
                "must be greater than 0 for the solver mass-spring (an infinite stiffness); xpbd takes 0",
            )  # fmt: skip
    if scene.motions:
        motions_of_pins(scene.grid, scene.motions)  # refuses those of masses that are not pinned
    for name, load in scene.loads.items():
        row, column = load.at
        if row >= scene.grid.rows or column >= scene.grid.columns:
            raise SceneError(
                f"{name}.at", list(load.at),
                f"lies outside the sheet; rows are 0 to {scene.grid.rows - 1}, columns 0 to {scene.grid.columns - 1}",
            )  # fmt: skip

    _check_self_collision(scene)
    _check_matching(scene)
    _check_mesh(scene)


def _check_matching(scene: SceneParts) -> None:
    """Raise SceneError for what the solver shape-matching does not know."""
    if not scene.method.matches_shapes or scene.bodies:
        return
    if scene.cloth:
        raise SceneError("method.solver", scene.method.solver, "is for a grid; a cloth takes mass-spring, xpbd or pbd")
    _refuse(scene, KINDS.keys() - MATCHED, "is not known to the solver shape-matching; leave it out")
    springs, name = scene.springs, scene.name_of("springs", default="springs")
    if springs is None:
        raise SceneError(
            name, None, "must be there for the solver shape-matching: its clusters are as stiff as they are"
        )
    for field, value, allowed, fits in (
        ("compliance", springs.compliance, "greater than 0", not springs.inextensible),
        ("stiffness_ratio", springs.stiffness_ratio, "1", not springs.alternate),
        ("rest_length", springs.rest_length, "greater than 0", springs.rest_length > 0),
    ):
        if not fits:
            raise SceneError(f"{name}.{field}", value, f"must be {allowed} for the solver shape-matching")


def _check_mesh(scene: SceneParts) -> None:
    """Raise SceneError for what a mesh cannot have, and for what only a mesh has."""
    bending = scene.name_of("bending", default="bending")
    model = getattr(scene.cloth_springs.get("bending"), "model", "distance")
    if scene.mesh is None:
        _refuse(scene, OF_MESHES, "is for a mesh, which a cloth and a grid are not; leave it out")
        if model != "distance":
            raise SceneError(f"{bending}.model", model, "is for a mesh; a cloth's bending is one of distances")
        return
    if not scene.method.position_based:
        raise SceneError("method.solver", scene.method.solver, "must be xpbd or pbd for a mesh")
    if scene.method.ordering != "gauss-seidel":
        raise SceneError("method.ordering", scene.method.ordering, "must be gauss-seidel for a mesh")
    for name, kind in scene.kinds.items():
        if kind in NOT_OF_MESHES and not (kind == "motion" and scene.tetrahedra):
            why = "a mesh's diagonals are edges, structural ones" if kind == "shear" else "a rectangular cloth has it"
            raise SceneError(f"{name}.kind", kind, f"does not go with a mesh: {why}; leave it out")
    if model != "distance" and scene.cloth_springs["bending"].damping > 0:
        raise SceneError(
            f"{bending}.damping", scene.cloth_springs["bending"].damping, f"must be 0 for the model {model}"
        )  # fmt: skip


def _check_contact(scene: SceneParts) -> None:
    """Raise SceneError where bodies ask for contacts that the scene does not have, or has too many kinds of."""
    if scene.contact is not None and len(scene.bodies) > MAX_KINDS:
        raise SceneError("contact", len(scene.bodies), f"at most {MAX_KINDS} kinds of bodies; use copies")
    if scene.contact is not None and scene.contact.distance is not None:
        told = "is between tetrahedral bodies; particles have a radius"
        raise SceneError(f"{scene.name_of('contact')}.distance", scene.contact.distance, told)
    for name, body in scene.bodies.items():
        if scene.contact is None:
            for field in ("group", "avoids", "adhesion", "self_collision", "radius"):
                if field in body.model_fields_set and getattr(body, field) not in (None, 0, ()):
                    raise SceneError(f"{name}.{field}", getattr(body, field), "needs contacts: add a table [contact]")


def _check_self_collision(scene: SceneParts) -> None:
    """Raise SceneError where the sheet cannot keep the thickness."""
    part = scene.self_collision
    if part is not None and part.thickness > scene.grid.spacing:
        raise SceneError(
            "self_collision.thickness", part.thickness,
            f"must be at most cloth.spacing, {scene.grid.spacing:g}: neighbours of the sheet are nearer to each other than "
            "that, and would be driven apart for ever",
        )  # fmt: skip
