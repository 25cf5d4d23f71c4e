"""The plan of a cloth's step: which stages a scene in three dimensions consists of (see model/core/plan.py)."""

from __future__ import annotations

from model.core.integrators import IMPLICIT
from model.core.plan import Node, Plan, Stage
from model.formulas import colliders, implicit, wind
from model.formulas import integrators as integrator_formulas
from model.formulas import random as random_formulas
from model.formulas import springs as spring_formulas
from model.scene.motion import motions_of_pins
from model.scene.scene import Scene

SPRINGS_EACH = 4  # of a kind, on a mass inside
TRIANGLES_EACH = 6  # that a mass is a corner of
PRODUCT_STAGE = "product with the matrix, spring by spring"  # of implicit Euler


def cloth_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """The parts that need code: those of the scene that do anything, and those that may be switched on live."""
    parts = set()
    for kind, springs in scene.cloth_springs.items():
        parts.add(kind)
        if springs.damping > 0:
            parts.add(f"{kind}-damping")
    if (scene.damping and scene.damping.coefficient > 0) or "damping" in live:
        parts.add("damping")
    gravity = scene.gravity
    if (gravity and gravity.enabled and gravity.acceleration > 0) or "gravity" in live:
        parts.add("gravity")
    if scene.wind and (scene.wind.drag > 0 or scene.wind.lift > 0):
        parts.add("wind")
        if scene.wind.gust > 0:
            parts.add("gust")
    if scene.external and scene.external.magnitude > 0:
        parts.add("external")
    if "poke" in live:
        parts.add("poke")
    if scene.grid.pinned not in ("none", []):
        parts.add("pins")
    if scene.motions:
        motions_of_pins(scene.grid, scene.motions)  # refuses those of masses that are not pinned
        if any(part.moves for part in scene.motions.values()):
            parts.add("motion")
    for kind, collider in scene.colliders:
        parts.add(kind)
        if collider.static_friction > 0:
            parts.add("friction")
        if collider.restitution > 0:
            parts.add("restitution")
    return frozenset(parts)


def kicks_meet(parts: frozenset[str]) -> bool:
    """Whether velocity Verlet's two kicks that meet between steps may share one evaluation of the forces.

    Where no force depends on a neighbour's velocity they are the same. Wind and dampers along springs are evaluated with
    the velocity at hand: the whole one in the first kick, the half-step one in the second (of first order in these parts).
    Sharing would give the first kick the half-step velocity too, except after a pause: then a state would depend on
    whether a run was made in one go or in two.
    """
    return not parts & {"wind", "structural-damping", "shear-damping", "bending-damping"}


def cloth_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """The plan of the mass-spring solver for a cloth. Numbers are per particle and axis, as in model/core/plan.py."""
    parts = cloth_parts(scene, live)
    integrator = scene.method.integrator
    verlet = integrator == "velocity-verlet"
    springs = [kind for kind in ("structural", "shear", "bending") if kind in parts]
    operations = sum(
        SPRINGS_EACH
        * (spring_formulas.OPERATIONS_SPRING + spring_formulas.OPERATIONS_DAMPER * (f"{kind}-damping" in parts) + 3)
        for kind in springs
    )
    damped_springs = any(f"{kind}-damping" in parts for kind in springs)

    def forces(offset: float) -> tuple[Stage, ...]:
        stages = []
        if springs:
            stages.append(Stage("spring forces", 2 if damped_springs else 1, 1, operations))
        else:
            stages.append(Stage("no forces", 0, 1, 0))
        if "gravity" in parts:
            stages.append(Stage("gravity", 1, 1, 1))
        if "wind" in parts:
            each = wind.OPERATIONS_TRIANGLE + 18  # the mean velocity of its corners
            stages.append(Stage("wind", 3, 1, TRIANGLES_EACH * each, offset))
        if "external" in parts:
            stages.append(Stage("external force", 1, 1, random_formulas.OPERATIONS))
        if "poke" in parts:
            stages.append(Stage("poke", 0, 0, 0))
        if "damping" in parts and not verlet:
            stages.append(Stage("damping", 2, 1, 6))
        return tuple(stages)

    bodies = scene.colliders
    cost = sum(colliders.OPERATIONS[kind] for kind, _ in bodies)
    touch = (Stage("collide", 2, 2, cost, 1.0),) if bodies else ()

    def pins(offset: float) -> tuple[Stage, ...]:
        return (Stage("pins", 0, 0, 0, offset),) if "pins" in parts else ()

    if integrator in IMPLICIT:
        own = tuple(stage for stage in forces(0.0) if stage.name not in ("spring forces", "no forces", "damping"))
        return _implicit_plan(integrator, parts, own, operations, len(springs), (*touch, *pins(1.0)))
    per_axis = integrator_formulas.OPERATIONS[integrator]
    if verlet:
        children: tuple[Node | Stage, ...] = (
            Node("forces at the start", forces(0.0)),
            Stage("first half kick and drift", 3, 2, 3 * per_axis // 2),
            *touch,
            *pins(1.0),
            Node("forces at the end", forces(1.0)),
            Stage("second half kick", 2, 1, 3 * per_axis // 2),
            *pins(1.0),
        )
        scalars = 4
    elif integrator == "rk4":
        steps: list[Node | Stage] = []
        for stage, (offset, end) in enumerate(((0.0, 0.5), (0.5, 0.5), (0.5, 1.0), (1.0, 1.0)), start=1):
            last = touch if stage == 4 else ()
            body = (*forces(offset), Stage(f"accumulate (rk4 {stage})", 7, 4, 3 * per_axis // 4), *last, *pins(end))
            steps.append(Node(f"stage {stage}", body))
        children = tuple(steps)
        scalars = 4 * 10
    else:
        children = (*forces(0.0), Stage(f"integrate ({integrator})", 3, 2, 3 * per_axis), *touch, *pins(1.0))
        scalars = 4
    return Plan(Node("step", children), scalars, parts, dimensions=3)


def _implicit_plan(
    integrator: str, parts: frozenset[str], own: tuple[Stage, ...], pulls: int, kinds: int, last: tuple[Stage, ...]
) -> Plan:
    """The plan of implicit Euler. `own`: the forces at the step's start; `pulls`: operations of all springs of a mass;
    `kinds`: of springs; `last`: what follows the new state.

    How often its two inner nodes run is decided by residuals while it runs: bytes and operations are of one each.
    """
    product = SPRINGS_EACH * kinds * (implicit.OPERATIONS_PRODUCT + 3) + 6 + 2 * implicit.OPERATIONS_DOT
    solve = Node(
        "conjugate gradients, until the residual is small enough",
        (
            Stage(PRODUCT_STAGE, 2, 1, product),
            Stage("update of the solution", 5, 4, 3 * implicit.OPERATIONS_UPDATE),
        ),
    )
    residual = Stage("spring forces at the step's end, residual", 4, 1, pulls + 15 + 4 * implicit.OPERATIONS_DOT, 1.0)
    once = integrator == "implicit-euler-linear"
    newton = Node(
        "one linearised step (Baraff and Witkin)"
        if once
        else "Newton's method, until the residual is 1e-8 of the first",
        (residual, solve, Stage("move", 3, 2, 12)),
    )
    children: tuple[Node | Stage, ...] = (
        Node("forces at the start, but springs and dampers", own), Stage("begin", 3, 3, 6), newton,
        Stage("take over", 2, 2, 0), *last,
    )  # fmt: skip
    return Plan(Node("step", children), 5 + 5 + 3 + 9 + 5 + 5, parts, dimensions=3)
