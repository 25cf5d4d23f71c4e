"""The tables of a scene, each checked by itself; model/scene/checks compares them with each other.

Top-level tables are named parts; `kind` defaults to the table's name, so `[grid]` is the part *grid* of kind *grid*.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any, Generic, NoReturn, Self, TypeVar

from pydantic import ValidationError

from softlab.model.base.errors import InputError, SceneError
from softlab.model.base.table import Part, Table, Tables
from softlab.model.base.words import scene_error, suggestion
from softlab.model.particles.body_set import BodySet, Copy, make_body_set
from softlab.model.particles.fluid_set import FluidSet, make_fluid_set
from softlab.model.particles.particle_set import Particles
from softlab.model.particles.tetrahedra_set import TetrahedraSet, make_tetrahedra_set
from softlab.model.particles.world_set import WorldSet, make_world_set
from softlab.model.scene.members import member_tables, members_of
from softlab.model.tables.attachment import Attachment, motion_with, pins
from softlab.model.tables.bodies import BODY_KINDS, Placed
from softlab.model.tables.cloth import (
    COLLIDER_KINDS,
    CONSTRAINT_KINDS,
    SPRING_KINDS,
    Cloth,
    ClothSprings,
    Collider,
    Fold,
    Wind,
)
from softlab.model.tables.flow import Emitter, Sink
from softlab.model.tables.fluid import Domain, Fluid, Foam
from softlab.model.tables.kinds import KINDS, REMOVED
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.method import Method
from softlab.model.tables.motion import Motion
from softlab.model.tables.particle_contact import Contact
from softlab.model.tables.parts import (
    CAMERA,
    CameraPart,
    Damping,
    Elastic,
    External,
    Gravity,
    Grid,
    Perturbation,
    Springs,
)
from softlab.model.tables.regions import Region
from softlab.model.tables.self_collision import SelfCollision
from softlab.model.tables.tank import TANK, Tank
from softlab.model.tables.tetrahedra import TETRAHEDRAL_KINDS, Material, TetrahedralBody
from softlab.model.tables.xpbd import Attachments, Load

P = TypeVar("P", bound=Part)
FEW = 4  # kinds that an error proposes


def _unknown_part(name: str, table: Mapping[str, object]) -> SceneError:
    """Return the error for a table of no known kind: the kinds that have all of its fields, or else all kinds."""
    known = (*KINDS, TANK)
    if "kind" in table:
        kind = table["kind"]
        return SceneError(
            f"{name}.kind", kind, f"unknown part{suggestion(str(kind), known)}; known kinds: {', '.join(known)}"
        )
    able = [kind for kind, part in KINDS.items() if table and set(table) <= set(part.model_fields)]
    if able and not suggestion(name, known):
        remedy = " or ".join(f'kind = "{kind}"' for kind in able[:FEW])
        return SceneError(name, table, f"unknown part; give the table {remedy}")
    remedy = 'give the table a kind, such as kind = "soft_body"'
    return SceneError(
        name, table, f"unknown part{suggestion(name, known)}; known kinds: {', '.join(known)}; or {remedy}"
    )


def _build_part(name: str, part_class: type[P], fields: Table) -> P:
    """Return the part of class `part_class` with these fields. Raises SceneError or InputError that name the part."""
    try:
        return part_class(**fields)
    except ValidationError as error:
        raise scene_error(name, error, part_class) from None
    except SceneError as error:  # of a mesh, which does not know the part's name
        kind = next((kind for kind, known in KINDS.items() if known is part_class), name)
        field = re.sub(rf"\b{kind}\.", f"{name}.", error.field)
        raise SceneError(field, error.value, error.allowed) from None
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except TypeError:  # a key that is not a valid name
        raise SceneError(name, sorted(map(str, fields)), "its keys must be names") from None


class _Lookup(Generic[P]):
    """Base of the properties of a scene that look up its parts of a class."""

    def __init__(self, part_class: type[P]):
        self.part_class = part_class

    def __set__(self, scene: SceneParts, value: object) -> NoReturn:
        raise AttributeError("the parts of a scene cannot be replaced; use Scene.replace")


class _One(_Lookup[P]):
    """The part that occurs at most once, or None."""

    def __get__(self, scene: SceneParts, owner: type) -> P | None:
        return scene.one(self.part_class)


class _Parts(_Lookup[P]):
    """All parts by name, in the order of the file."""

    def __get__(self, scene: SceneParts, owner: type) -> dict[str, P]:
        return scene.parts_of(self.part_class)


class _DirectParts(_Lookup[P]):
    """All parts by name; none in a world, whose members have them."""

    def __get__(self, scene: SceneParts, owner: type) -> dict[str, P]:
        return scene.direct_parts(self.part_class)


class SceneParts:
    """`parts` maps a part's name to its object, `kinds` the name to its kind.

    The parts that a solver needs have properties (`grid`, `springs`, ...): the part, or None where the scene lacks it.
    Raises SceneError for a table that is not a valid part.
    """

    def __init__(self, tables: Tables, name: str, title: str | None = None):
        self.name, self.title = name, name if title is None else title
        self.derived: dict[str, frozenset[str]] = {}  # fields by part that the tables do not state
        self._read(tables)

    def _read(self, tables: Tables) -> None:
        """Read the parts and their kinds. Each part is checked on its own."""
        self.parts: dict[str, Part] = {}
        self.kinds: dict[str, str] = {}
        self.camera: CameraPart | None = None
        self.tanks: dict[str, Tank] = {}  # as written; their planes are simulated
        for part_name, table in tables.items():
            if not isinstance(table, Mapping):
                if part_name in KINDS or part_name == TANK:
                    raise SceneError(part_name, table, f"must be a table, such as [{part_name}]")
                raise SceneError(
                    part_name,
                    table,
                    f"unknown key; a scene has a title and tables: {', '.join((*KINDS, TANK, CAMERA))}",
                )
            fields = dict(table)
            kind = fields.pop("kind", part_name)
            if part_name == CAMERA and kind == CAMERA:
                self.camera = _build_part(part_name, CameraPart, fields)
                continue
            if kind == TANK:
                self._add_planes(part_name, _build_part(part_name, Tank, fields), tables)
                continue
            if isinstance(kind, str) and kind in REMOVED:
                raise SceneError(f"{part_name}.kind", kind, REMOVED[kind])
            if not isinstance(kind, str) or kind not in KINDS:
                raise _unknown_part(part_name, table)
            self.parts[part_name] = _build_part(part_name, KINDS[kind], fields)
            self.kinds[part_name] = kind

    def derive(self, part_name: str, fields: Mapping[str, object]) -> None:
        """Give a part `fields` that its table does not state; `as_dict` omits them, so that they follow changes."""
        self.parts[part_name] = self.parts[part_name].model_copy(update=fields)
        self.derived[part_name] = self.derived.get(part_name, frozenset()) | frozenset(fields)

    def _add_planes(self, name: str, tank: Tank, tables: Tables) -> None:
        """Read a tank as its planes. Raises SceneError where a table already has the name of one."""
        self.tanks[name] = tank
        kinds = {table.get("kind", key) for key, table in tables.items() if isinstance(table, Mapping)}
        bodies = bool(kinds & {*BODY_KINDS, *TETRAHEDRAL_KINDS}) and "fluid" not in kinds
        for plane, part in tank.planes(name, derives_thickness=bodies).items():
            if plane in tables:
                raise SceneError(
                    plane, None, f"is also the name of a plane of the tank [{name}]; rename one of the tables"
                )
            self.parts[plane], self.kinds[plane] = part, "plane"

    def parts_of(self, part_class: type[P]) -> dict[str, P]:
        """Return the parts of a class, by name, in the order of the file."""
        return {name: part for name, part in self.parts.items() if isinstance(part, part_class)}

    def direct_parts(self, part_class: type[P]) -> dict[str, P]:
        """Return the parts as by `parts_of`; none in a world, whose members have them."""
        return {} if self.is_world else self.parts_of(part_class)

    def one(self, part_class: type[P]) -> P | None:
        """Return the part of a class that occurs at most once, or None."""
        return next((part for part in self.parts.values() if isinstance(part, part_class)), None)

    def all_of(self, *kinds: str) -> dict[str, Part]:
        """Return the parts of these kinds by name, in the order of the file."""
        return {name: self.parts[name] for name, kind in self.kinds.items() if kind in kinds}

    def value(self, path: str, default: object = None) -> Any:
        """Return the value of the field `part.field`, or `default` if there is none."""
        name, _, field = path.partition(".")
        return getattr(self.parts.get(name), field, default)

    def name_of(self, *kinds: str) -> str:
        """Return the name of the scene's first part of these kinds; "" where it has none."""
        return next(iter(self.all_of(*kinds)), "")

    def refuse(self, kinds: Collection[str], why: str) -> None:
        """Raise SceneError for the first part of one of the `kinds`."""
        for name, kind in self.kinds.items():
            if kind in kinds:
                raise SceneError(f"{name}.kind", kind, why)

    @cached_property
    def grid(self) -> Particles:
        """The particle set of the scene: a grid; a cloth, also of triangles; the body set; the set of tetrahedra and a
        cloth beside them; the set of fluids; in a world all particles.
        """
        if self.is_world:
            return self.world_set
        if self.tetrahedra:
            return self.tetrahedra_set
        if self.fluids:
            return self.fluid_set
        return self.one(Grid) or self.body_set

    @property
    def sheet(self) -> Grid:
        """The grid, cloth or mesh of the scene."""
        assert isinstance(self.grid, Grid)
        return self.grid

    @cached_property
    def is_world(self) -> bool:
        """True if the scene's parts belong to several families of particles. The parts are then those of its `members`,
        not its own: particles by body set have to be counted in a member."""
        return bool(members_of(self.kinds))

    @cached_property
    def content(self) -> str:
        """Kind of the scene's particles: `world`, or of their only family `fluids`, `tetrahedra` (and a cloth beside them),
        `bodies` or `sheet`."""
        contents = {"world": self.is_world, "fluids": self.fluids, "tetrahedra": self.tetrahedra, "bodies": self.bodies}
        return next((name for name, particles in contents.items() if particles), "sheet")

    @cached_property
    def members(self) -> dict[str, Self]:
        """Scenes of each family's parts in a world, by the names in model/scene/members.py, in the order of its
        particles; empty for any other scene. Raises SceneError."""
        if not self.is_world:
            return {}
        tables = self.as_dict()
        for name, part in self.parts_of(Fluid).items():
            tables[name]["support"] = part.support  # among bodies derived, which its member has none of
        tables = member_tables(self.kinds, tables, self.method)
        return {name: type(self)(direct_parts, self.name) for name, direct_parts in tables.items()}

    @cached_property
    def world_set(self) -> WorldSet:
        """All particles of a world, member by member."""
        return make_world_set({name: member.grid for name, member in self.members.items()})

    @cached_property
    def body_set(self) -> BodySet:
        """All particles of the scene's bodies, made on first use. Raises SceneError, InputError (a body)."""
        return make_body_set(self.bodies)

    @property
    def copies(self) -> tuple[Copy, ...]:
        """All copies of the scene's bodies."""
        return self.body_set.copies if self.bodies else ()

    @property
    def cluster_count(self) -> int:
        """Number of clusters of the scene's bodies, or of those in a world."""
        if self.bodies:
            return self.body_set.clusters.count
        return sum(member.cluster_count for member in self.members.values())

    @cached_property
    def tetrahedra_set(self) -> TetrahedraSet:
        """All tetrahedral bodies together and the cloth beside them, created on first use. Raises SceneError,
        InputError (a body)."""
        return make_tetrahedra_set(
            self.tetrahedra, self.regions, self.attachment_parts, self.materials, self.parts_of(Mesh)
        )

    @property
    def flows(self) -> bool:
        """True if emitters or sinks add and remove particles."""
        return bool(self.emitters or self.sinks)

    @cached_property
    def fluid_set(self) -> FluidSet:
        """All particles of the scene's fluids, created on first use."""
        return make_fluid_set(self.fluids, self.domain)

    @cached_property
    def mesh(self) -> Mesh | None:
        """The cloth of triangles."""
        return None if self.is_world else self.one(Mesh)

    @cached_property
    def cloth(self) -> Cloth | None:
        """The sheet in space: rows and columns, or a mesh."""
        return None if self.is_world else self.one(Cloth)

    @cached_property
    def dimensions(self) -> int:
        """Number of dimensions: as stated for fluids, 3 for a cloth, bodies of any kind and a world, otherwise 2."""
        if self.fluids:
            return next(iter(self.fluids.values())).dimensions
        return 3 if self.cloth or self.bodies or self.tetrahedra or self.is_world else 2

    @property
    def cloth_springs(self) -> dict[str, ClothSprings]:
        """Springs of the cloth by kind, in the order structural, shear, bending."""
        springs = self.parts_of(ClothSprings)
        return {kind: part for kind in SPRING_KINDS if (part := springs.get(self.name_of(kind))) is not None}

    @property
    def constraints(self) -> dict[str, Elastic]:
        """The constraints of a mesh by kind, in the order of CONSTRAINT_KINDS; of a cloth its springs."""
        elastic = self.parts_of(Elastic)
        return {kind: part for kind in CONSTRAINT_KINDS if (part := elastic.get(self.name_of(kind))) is not None}

    @property
    def colliders(self) -> list[tuple[str, Collider]]:
        """Return (kind, collider), planes first, then spheres, capsules, boxes, meshes and fields, each in the order of
        the file."""
        colliders = self.parts_of(Collider)
        return [(kind, part) for kind in COLLIDER_KINDS for name, part in colliders.items() if self.kinds[name] == kind]

    @property
    def motions(self) -> dict[str, Motion]:
        """The motions of pinned masses, by the part's name, including attachments to a moving collider."""
        motions, colliders = self.parts_of(Motion), self.parts_of(Collider)
        for name, part in self.attachment_parts.items():
            collider = colliders.get(part.to or "")
            motion = motion_with(part, collider) if pins(part, self.holdable) and collider else None
            if motion is not None:
                motions[name] = motion
        return motions

    @property
    def holdable(self) -> dict[str, Part]:
        """Parts that can be attached, by name: tetrahedral bodies, then a cloth beside them."""
        return {**self.tetrahedra, **self.direct_parts(Mesh)}

    # Parts by name, in the order of the file; those of a family are the members' in a world.
    attachment_parts = _DirectParts(Attachment)  # of bodies and a cloth to the world, colliders and one another
    bodies = _DirectParts(Placed)  # soft and rigid
    emitters = _Parts(Emitter)
    fluids = _DirectParts(Fluid)
    loads = _Parts(Load)  # masses that differ from the sheet's
    materials = _Parts(Material)  # of tetrahedra in regions
    regions = _Parts(Region)  # of tetrahedral bodies
    sinks = _Parts(Sink)
    tetrahedra = _DirectParts(TetrahedralBody)

    attachments = _One(Attachments)
    contact = _One(Contact)  # collisions between bodies
    damping = _One(Damping)
    domain = _One(Domain)
    external = _One(External)
    foam = _One(Foam)
    fold = _One(Fold)
    gravity = _One(Gravity)
    perturbation = _One(Perturbation)
    self_collision = _One(SelfCollision)
    springs = _One(Springs)
    wind = _One(Wind)

    @property
    def method(self) -> Method:
        """The way in which the scene is stepped; every scene has one once it was made."""
        method = self.one(Method)
        assert method is not None
        return method

    def as_dict(self, derived: bool = False) -> Table:
        """Return the scene as nested tables, defaults filled in, as in a TOML file. `derived`: include derived fields
        (`derive`)."""
        tables: Table = {"title": self.title}
        for part_name, part in self.parts.items():
            kind = self.kinds[part_name]
            left_out = set() if derived else self.derived.get(part_name, frozenset())
            table = part.model_dump(mode="json", exclude=set(left_out))
            tables[part_name] = ({} if kind == part_name else {"kind": kind}) | table
        if self.camera is not None:
            tables[CAMERA] = self.camera.model_dump(mode="json")
        return tables

    def canonical(self) -> str:
        """Return canonical JSON of the simulated part of the scene (no title, no camera): equal texts mean equal
        scenes."""
        tables = {key: table for key, table in self.as_dict(derived=True).items() if key not in ("title", CAMERA)}
        return json.dumps(tables, sort_keys=True, separators=(",", ":"))
