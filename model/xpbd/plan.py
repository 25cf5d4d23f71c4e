"""The plan of a position-based step, and the families of constraints on a sheet: their places and colours."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.model.contact.particle_parameters import contact_parts, rigid_parts
from softlab.model.contact.sheet_plan import WIND, cloth_parts, particle_force_stages
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.formulas import colliders, contact, distance, particle_contact
from softlab.model.formulas.shape_matching import cluster, couple, deformation, lattice, pace, rebound, rigid
from softlab.model.formulas.shape_matching import grid as shape_matching
from softlab.model.scene.cloth import SPRING_KINDS
from softlab.model.scene.parts import Elastic
from softlab.model.scene.scene import Scene

JACOBI = frozenset({"jacobi", "averaged-jacobi"})  # orderings: all constraints at one position
BODIES_LOOKED_AT = 27  # particles of the cells around one, in a lattice
CONTACTS_PER_PARTICLE = 4  # contacts of a particle at a body's surface; an interior one has none
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
    and `contact-friction` where that has friction. The solver shape-matching has `clusters` instead of constraints.
    """
    parts = set(cloth_parts(scene, live))
    method = scene.method
    if method.matches_shapes:
        return frozenset(parts - set(SPRING_KINDS)) | {"clusters"} | body_parts(scene)

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


def body_parts(scene: Scene) -> frozenset[str]:
    """Return the features of bodies that need code besides their clusters: `links`, deformations of their clusters,
    contacts."""
    if not scene.bodies:
        return frozenset()
    body_set = scene.body_set
    links = {"links"} if body_set.links.count else set()
    spare = {"spare"} if any(copy.waits for copy in (body_set.whole or body_set).copies) else set()
    lattices = {"lattices"} if body_set.lattices else set()
    couples = {"couples"} if scene.contact and scene.contact.static_friction > 0 and has_turning(scene) else set()
    return body_set.alike.loose.parts | contact_parts(scene) | rigid_parts(scene) | links | spare | lattices | couples


def has_turning(scene: Scene) -> bool:
    """Return True if a loose cluster has several particles, so that a friction couple can rotate it."""
    clusters = scene.body_set.alike.loose
    return bool((clusters.offsets[1:] - clusters.offsets[:-1] > 1).any())


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


def lattice_stages(region: int) -> tuple[Stage, ...]:
    """Return the stages of an iteration of shape matching of a grid whose clusters are windows."""
    sm, wide = shape_matching, 2 * region + 1
    matching = (wide - 1) * sm.OPERATIONS_MEMBER + wide * sm.OPERATIONS_ROW + sm.OPERATIONS_CLUSTER
    goals = wide * (sm.OPERATIONS_GOAL_MEMBER + sm.OPERATIONS_GOAL_ROW) + sm.OPERATIONS_MOVE
    return Stage("match clusters", 1, 2, matching), Stage("move to goals", 3, 1, goals)


def link_stages(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of bodies' links, one per colour: no two of a colour share a particle."""
    starts, particles = scene.body_set.links.starts, scene.body_set.particle_count
    each = (starts[1:] - starts[:-1]) * distance.OPERATIONS_SOFT / particles
    return tuple(Stage(f"project links {number}", 1, 1, round(float(count))) for number, count in enumerate(each))


def body_stages(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of an iteration of shape matching of bodies: clusters gather their particles, particles their
    clusters.

    An entry, a particle in a cluster, has an index of four bytes and a position, a rest offset, and a mass or a weight;
    matching reads a position, moving reads the cluster's rotation and centre, 12 scalars. In a lattice each mass has
    sums of a slice, nine scalars, which are written and read twice, and a rotation, four.
    """
    clusters, particles = scene.body_set.loose, scene.body_set.particle_count
    overlap, each = len(clusters.indices) / particles, clusters.count / particles
    shaped = cluster.OPERATIONS_TURN
    if clusters.parts & {"linear", "plastic"}:
        shaped += deformation.OPERATIONS_GRADIENT
        shaped += deformation.OPERATIONS_LINEAR * ("linear" in clusters.parts)
        shaped += deformation.OPERATIONS_PLASTIC * ("plastic" in clusters.parts)
    matched = overlap * cluster.OPERATIONS_MEMBER + each * shaped
    moved = overlap * cluster.OPERATIONS_GOAL + cluster.OPERATIONS_MOVE
    table = 3 + 1 + 1  # scalars
    regular = 0.0  # fraction of particles in lattices
    for one in scene.body_set.lattices:
        part = one.copies * one.lattice.size / particles
        regular += part
        matched += part * (lattice.OPERATIONS_MOMENTS + 2 * one.lattice.region * lattice.OPERATIONS_MEMBER)
        matched += part * lattice.OPERATIONS_TURN
        moved += part * (lattice.OPERATIONS_GOALS + (2 * one.lattice.region + 1) * lattice.OPERATIONS_GOAL_MEMBER)
        moved += part * lattice.OPERATIONS_MOVE
    reads = overlap * (3 + table) + 4 * each + regular * (3 + 9 + 3 + 4)
    writes = each * (4 + 12) + regular * (9 + 9 + 4)
    return (
        Stage("match clusters", round(reads / 3), round(writes / 3), round(matched)),
        Stage("move to goals", round((overlap * (12 + table) + regular * 9) / 3) + 1, 1, round(moved)),
    )


def damping_stage(scene: Scene) -> Stage:
    """Return the stage in which clusters gather the momenta of their particles, and these their clusters' rigid motions
    (9 scalars)."""
    clusters, particles = scene.body_set.loose, scene.body_set.particle_count
    overlap, each = len(clusters.indices) / particles, clusters.count / particles
    table = 1 + 1  # scalars: a mass or a factor, and an index
    reads = overlap * (6 + table) + overlap * (9 + table) + 6
    operations = overlap * (pace.OPERATIONS_MEMBER + pace.OPERATIONS_SLOWED) + each * pace.OPERATIONS_MOTION
    return Stage("damp clusters", round(reads / 3), 1 + round(each * 3), round(operations))


def momentum_stage(scene: Scene) -> Stage:
    """Return the stage in which rigid bodies gather the momenta of their particles' travels, and these get their
    velocities.

    The travels are three scalars that predictions write.
    """
    damping = damping_stage(scene)
    operations = 3 * (rigid.OPERATIONS_PREDICT + rigid.OPERATIONS_RATE)
    return Stage("keep momenta", damping.reads + 2, damping.writes + 1, damping.operations + operations)


def couple_stage(scene: Scene) -> Stage:
    """Return the stage in which clusters gather the couples of their particles, and these turn with their clusters.

    The couples are three scalars that contacts write, the turn six; the gathered couples are reset to 0.
    """
    clusters, particles = scene.body_set.loose, scene.body_set.particle_count
    overlap, each = len(clusters.indices) / particles, clusters.count / particles
    reads = overlap * (6 + 2) + overlap * (6 + 2) + 3
    operations = overlap * (couple.OPERATIONS_MEMBER + couple.OPERATIONS_TURN) + each * couple.OPERATIONS_SPIN
    return Stage("turn by friction", round(reads / 3), 2 + round(each * 2), round(operations))


def rebound_stage(scene: Scene) -> Stage:
    """Return the stage in which clusters gather the velocities from colliders, and their particles move with the
    clusters."""
    clusters, particles = scene.body_set.loose, scene.body_set.particle_count
    overlap, each = len(clusters.indices) / particles, clusters.count / particles
    reads = overlap * (2 * 7 + 9 + 2) + 9  # twice a position, a velocity and a mass; a motion, a factor and an index
    member = pace.OPERATIONS_MEMBER + rebound.OPERATIONS_MEMBER + rebound.OPERATIONS_REBOUND
    operations = overlap * member + each * pace.OPERATIONS_MOTION
    return Stage("rebound", round(reads / 3), 2 + round(each * 3), round(operations))


def xpbd_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of a position-based solver. Numbers are per particle and axis, as in model/core/plan.py.

    M. Macklin et al., "XPBD", MIG 2016, algorithm 1, in substeps (M. Macklin et al., "Small Steps in Physics
    Simulation", SCA 2019); multipliers are 0 at a substep's start and are stored through its iterations.
    """
    parts, method, axes = xpbd_parts(scene, live), scene.method, scene.dimensions
    outside: list[Stage] = []
    if "gravity" in parts:
        outside.append(Stage("gravity", 0, 0, 1))
    if "wind" in parts:
        outside.append(Stage("wind", 3, 1, WIND))
    outside.extend(particle_force_stages(parts, memory=0))
    predict = Stage("predict", 2, 2, axes * distance.OPERATIONS_PREDICT)

    def project(family: Family) -> int:
        each = distance.OPERATIONS_SOFT if f"{family.kind}-compliance" in parts else distance.OPERATIONS_RIGID
        return each + distance.OPERATIONS_DAMPER * (f"{family.kind}-damping" in parts)

    colours: tuple[Stage, ...]
    if method.matches_shapes:
        colours = link_stages(scene) + body_stages(scene) if scene.bodies else lattice_stages(method.region)
    elif method.ordering == "gauss-seidel":
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
    if scene.contact:
        search = (Stage("find neighbours", 3, 1, BODIES_LOOKED_AT * particle_contact.OPERATIONS_SEARCH),)
        each_contact = CONTACTS_PER_PARTICLE * (particle_contact.OPERATIONS_COUNT + particle_contact.OPERATIONS_PROJECT)
        colours += (Stage("project contacts", 4, 1, scene.contact.sweeps * each_contact),)
    couples = (couple_stage(scene),) if "couples" in parts else ()
    update = Stage("update velocity", 2, 1, axes * distance.OPERATIONS_UPDATE)
    bounces = Stage(
        "bounce", 6, 1, CONTACTS_PER_PARTICLE * particle_contact.OPERATIONS_BOUNCE
    )  # positions, velocities of pairs
    bounce = (bounces,) if "contact-restitution" in parts else ()
    steady = (momentum_stage(scene),) if "rigid-motion" in parts else ()
    slow = (damping_stage(scene),) if "cluster_damping" in parts else ()
    bodies = scene.colliders
    touch = (Stage("collide", 2, 2, sum(colliders.OPERATIONS[kind] for kind, _ in bodies), 1.0),) if bodies else ()
    rebounds = (rebound_stage(scene),) if "rigid-rebound" in parts else ()
    rest = (
        (Stage("rest", 2, 1, 3),) if {"rigid-motion", "sleeping"} <= parts else ()
    )  # compares the positions at a substep's ends
    iteration = Node("iteration", colours, method.iterations)
    late = bounce if "rigid-bounce" in parts else ()  # after colliders, which support the bodies under others
    ends = (*steady, *(() if late else bounce), *slow, *touch, *rebounds, *late, *rest)
    stages = (*outside, predict, *search, iteration, *couples, update, *ends)
    substep = Node("substep", stages, method.substeps)
    root = Node("step", (substep,))
    if scene.bodies:  # a pass ends where particles wait for clusters: nothing of an iteration stays in registers
        passes = sum(stage.reads + stage.writes for stage in root.stages() if stage.name != "collide")
        return Plan(root, passes, parts, dimensions=axes)
    return Plan(root, 4 * method.substeps, parts, dimensions=axes)
