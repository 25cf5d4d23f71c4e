"""Checks of a scene's parts against its solver. Each raises SceneError with the accepted values."""

from __future__ import annotations

from softlab.model.base.errors import SceneError
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.cloth import CONSTRAINT_KINDS, SPRING_KINDS
from softlab.model.tables.kinds import KINDS
from softlab.model.tables.method import OF_FLUIDS, OF_WORLDS
from softlab.model.tables.method import OF_TETRAHEDRA as TETRAHEDRAL_SOLVERS
from softlab.model.tables.motion import RELEASE, check_inside, motions_of_pins
from softlab.model.tables.parts import Elastic
from softlab.model.tables.xpbd import XPBD_KINDS

OF_MESHES = tuple(kind for kind in CONSTRAINT_KINDS if kind not in SPRING_KINDS)
NOT_OF_MESHES = ("shear", "fold", "motion", "load", "self_collision")
TETRAHEDRAL_FIELDS = {"sleeping_speed": 0.0, "rows": "scalar"}  # of the method, with the values that have no effect
SOLVES = {  # solver -> (Scene.content that it is for, in words)
    OF_FLUIDS: ("fluids", "fluids")
} | {solver: ("tetrahedra", "tetrahedral bodies") for solver in TETRAHEDRAL_SOLVERS}
MATCHED = (  # supported by clusters
    "grid", "springs", "damping", "gravity", "external", "perturbation", "method", RELEASE,
)  # fmt: skip


def check_solver(scene: SceneParts) -> None:
    """Raise SceneError for a part that the scene's solver does not support."""
    solver, integrator = scene.method.solver, scene.method.integrator
    if scene.content == "world":  # its members are checked as scenes of their own
        return
    if solver == OF_WORLDS:
        reason = "applies to parts of several families, such as bodies beside tetrahedral ones"
        raise SceneError("method.solver", solver, reason)
    name = scene.name_of("method")
    for field, idle in TETRAHEDRAL_FIELDS.items():
        value = scene.value(f"{name}.{field}")
        if value != idle and scene.content != "tetrahedra":
            raise SceneError(f"method.{field}", value, "applies to tetrahedral bodies; leave it out")
    content, what = SOLVES.get(solver, (scene.content, ""))
    if content != scene.content:
        raise SceneError("method.solver", solver, f"applies to {what}; use mass-spring, xpbd, pbd or shape-matching")
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
        check_inside([load.at], scene.sheet, f"{name}.at")
    for check in CHECKS.get(scene.content, ()):
        check(scene)


def _check_matching(scene: SceneParts) -> None:
    """Raise SceneError for a part that the solver shape-matching does not support."""
    if not scene.method.matches_shapes:
        return
    if scene.cloth:
        raise SceneError(
            "method.solver", scene.method.solver, "applies to a grid; a cloth takes mass-spring, xpbd or pbd"
        )
    scene.refuse(KINDS.keys() - MATCHED, "is not supported by the solver shape-matching; leave it out")
    springs, name = scene.springs, scene.name_of("springs") or "springs"
    if springs is None:
        raise SceneError(
            name, None, "is needed by the solver shape-matching, whose clusters take their stiffness from it"
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
    if scene.mesh is None:
        scene.refuse(OF_MESHES, "applies to a mesh; a cloth and a grid are none, so leave it out")
        name, model = _bending(scene)
        if model != "distance":
            raise SceneError(f"{name}.model", model, "applies to a mesh; a cloth's bending is one of distances")
        return
    if not scene.method.position_based:
        raise SceneError("method.solver", scene.method.solver, "must be xpbd or pbd for a mesh")
    if scene.method.ordering != "gauss-seidel":
        raise SceneError("method.ordering", scene.method.ordering, "must be gauss-seidel for a mesh")
    for name, kind in scene.kinds.items():
        if kind in NOT_OF_MESHES:
            why = "a mesh's diagonals are edges, structural ones" if kind == "shear" else "a rectangular cloth has it"
            raise SceneError(f"{name}.kind", kind, f"is not supported for a mesh: {why}; leave it out")
    _check_bending(scene)


def _bending(scene: SceneParts) -> tuple[str, str]:
    """Return (name, model) of the bending of a cloth."""
    name = scene.name_of("bending") or "bending"
    return name, scene.value(f"{name}.model", "distance")


def _check_bending(scene: SceneParts) -> None:
    """Raise SceneError for a damper of a model of bending that has none."""
    name, model = _bending(scene)
    if model != "distance" and scene.cloth_springs["bending"].damping > 0:
        raise SceneError(
            f"{name}.damping", scene.cloth_springs["bending"].damping, f"must be 0 for the model {model}"
        )  # fmt: skip


def _check_self_collision(scene: SceneParts) -> None:
    """Raise SceneError if the thickness of self-collision exceeds the spacing of the sheet."""
    part = scene.self_collision
    if part is not None and part.thickness > scene.grid.spacing:
        raise SceneError(
            "self_collision.thickness", part.thickness,
            f"must be at most cloth.spacing, {scene.grid.spacing:g}: neighbours of the sheet are nearer to each "
            "other than that, and would be pushed apart forever",
        )  # fmt: skip


CHECKS = {  # by Scene.content
    "sheet": (_check_self_collision, _check_matching, _check_mesh),
    "tetrahedra": (_check_bending,),
}
