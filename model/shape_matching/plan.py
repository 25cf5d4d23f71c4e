"""The plans of shape matching: clusters in the substeps of the position-based solvers, of a grid and of bodies."""

from __future__ import annotations

from softlab.model.base.errors import InputError
from softlab.model.contact.particle_parameters import contact_parts, rigid_parts
from softlab.model.contact.sheet_plan import Stages, cloth_parts
from softlab.model.core.own_forces import particle_forces, particle_forces_change
from softlab.model.core.plan import Plan, Stage
from softlab.model.formulas import distance, particle_contact
from softlab.model.formulas.shape_matching import cluster, couple, deformation, lattice, pace, rebound, rigid
from softlab.model.formulas.shape_matching import grid as shape_matching
from softlab.model.position_based.plan import collisions, position_based_step
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import SPRING_KINDS

BODIES_LOOKED_AT = 27  # particles of the cells around one, in a lattice
CONTACTS_PER_PARTICLE = 4  # contacts of a particle at a body's surface; an interior one has none


def window_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the parts of a grid that need code, with `clusters` instead of springs."""
    return cloth_parts(scene, live) - set(SPRING_KINDS) | {"clusters"}


def body_parts(scene: Scene, live: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the features of bodies that need code: `clusters`, their deformations, `links`, contacts."""
    body_set = scene.body_set
    links = {"links"} if body_set.links.count else set()
    spare = {"spare"} if any(copy.waits for copy in (body_set.whole or body_set).copies) else set()
    lattices = {"lattices"} if body_set.lattices else set()
    couples = {"couples"} if scene.contact and scene.contact.static_friction > 0 and has_turning(scene) else set()
    parts = window_parts(scene, live)
    if particle_forces_change(parts):
        names = ", ".join(force.part for force in particle_forces(parts) if force.changes)
        raise InputError(
            f"the kernels of bodies do not know the step: {names} is not available for shape matching of bodies"
        )
    return (
        parts
        | body_set.alike.loose.parts
        | contact_parts(scene)
        | rigid_parts(scene)
        | links
        | spare
        | lattices
        | couples
    )


def has_turning(scene: Scene) -> bool:
    """Return True if a cluster has several particles, so that a friction couple can rotate it."""
    offsets = scene.body_set.alike.clusters.offsets
    return bool((offsets[1:] - offsets[:-1] > 1).any())


def lattice_stages(region: int) -> tuple[Stage, ...]:
    """Return the stages of an iteration of shape matching of a grid whose clusters are windows."""
    sm, wide = shape_matching, 2 * region + 1
    matching = (wide - 1) * sm.OPERATIONS_MEMBER + wide * sm.OPERATIONS_ROW + sm.OPERATIONS_CLUSTER
    goals = wide * (sm.OPERATIONS_GOAL_MEMBER + sm.OPERATIONS_GOAL_ROW) + sm.OPERATIONS_MOVE
    return Stage("match clusters", 1, 2, matching), Stage("move to goals", 3, 1, goals)


def link_stages(scene: Scene) -> tuple[Stage, ...]:
    """Return the stages of bodies' links, one per colour; no two links of a colour have a common particle."""
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
    """Return the stage that damps towards rigid motion: clusters sum the momenta of their particles, and particles read
    the rigid motions of their clusters (9 scalars)."""
    clusters, particles = scene.body_set.loose, scene.body_set.particle_count
    overlap, each = len(clusters.indices) / particles, clusters.count / particles
    table = 1 + 1  # scalars: a mass or a factor, and an index
    reads = overlap * (6 + table) + overlap * (9 + table) + 6
    operations = overlap * (pace.OPERATIONS_MEMBER + pace.OPERATIONS_SLOWED) + each * pace.OPERATIONS_MOTION
    return Stage("damp clusters", round(reads / 3), 1 + round(each * 3), round(operations))


def momentum_stage(scene: Scene) -> Stage:
    """Return the stage that gives rigid bodies their velocities: bodies sum the momenta of their particles'
    displacements (three scalars, written by predictions), and particles read the resulting velocities."""
    damping = damping_stage(scene)
    operations = 3 * (rigid.OPERATIONS_PREDICT + rigid.OPERATIONS_RATE)
    return Stage("keep momenta", damping.reads + 2, damping.writes + 1, damping.operations + operations)


def couple_stage(scene: Scene) -> Stage:
    """Return the stage that turns clusters by friction: clusters sum the couples of their particles (three scalars,
    written by contacts), particles turn with their clusters (six scalars), and the couples are reset to 0. Windows of
    lattices count as clusters."""
    clusters, particles = scene.body_set.clusters, scene.body_set.particle_count
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


def window_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of a grid whose clusters are windows, as in model/position_based/plan.py."""
    parts, method = window_parts(scene, live), scene.method
    root = position_based_step(scene, parts, (), lattice_stages(method.region), (), collisions(scene))
    return Plan(root, 4 * method.substeps, parts, dimensions=scene.dimensions)


def body_plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    """Return the plan of bodies, as in model/position_based/plan.py.

    A pass ends where particles wait for clusters: nothing of an iteration stays in registers.
    """
    parts = body_parts(scene, live)
    iterated: Stages = link_stages(scene) + body_stages(scene)
    search: Stages = ()
    if scene.contact:
        search = (Stage("find neighbours", 3, 1, BODIES_LOOKED_AT * particle_contact.OPERATIONS_SEARCH),)
        contact_operations = CONTACTS_PER_PARTICLE * (
            particle_contact.OPERATIONS_COUNT + particle_contact.OPERATIONS_PROJECT
        )
        iterated += (Stage("project contacts", 4, 1, scene.contact.sweeps * contact_operations),)
    after_iterations = (couple_stage(scene),) if "couples" in parts else ()
    bounces = Stage(
        "bounce", 6, 1, CONTACTS_PER_PARTICLE * particle_contact.OPERATIONS_BOUNCE
    )  # positions, velocities of pairs
    bounce = (bounces,) if "contact-restitution" in parts else ()
    steady = (momentum_stage(scene),) if "rigid-motion" in parts else ()
    slow = (damping_stage(scene),) if "cluster_damping" in parts else ()
    rebounds = (rebound_stage(scene),) if "rigid-rebound" in parts else ()
    rest = (
        (Stage("rest", 2, 1, 3),) if {"rigid-motion", "sleeping"} <= parts else ()
    )  # compares the positions at a substep's ends
    late = bounce if "rigid-bounce" in parts else ()  # after colliders, which support the bodies under others
    ends = (*steady, *(() if late else bounce), *slow, *collisions(scene), *rebounds, *late, *rest)
    root = position_based_step(scene, parts, search, iterated, after_iterations, ends)
    passes = sum(stage.reads + stage.writes for stage in root.stages() if stage.name != "collide")
    return Plan(root, passes, parts, dimensions=scene.dimensions)
