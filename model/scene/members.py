"""Members of a world, a scene with parts of several particle families: each member is a scene of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softlab.model.base.errors import SceneError
from softlab.model.base.table import Table, Tables
from softlab.model.tables.bodies import BODY_KINDS
from softlab.model.tables.cloth import COLLIDER_KINDS, CONSTRAINT_KINDS
from softlab.model.tables.method import FIELDS_OF_SOLVER, OF_FLUIDS, OF_WORLDS, Method
from softlab.model.tables.motion import RELEASE
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS

OF_CLOTHS = ("mesh", "wind", *(kind for kind in CONSTRAINT_KINDS if kind != "shear"))
SHARED = ("contact", "damping", "external", "gravity", "method", *COLLIDER_KINDS)
SHEETS = ("grid", "cloth")  # sheets of rows and columns, which a world does not support
OF_PARTICLES = ("restitution", "adhesion_reach", "maximum_speed", "sleeping_speed")  # not supported by surfaces
SUBSTEPS = 20  # of tetrahedra, by default: the sag of a beam of 1e6 Pa is then that of its mesh, within a fifth


@dataclass(frozen=True)
class Member:
    """Member of a world: the particles of one family.

    `kinds`: of parts, one of which makes it a member; `takes`: kinds that belong to these as well; `solver`: of its
    method (tetrahedra: as the world's method says); `contact`: the fields of a [contact] that it does not support, None
    where it supports no contacts; `lacks`: kinds of SHARED that it does not support.
    """

    kinds: tuple[str, ...]
    takes: tuple[str, ...]
    solver: str
    contact: tuple[str, ...] | None
    lacks: tuple[str, ...] = ()


BODIES = Member(tuple(BODY_KINDS), (), "shape-matching", ("distance",))
TETRAHEDRA = Member(
    tuple(TETRAHEDRAL_KINDS), ("region", "attachment", "material", "motion", *OF_CLOTHS), "xpbd", OF_PARTICLES
)
CLOTH = Member(("mesh",), ("attachments", *OF_CLOTHS), "xpbd", None)
FLUID = Member(("fluid",), ("domain",), OF_FLUIDS, None, ("damping",))
MEMBERS = {
    "bodies": BODIES,
    "tetrahedra": TETRAHEDRA,
    "cloth": CLOTH,
    "fluid": FLUID,
}  # in the order of a world's particles


def members_of(kinds: Mapping[str, str]) -> tuple[str, ...]:
    """Return the members of a world with parts of these kinds (name -> kind); none where one family solves the
    scene."""
    there = set(kinds.values())
    names = [name for name, member in MEMBERS.items() if there & set(member.kinds)]
    if "tetrahedra" in names and "cloth" in names:  # tetrahedra include the cloth beside them
        names.remove("cloth")
    return tuple(names) if len(names) > 1 else ()


def member_tables(kinds: Mapping[str, str], tables: Tables, method: Method) -> dict[str, Table]:
    """Return the tables of each member's scene.

    `tables`: those of the world, with their kinds, defaults filled in. Raises SceneError for one that belongs to no
    member.
    """
    names = members_of(kinds)
    for name, kind in kinds.items():
        owners = [one for one in names if kind in (*MEMBERS[one].kinds, *MEMBERS[one].takes)]
        if kind not in (*SHARED, RELEASE) and not owners:  # pins let go in all members at once
            mended = 'a sheet in a world is kind = "mesh" with shape = "sheet"' if kind in SHEETS else "leave it out"
            reason = f"is not supported in a world of {' and '.join(names)}; {mended}"
            raise SceneError(f"{name}.kind", kind, reason)
    return {name: _tables_of(MEMBERS[name], kinds, tables, method) for name in names}


def _tables_of(member: Member, kinds: Mapping[str, str], tables: Tables, method: Method) -> Table:
    selected: Table = {}
    solver = method.tetrahedra if member is TETRAHEDRA else member.solver
    for name, kind in kinds.items():
        if kind == "method":
            known = set(FIELDS_OF_SOLVER[OF_WORLDS]) & set(FIELDS_OF_SOLVER[solver]) - {"solver"}
            stated = {field: getattr(method, field) for field in sorted(known)}
            selected[name] = dict(tables[name]) | {"solver": solver} | stated
            selected[name] = {
                field: value for field, value in selected[name].items() if field in (*stated, "kind", "solver")
            }
        elif kind == "contact" and member.contact is not None and _may_collide(member, kinds, tables):
            selected[name] = {field: value for field, value in tables[name].items() if field not in member.contact}
        elif kind in {*member.kinds, *member.takes, *SHARED} - {"contact", *member.lacks}:
            selected[name] = tables[name]
    return selected


def _may_collide(member: Member, kinds: Mapping[str, str], tables: Tables) -> bool:
    """Return True if parts of a member may collide: for tetrahedra, several bodies, a cloth, or a body with
    self-collision."""
    if member is not TETRAHEDRA:
        return True
    bodies = [name for name, kind in kinds.items() if kind in (*member.kinds, "mesh")]
    return len(bodies) > 1 or any(tables[name].get("self_collision") for name in bodies)
