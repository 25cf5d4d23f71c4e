"""Checks of a scene's parts against its solver. Each raises SceneError, with what would be accepted."""

from __future__ import annotations

from softlab.model.core.errors import SceneError
from softlab.model.scene.cloth import CONSTRAINT_KINDS, SPRING_KINDS
from softlab.model.scene.kinds import KINDS
from softlab.model.scene.method import OF_FLUIDS, OF_WORLDS
from softlab.model.scene.method import OF_TETRAHEDRA as TETRAHEDRAL_SOLVERS
from softlab.model.scene.motion import RELEASE, check_inside, motions_of_pins
from softlab.model.scene.parts import Elastic
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.scene.xpbd import XPBD_KINDS

OF_MESHES = tuple(kind for kind in CONSTRAINT_KINDS if kind not in SPRING_KINDS)
NOT_OF_MESHES = ("shear", "fold", "motion", "load", "self_collision")
MATCHED = (  # supported by clusters
    "grid", "springs", "damping", "gravity", "external", "perturbation", "method", RELEASE,
)  # fmt: skip


def check_solver(scene: SceneParts) -> None:
    """Raise SceneError for a part that the scene's solver does not support."""
    solver, integrator = scene.method.solver, scene.method.integrator
    if scene.is_world:  # its members are checked as scenes of their own
        return
    if solver == OF_WORLDS:
        reason = "applies to parts of several families, such as bodies beside tetrahedral ones"
        raise SceneError("method.solver", solver, reason)
    if scene.method.sleeping_speed > 0 and not scene.tetrahedra:
        raise SceneError(
            "method.sleeping_speed", scene.method.sleeping_speed, "applies to tetrahedral bodies; leave it out"
        )
    if scene.method.rows == "blocks" and not scene.tetrahedra:
        raise SceneError("method.rows", "blocks", "applies to tetrahedral bodies; leave it out")
    if solver == OF_FLUIDS and not scene.fluids:
        raise SceneError("method.solver", solver, "applies to fluids; use mass-spring, xpbd, pbd or shape-matching")
    if solver in TETRAHEDRAL_SOLVERS and not scene.tetrahedra:
        raise SceneError(
            "method.solver", solver, "applies to tetrahedral bodies; use mass-spring, xpbd, pbd or shape-matching"
        )
    if not scene.cloth and not scene.method.position_based and integrator.startswith("implicit-euler"):
        raise SceneError(
            "method.integrator", integrator, "applies to a cloth; a grid takes velocity-verlet, rk4 and other explicit ones"
        )  # fmt: skip
    for name, kind in scene.kinds.items():
        part = scene.parts[name]
        if scene.method.position_based:
            continue
        if kind in XPBD_KINDS:
            raise SceneError(
                f"{name}.kind", kind, "needs a position-based solver: --set method.solver=xpbd, or leave it out"
            )
        elif isinstance(part, Elastic) and part.inextensible:
            raise SceneError(
                f"{name}.compliance", 0.0,
                "must be greater than 0 for the solver mass-spring (an infinite stiffness); xpbd takes 0",
            )  # fmt: skip
    if scene.motions:
        motions_of_pins(scene.grid, scene.motions)  # refuses motions of masses that are not pinned
    for name, load in scene.loads.items():
        check_inside([load.at], scene.grid, f"{name}.at")

    _check_self_collision(scene)
    _check_matching(scene)
    _check_mesh(scene)


def _check_matching(scene: SceneParts) -> None:
    """Raise SceneError for a part that the solver shape-matching does not support."""
    if not scene.method.matches_shapes or scene.bodies:
        return
    if scene.cloth:
        raise SceneError(
            "method.solver", scene.method.solver, "applies to a grid; a cloth takes mass-spring, xpbd or pbd"
        )
    scene.refuse(KINDS.keys() - MATCHED, "is not supported by the solver shape-matching; leave it out")
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
    """Raise SceneError for a part that a mesh does not support, and for one that only a mesh supports."""
    bending = scene.name_of("bending", default="bending")
    model = getattr(scene.cloth_springs.get("bending"), "model", "distance")
    if scene.mesh is None:
        scene.refuse(OF_MESHES, "applies to a mesh; a cloth and a grid are none, so leave it out")
        if model != "distance":
            raise SceneError(f"{bending}.model", model, "applies to a mesh; a cloth's bending is one of distances")
        return
    if not scene.method.position_based:
        raise SceneError("method.solver", scene.method.solver, "must be xpbd or pbd for a mesh")
    if scene.method.ordering != "gauss-seidel":
        raise SceneError("method.ordering", scene.method.ordering, "must be gauss-seidel for a mesh")
    for name, kind in scene.kinds.items():
        if kind in NOT_OF_MESHES and not (kind == "motion" and scene.tetrahedra):
            why = "a mesh's diagonals are edges, structural ones" if kind == "shear" else "a rectangular cloth has it"
            raise SceneError(f"{name}.kind", kind, f"is not supported for a mesh: {why}; leave it out")
    if model != "distance" and scene.cloth_springs["bending"].damping > 0:
        raise SceneError(
            f"{bending}.damping", scene.cloth_springs["bending"].damping, f"must be 0 for the model {model}"
        )  # fmt: skip


def _check_self_collision(scene: SceneParts) -> None:
    """Raise SceneError where the sheet cannot keep the thickness."""
    part = scene.self_collision
    if part is not None and part.thickness > scene.grid.spacing:
        raise SceneError(
            "self_collision.thickness", part.thickness,
            f"must be at most cloth.spacing, {scene.grid.spacing:g}: neighbours of the sheet are nearer to each other than "
            "that, and would be driven apart for ever",
        )  # fmt: skip
