"""The plan of a position-based step, and the constraint families of a sheet: their positions and colours."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.model.contact.sheet_plan import WIND, Stages, cloth_parts, particle_force_stages
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas import colliders, contact, distance
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Elastic

JACOBI = frozenset({"jacobi", "averaged-jacobi"})  # orderings: all constraints at one position
LOOKED_AT = 4  # triangles against which a mass of a cloth in a few layers is tested


@dataclass(frozen=True)
class Family:
    """Constraints with one direction over the sheet, from the first mass (i, j) to (i + rows, j + columns).

    The family of (1, -1) is indexed by (i, j), too, and extends from (i, j + 1) to (i + 1, j): the first mass is the
    upper one. No two of a colour share a mass: the colour is (i // rows) % 2, or (j // columns) % 2 where a family
    extends along rows. `colours`: the positions of its two colours in the order of all.
    """

    name: str
    kind: str
    rows: int
    columns: int
    colours: tuple[int, int]


FAMILIES = (
    Family("vertical", "structural", 1, 0, (0, 3)),
    Family("falling", "shear", 1, 1, (1, 4)),
    Family("rising", "shear", 1, -1, (2, 5)),
    Family("horizontal", "structural", 0, 1, (6, 7)),
    Family("vertical-bending", "bending", 2, 0, (8, 9)),
    Family("horizontal-bending", "bending", 0, 2, (10, 11)),
)


def xpbd_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts that need code, in addition to a cloth's (a grid's springs are `structural` ones) and the
    ordering.

    `structural-compliance` (and so on): the constraints have multipliers, or may get them, where the stiffness is live;
    `structural-damping`: dampers along them; `alternating`: those of the odd colour have constants of their own
    (`stiff`); `load`: masses differ, so that reciprocals are not constants; `pins`, `attachments`; `self_collision`,
    and `contact-friction` where that has friction.
    """
    parts = set(cloth_parts(scene, live))
    method = scene.method

    def gives(springs: Elastic) -> bool:
        return method.solver == "xpbd" and (not springs.inextensible or "stiffness" in live)

    if scene.springs:
        parts.add("structural")
        if gives(scene.springs):
            parts.add("structural-compliance")
        if scene.springs.alternate:
            parts.add("alternating")
    for kind, part in scene.constraints.items():
        parts.add(kind)
        parts.discard(f"{kind}-damping")
        if gives(part):
            parts.add(f"{kind}-compliance")
            if getattr(part, "damping", 0.0) > 0:
                parts.add(f"{kind}-damping")
    if scene.loads:
        parts.add("load")
    if scene.attachments and "pins" in parts:
        parts.add("attachments")
    if scene.self_collision:
        parts.add("self_collision")
        if scene.self_collision.static_friction > 0:
            parts.add("contact-friction")
    parts.add(method.ordering)
    return frozenset(parts)


def families(scene_parts: frozenset[str]) -> tuple[Family, ...]:
    """Return the families of the scene's constraints, by their first colours."""
    return tuple(family for family in FAMILIES if family.kind in scene_parts)


def colour_order(scene_parts: frozenset[str]) -> list[tuple[Family, int]]:
    """Return (family, its colour 0 or 1) in the order of Gauss-Seidel projections: 4 to 12 of them, or none."""
    order = [(family, colour) for family in families(scene_parts) for colour in (0, 1)]
    return sorted(order, key=lambda entry: entry[0].colours[entry[1]])


def constraint_count(scene: Scene) -> int:
    """Return the number of constraints that one iteration projects (without long-range attachments)."""
    grid, parts, total = scene.grid, xpbd_parts(scene), 0
    for family in families(parts):
        total += max(0, grid.rows - family.rows) * max(0, grid.columns - abs(family.columns))
    return total


def xpbd_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of a position-based solver of a sheet. Numbers are per particle and axis, as in model/core/plan.py.

    M. Macklin et al., "XPBD", MIG 2016, algorithm 1, in substeps (M. Macklin et al., "Small Steps in Physics
    Simulation", SCA 2019); multipliers are 0 at a substep's start and are stored through its iterations.
    """
    parts, method = xpbd_parts(scene, live), scene.method

    def project(family: Family) -> int:
        each = distance.OPERATIONS_SOFT if f"{family.kind}-compliance" in parts else distance.OPERATIONS_RIGID
        return each + distance.OPERATIONS_DAMPER * (f"{family.kind}-damping" in parts)

    colours: tuple[Stage, ...]
    if method.ordering == "gauss-seidel":
        colours = tuple(
            Stage(f"project {family.name} {colour}", 1, 1, project(family) // 2)
            for family, colour in colour_order(parts)
        )
    else:
        operations = sum(2 * project(family) for family in families(parts))
        colours = (Stage("project all", 1, 1, operations),) if operations else ()
    if "attachments" in parts and scene.attachments:
        colours += (Stage("attachments", 1, 1, scene.attachments.anchors * distance.OPERATIONS_ATTACHMENT),)
    search: tuple[Stage, ...] = ()
    if scene.self_collision:
        search = (Stage("find contacts", 3, 2, LOOKED_AT * contact.OPERATIONS_NEAREST),)
        sweep = Stage("project contacts", 2, 1, scene.self_collision.sweeps * contact.OPERATIONS_CONTACT)
        colours += (sweep,)
    root = position_based_step(scene, parts, search, colours, (), collisions(scene))
    return Plan(root, 4 * method.substeps, parts, dimensions=scene.dimensions)


def position_based_step(
    scene: Scene, parts: frozenset[str], search: Stages, iterated: Stages, after_iterations: Stages, ends: Stages
) -> Node:
    """Return a step: in each substep forces, predictions, `search`, iterations of the stages `iterated`,
    `after_iterations`, velocities from positions, `ends`."""
    method, axes = scene.method, scene.dimensions
    outside: list[Stage] = []
    if "gravity" in parts:
        outside.append(Stage("gravity", 0, 0, 1))
    if "wind" in parts:
        outside.append(Stage("wind", 3, 1, WIND))
    outside.extend(particle_force_stages(parts, memory=0))
    predict = Stage("predict", 2, 2, axes * distance.OPERATIONS_PREDICT)
    update = Stage("update velocity", 2, 1, axes * distance.OPERATIONS_UPDATE)
    iteration = Node("iteration", iterated, method.iterations)
    substep = Node(
        "substep", (*outside, predict, *search, iteration, *after_iterations, update, *ends), method.substeps
    )
    return Node("step", (substep,))


def collisions(scene: Scene) -> Stages:
    """Return the stage of collisions with the scene's colliders, if it has any."""
    operations = sum(colliders.OPERATIONS[kind] for kind, _ in scene.colliders)
    return (Stage("collide", 2, 2, operations, 1.0),) if scene.colliders else ()
