"""The family of worlds: particles of several families in one scene, each solved by its own family, with contacts
between them."""

from __future__ import annotations

from math import inf

import numpy as np

from softlab.model.base.clock import START, Clock
from softlab.model.base.types import Real
from softlab.model.core.family import (
    CONTACTS_LOST,
    Arrays,
    Field,
    SolverFamily,
    counter,
    fault,
    of_springs,
    surface_contacts_lost,
)
from softlab.model.core.parameters import rounded_record
from softlab.model.core.plan import Plan
from softlab.model.core.simulation import Simulation
from softlab.model.fluid.family import FLUID, fluid_note, fluid_warnings
from softlab.model.fluid.plan import fluid_plan
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.family import BODIES
from softlab.model.tetrahedra.family import TETRAHEDRA
from softlab.model.tetrahedra.vbd import TETRAHEDRA_VBD
from softlab.model.world.plan import coupled, world_plan
from softlab.model.xpbd.family import MESH

OF_MEMBERS = {"bodies": (BODIES,), "tetrahedra": (TETRAHEDRA, TETRAHEDRA_VBD), "cloth": (MESH,), "fluid": (FLUID,)}


def _members(scene: Scene) -> dict[str, tuple[SolverFamily, Scene]]:
    """Return each member's family and scene, by name."""
    every = scene.members.items()
    return {name: (next(one for one in OF_MEMBERS[name] if one.accepts(member)), member) for name, member in every}


def _plan(scene: Scene, live: frozenset[str] = frozenset()) -> Plan:
    plans = {name: family.plan(member, live) for name, (family, member) in _members(scene).items()}
    if "fluid" in plans:
        plans["fluid"] = fluid_plan(scene.members["fluid"], live, solids=True)
    return world_plan(scene, plans)


def _record(scene: Scene, real: Real, poke: tuple[float, ...] = (0.0, 0.0, 0.0), clock: Clock = START) -> np.ndarray:
    """Return the length of a substep [s], (1,). The members' constants are in their own records."""
    return rounded_record(scene, {"dt": scene.method.dt / scene.method.substeps}, {"dt": "method.dt"}, real)


def _limit(scene: Scene, frequency: float | None = None) -> float:
    return min((family.limit(member, None) for family, member in _members(scene).values()), default=inf)


def _note(scene: Scene) -> str:
    note = "each member by its own method, in common substeps"
    if "fluid" in scene.members:
        note += "; " + fluid_note(scene.members["fluid"])
    return (
        note
        if coupled(scene) or len(scene.members.keys() - {"fluid"}) < 2
        else note + "; members pass through each other, since it has no [contact]"
    )


def _stored(scene: Scene, position: np.ndarray, arrays: Arrays) -> tuple[float, dict[str, float]]:
    """Return the total energy [J], and that of a cloth's constraints by kind."""
    total: float = 0.0
    by_kind: dict[str, float] = {}
    members = _members(scene)
    for name, place in scene.world_set.slices().items():
        family, part = members[name]
        energy, kinds = family.stored(part, position[place], arrays)
        total, by_kind = total + energy, by_kind | kinds
    return total, by_kind


def _strain(scene: Scene, position: np.ndarray, kind: str, arrays: Arrays) -> np.ndarray:
    """Return the strains of all members, concatenated."""
    members = _members(scene)
    strains = [
        members[name][0].strain(members[name][1], position[place], kind, arrays)
        for name, place in scene.world_set.slices().items()
    ]
    return np.concatenate(strains)


def _fields(scene: Scene) -> tuple[Field, ...]:
    """Return the fields of a world: those of its surfaces, and the numbers of its members, added up."""
    numbers: dict[str, Field] = {}
    for family, member in _members(scene).values():
        numbers |= {field.name: field for field in family.fields(member) if field.rows == "one"}
    direct = {field.name: field for field in of_springs(scene)}
    return tuple((direct | {name: _added(field) for name, field in numbers.items()}).values())


def _added(number: Field) -> Field:
    """Return a number of members as one of the world's, which may have contacts of surfaces between members."""

    def total(simulation: Simulation) -> int:
        between = surface_contacts_lost(simulation) if number.name == CONTACTS_LOST.name else 0
        members = simulation.members.values()
        return between + sum(member.read(number.name) for member in members if number.name in member.fields)

    return (fault if number.fault else counter)(number.name, number.doc, total)


WORLD = SolverFamily(
    name="world",
    knows=frozenset[str]().union(
        *(one.knows for families in OF_MEMBERS.values() for one in families)
    ),  # each member refuses kinds that it does not support
    accepts=lambda scene: scene.is_world,
    plan=_plan,
    record=_record,
    limit=_limit,
    limited_by_net=False,
    note=_note,
    warnings=fluid_warnings,
    stored=_stored,
    strain=_strain,
    spring_count=lambda scene: sum(family.spring_count(member) for family, member in _members(scene).values()),
    solvers={"cpu": "softlab.cpu_backend.world.solver:World", "gpu": "softlab.gpu_backend.world.solver:World"},
    passes={"cpu": "softlab.app.plan.world:world_on_cpu", "gpu": "softlab.app.plan.world:world_on_gpu"},
    reference="softlab.bench.reference.world",
    presentation="softlab.app.families.world:WORLD",
    fields=_fields,
    unknown="a world of several families has no converged reference",
)
