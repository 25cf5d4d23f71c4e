"""The plan of a world's step: the stages of its members, and between them those that couple them.

A substep: all members predict; contacts are searched; in every iteration each member projects its constraints, one
after the other, then contacts between members move particles of both; all members end their substeps, which computes
velocities from positions. Without coupling, the members' stages are the whole plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from softlab.model.core.plan import Children, Node, Plan, Stage
from softlab.model.formulas import contact
from softlab.model.position_based.plan import LOOKED_AT
from softlab.model.scene.scene import Scene

BEGIN, TAKE, GIVE = (
    "take predictions",
    "take positions",
    "give positions",
)  # of particles with contacts, from and to members
FIND, PROJECT = "find cross contacts", "project cross contacts"


def name_of_stage(member: str, stage: str) -> str:
    """Return the name of a member's stage in the world's plan."""
    return f"{member}: {stage}"


def coupled(scene: Scene) -> bool:
    """Return True if particles of several members have contacts, as surfaces or balls: a fluid's do not."""
    return scene.contact is not None and len(scene.members.keys() - {"fluid"}) > 1


def world_plan(scene: Scene, plans: Mapping[str, Plan]) -> Plan:
    """Return the plan from the members' own `plans`, by name. Numbers are per particle of the world."""
    method, count = scene.method, scene.world_set.particle_count
    fractions = {name: len(range(*place.indices(count))) / count for name, place in scene.world_set.slices().items()}
    three = {name: plan.substep_parts for name, plan in plans.items()}

    def nodes(place: int) -> list[Node | Stage]:
        return [_named(name, three[name][place], fractions[name]) for name in plans if three[name][place]]

    find, project = _contact_stages(scene)
    stages = *nodes(0), *find, Node("iteration", (*nodes(1), *project), method.iterations), *nodes(2)
    root = Node("step", (Node("substep", stages, method.substeps),))
    parts = frozenset[str]().union(*(plan.parts for plan in plans.values()))
    fused = sum(plan.fused_scalars * fractions[name] for name, plan in plans.items())
    return Plan(root, round(fused), parts, dimensions=3)


def _named(member: str, children: Children, fraction: float) -> Node:
    """Return a member's stages, scaled by its fraction `fraction` of the world's particles."""
    scaled: list[Node | Stage] = []
    for child in children:
        if isinstance(child, Stage):
            reads, writes, operations = (round(n * fraction) for n in (child.reads, child.writes, child.operations))
            scaled.append(Stage(name_of_stage(member, child.name), reads, writes, operations, child.argument))
        else:
            scaled.append(replace(_named(member, child.children, fraction), name=child.name, times=child.times))
    return Node(member, tuple(scaled))


def _contact_stages(scene: Scene) -> tuple[list[Stage], list[Stage]]:
    """Return the stages of contacts between members, before and in the iterations."""
    if not coupled(scene):
        return [], []
    assert scene.contact is not None
    find = Stage(FIND, 3, 2, LOOKED_AT * contact.OPERATIONS_NEAREST)
    project = Stage(PROJECT, 2, 1, scene.contact.sweeps * contact.OPERATIONS_CONTACT)
    return [Stage(BEGIN, 2, 2, 0), find], [Stage(TAKE, 1, 1, 0), project, Stage(GIVE, 1, 1, 0)]
