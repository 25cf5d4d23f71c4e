"""The plan of a position-based step on a mesh: constraints in compressed index arrays, by colours."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE, WIND
from softlab.model.core.own_forces import particle_forces
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas import colliders, contact, distance
from softlab.model.particles.constraints import ConstraintSet
from softlab.model.position_based.mesh_constraints import (
    constraint_sets,
    model_of,
    operations_of,
    projection_of,
    wanted,
)
from softlab.model.position_based.plan import LOOKED_AT, xpbd_parts
from softlab.model.scene.scene import Scene

BODY_DAMPING = "body-damping"  # a part: bodies have their own damping rates
PREDICT, UPDATE, COLLIDE = "predict", "update velocity", "collide"  # stages
FIND_CONTACTS, PROJECT_CONTACTS = "find contacts", "project contacts"  # stages of contacts of surfaces
TOUCHING = "colliders-in-iterations"  # a part: colliders act before each iteration, too
TOUCH, RELEASE = "touch colliders", "release colliders"  # its stages
PINS = Stage("pins", 0, 0, 0, 1.0)  # following a motion: their position and velocity at a substep's end


def mesh_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts that need code: a sheet's (model/position_based/plan.py), and each constraint's model, as
    `bending-isometric`.

    Every mass has its own weight (`load`).
    """
    parts = xpbd_parts(scene, live) | {"load"} | model_parts(scene)
    if "attachments" in parts and scene.attachments:
        parts |= {f"attachments-{scene.attachments.anchors}"}
    return parts


def model_parts(scene: Scene) -> frozenset[str]:
    """Return the models of constraints, for kinds with several models."""
    return frozenset(f"{kind}-{model}" for kind, model in wanted(scene) if model != model_of(kind))


def with_friction_in_place(parts: frozenset[str]) -> frozenset[str]:
    """Return the parts with friction of colliders on positions, where there is friction.

    Friction on velocities alone would leave the displacement of a touching vertex along a collider by constraints
    within a substep, so that sticking bodies would creep.
    """
    return parts | {FRICTION_IN_PLACE} if "friction" in parts else parts


def with_touching(scene: Scene, parts: frozenset[str]) -> frozenset[str]:
    """Return the parts with colliders that act before each of several iterations, so that these converge to a step in
    which constraints and contacts hold together."""
    return parts | {TOUCHING} if scene.colliders and scene.method.iterations > 1 else parts


def stage_name(kind: str, model: str, colour: int) -> str:
    """Return the name of a plan's stage for one colour of a set of constraints."""
    if kind == "attachments":
        return "attachments"
    return f"project {'edges' if kind == 'structural' else kind if kind == model else f'{model} {kind}'} {colour}"


def xpbd_mesh_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of a mesh."""
    parts = with_friction_in_place(mesh_parts(scene, live))
    return constrained_plan(
        scene, parts, [(one, operations_of(projection_of(one.kind, parts))) for one in constraint_sets(scene)]
    )


def constrained_plan(scene: Scene, parts: frozenset[str], sets: Sequence[tuple[ConstraintSet, int]]) -> Plan:
    """Return the plan of particles with sets of constraints, each with the operations of one constraint.

    Substeps and iterations are as in model/position_based/plan.py, all forces are part of the prediction.
    """
    method = scene.method
    forces = 3 * distance.OPERATIONS_PREDICT + ("gravity" in parts)
    forces += sum(force.operations + 3 for force in particle_forces(parts) if force.operations)
    forces += WIND * ("wind" in parts)
    particles = scene.grid.particle_count
    colours: list[Stage] = []
    for rows, operations in sets:
        for number in range(rows.colours):
            many = int(rows.starts[number + 1] - rows.starts[number])
            colours.append(Stage(stage_name(rows.kind, rows.model, number), 1, 1, round(operations * many / particles)))
    if "attachments" in parts and scene.attachments:
        operations = scene.attachments.anchors * distance.OPERATIONS_ATTACHMENT
        colours.append(Stage(stage_name("attachments", "tether", 0), 1, 1, operations))
    pins = (PINS,) if "motion" in parts else ()
    search: list[Stage] = []
    touched = sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders)
    touched += len(scene.colliders) * colliders.OPERATIONS_SLID * (FRICTION_IN_PLACE in parts)
    released: tuple[Stage, ...] = ()
    if TOUCHING in parts:
        colours.insert(0, Stage(TOUCH, 3, 2, touched + 3 * (2 + distance.OPERATIONS_UPDATE), 1.0))
        released = (Stage(RELEASE, 2, 1, 3),)
    if scene.contact:  # of surfaces
        search.append(Stage(FIND_CONTACTS, 3, 2, LOOKED_AT * contact.OPERATIONS_NEAREST))
        colours.append(Stage(PROJECT_CONTACTS, 2, 1, scene.contact.sweeps * contact.OPERATIONS_CONTACT))
    stages: list[Node | Stage] = [
        Stage(PREDICT, 2, 2, forces),
        *pins,
        *search,
        Node("iteration", tuple(colours), method.iterations),
        *released,
        Stage(UPDATE, 2, 1, 3 * distance.OPERATIONS_UPDATE),
        *pins,
    ]
    if scene.colliders:
        stages.append(Stage(COLLIDE, 2, 2, touched, 1.0))
    substep = Node("substep", tuple(stages), method.substeps)
    return Plan(Node("step", (substep,)), 4 * method.substeps, parts, dimensions=3)
