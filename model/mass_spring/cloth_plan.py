"""The plan of a cloth's step (see model/core/plan.py)."""

from __future__ import annotations

from functools import partial

from softlab.model.contact.sheet_plan import Stages, cloth_parts
from softlab.model.core.integrators import IMPLICIT, INTEGRATORS
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas import colliders, implicit
from softlab.model.formulas import springs as spring_formulas
from softlab.model.mass_spring.plan import force_stages, stepped
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import SPRING_KINDS

SPRINGS_EACH = 4  # of a kind, on an interior mass
PRODUCT_STAGE = "product with the matrix, spring by spring"  # of implicit Euler


def kicks_coupled(parts: frozenset[str]) -> bool:
    """Return True if velocity Verlet's two adjacent kicks between steps may share one evaluation of the forces.

    Where no force depends on a neighbour's velocity they are the same. Wind and dampers along springs use the current
    velocity: the whole one in the first kick, the half-step one in the second (of first order in these parts). Sharing
    would give the first kick the half-step velocity too, except after a pause: then a state would depend on the
    division of a run into calls.
    """
    return not parts & {"wind", "structural-damping", "shear-damping", "bending-damping"}


def cloth_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of the mass-spring solver for a cloth. Numbers are per particle and axis, as in
    model/core/plan.py."""
    parts = cloth_parts(scene, live)
    integrator = scene.method.integrator
    springs = [kind for kind in SPRING_KINDS if kind in parts]
    dampers = [f"{kind}-damping" in parts for kind in springs]
    pull = spring_formulas.OPERATIONS_SPRING + 3
    operations = SPRINGS_EACH * (len(springs) * pull + sum(dampers) * spring_formulas.OPERATIONS_DAMPER)
    pulls = Stage("spring forces", 2 if any(dampers) else 1, 1, operations) if springs else None
    cost = sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders)
    touch = (Stage("collide", 2, 2, cost, 1.0),) if scene.colliders else ()

    def pins(offset: float) -> Stages:
        return (Stage("pins", 0, 0, 0, offset),) if "pins" in parts else ()

    if integrator in IMPLICIT:
        start_forces = force_stages(parts - {"damping"}, pulls, 3, 0.0)[1:]
        return _implicit_plan(integrator, parts, start_forces, operations, len(springs), (*touch, *pins(1.0)))
    acting = parts - {"damping"} if integrator == "velocity-verlet" else parts  # its damper is part of the kicks
    kick = 3 * INTEGRATORS[integrator].operations // 2
    forces = partial(force_stages, acting, pulls, 3)
    root, scalars = stepped(integrator, 3, forces, pins, (kick, kick), touch)
    return Plan(root, scalars, parts, dimensions=3)


def _implicit_plan(
    integrator: str, parts: frozenset[str], forces: tuple[Stage, ...], pulls: int, kinds: int, last: tuple[Stage, ...]
) -> Plan:
    """Return the plan of implicit Euler.

    `forces`: the forces at the step's start; `pulls`: operations of all springs of a mass; `kinds`: number of kinds of
    springs; `last`: stages after the new state. Residuals decide at run time how often its two inner nodes run: bytes
    and operations are of one pass each.
    """
    product = SPRINGS_EACH * kinds * (implicit.OPERATIONS_PRODUCT + 3) + 6 + 2 * implicit.OPERATIONS_DOT
    solve = Node(
        "conjugate gradients, until the residual is small enough",
        (Stage(PRODUCT_STAGE, 2, 1, product), Stage("update of the solution", 5, 4, 3 * implicit.OPERATIONS_UPDATE)),
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
        Node("forces at the start, but springs and dampers", forces), Stage("begin", 3, 3, 6), newton,
        Stage("take over", 2, 2, 0), *last,
    )  # fmt: skip
    return Plan(Node("step", children), 5 + 5 + 3 + 9 + 5 + 5, parts, dimensions=3)
