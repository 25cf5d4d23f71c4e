"""The plan of a position-based step on a mesh: constraints in compressed index arrays, by colours."""

from __future__ import annotations

from model.core.plan import Node, Plan, Stage
from model.formulas import colliders, distance, wind
from model.formulas import random as random_formulas
from model.mass_spring.cloth_plan import TRIANGLES_EACH
from model.scene.scene import Scene
from model.xpbd.mesh_constraints import OPERATIONS, Family, families
from model.xpbd.plan import xpbd_parts


def mesh_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """The parts that need code: a sheet's (model/xpbd/plan.py), and `bending-isometric` or `bending-dihedral`. Every mass
    has a weight of its own (`load`)."""
    parts = set(xpbd_parts(scene, live)) | {"load"}
    model = getattr(scene.cloth_springs.get("bending"), "model", "distance")
    if model != "distance":
        parts.add(f"bending-{model}")
    return frozenset(parts)


def stage_name(family: Family, colour: int) -> str:
    """Of the plan, for one colour of a family."""
    what = "edges" if family.kind == "structural" else f"{family.model} bending"
    return f"project {what} {colour}"


def operations_of(family: Family, parts: frozenset[str]) -> int:
    """Floating-point operations of one constraint."""
    if family.model != "distance":
        return OPERATIONS[family.model]
    soft = distance.OPERATIONS_SOFT if f"{family.kind}-compliance" in parts else distance.OPERATIONS_RIGID
    return soft + distance.OPERATIONS_DAMPER * (f"{family.kind}-damping" in parts)


def xpbd_mesh_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """The plan of a mesh: substeps and iterations as in model/xpbd/plan.py, all forces with the prediction."""
    parts, method = mesh_parts(scene, live), scene.method
    forces = 3 * distance.OPERATIONS_PREDICT + ("gravity" in parts)
    forces += (random_formulas.OPERATIONS + 3) * ("external" in parts)
    forces += TRIANGLES_EACH * (wind.OPERATIONS_TRIANGLE + 18) * ("wind" in parts)
    particles = scene.grid.particle_count
    colours: list[Stage] = []
    for family in families(scene):
        for number in range(family.colours):
            many = int(family.starts[number + 1] - family.starts[number])
            each = round(operations_of(family, parts) * many / particles)
            colours.append(Stage(stage_name(family, number), 1, 1, each))
    if "attachments" in parts and scene.attachments:
        colours.append(Stage("attachments", 1, 1, scene.attachments.anchors * distance.OPERATIONS_ATTACHMENT))
    stages: list[Node | Stage] = [
        Stage("predict", 2, 2, forces),
        Node("iteration", tuple(colours), method.iterations),
        Stage("update velocity", 2, 1, 3 * distance.OPERATIONS_UPDATE),
    ]
    if scene.colliders:
        touched = sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders)
        stages.append(Stage("collide", 2, 2, touched, 1.0))
    substep = Node("substep", tuple(stages), method.substeps)
    return Plan(Node("step", (substep,)), 4 * method.substeps, parts, dimensions=3)
