"""The validated description of a scene: TOML <-> objects. Frozen, SI units, only the parts that the scene names.

Top-level tables are named parts; `kind` defaults to the table's name, so `[grid]` is the part *grid* of kind *grid*. A
part that is not there is not simulated: it has no stage, no array and no branch in the compiled kernel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from functools import cached_property
from pathlib import Path

from softlab.model.base.clock import UNSEEN
from softlab.model.base.errors import SceneError
from softlab.model.base.table import Tables
from softlab.model.base.words import suggestion
from softlab.model.particles.particle_set import ParticleSet
from softlab.model.scene.checks.fit import check_fit, check_members
from softlab.model.scene.checks.releases import check_releases, tables_without
from softlab.model.scene.checks.solver import check_solver
from softlab.model.scene.defaults import take_method_defaults
from softlab.model.scene.reader import scene_tables
from softlab.model.scene.resting import take_resting_defaults
from softlab.model.scene.scene_parts import SceneParts
from softlab.model.tables.kinds import KINDS, REMOVED, SEVERAL, SHEETS
from softlab.model.tables.method import FIELDS_OF_SOLVER
from softlab.model.tables.motion import Release
from softlab.model.tables.parts import CAMERA, CameraPart
from softlab.model.tables.tank import TANK, Tank

NAMED_KINDS = KINDS | {TANK: Tank, CAMERA: CameraPart}  # names of tables that need no `kind`


class Scene(SceneParts):
    """Validated, immutable scene: tables of parts, their fields and defaults.

    Parameters
    ----------
    data : mapping
        Tables as in a scene file: `{"grid": {"rows": 16, "columns": 16}, "gravity": {}}`.
    name : str
        Name of the scene, and its title unless `data` has one.

    Raises
    ------
    SceneError
        A field holds a value that it cannot hold, or parts do not fit together.
    """

    _whole: Scene | None = None

    def __init__(self, data: Tables, name: str = "scene"):
        tables = dict(data)
        title = tables.pop("title", name)
        if not isinstance(title, str):
            raise SceneError("title", title, "must be a text")
        super().__init__(tables, name, title)
        for kind in KINDS:
            if kind not in SEVERAL and len(self.all_of(kind)) > 1:
                raise SceneError(kind, list(self.all_of(kind)), "a scene has at most one part of this kind")
        sheets = list(self.all_of(*SHEETS))
        if len(sheets) > 1:
            described = [name if name == self.kinds[name] else f"{name} (kind {self.kinds[name]})" for name in sheets]
            raise SceneError(
                sheets[1],
                None,
                f"a scene has one part of kind grid, cloth or mesh; this one has {len(sheets)}: {', '.join(described)}",
            )
        free = self.bodies or self.tetrahedra or self.fluids or self.is_world
        if not sheets and not free:
            raise SceneError(
                "grid",
                None,
                "a scene needs one part of kind grid or cloth, with rows and columns, or mesh; "
                "or bodies: soft_body, soft_sheet, soft_lattice, rigid_body, or tetrahedral_body, or fluid",
            )
        check_releases(self)
        take_method_defaults(self)
        check_fit(self)
        check_solver(self)
        take_resting_defaults(self)
        check_members(self)
        if self.camera is not None:
            self.camera.check(self.dimensions)
        for tank_name, tank in self.tanks.items():
            tank.check(tank_name, self.dimensions)
        _ = self.phases  # made here, so that each is checked as a scene of its own

    @classmethod
    def stored(cls, tables: Tables) -> Scene:
        """Return a scene for reading, from the tables that `canonical` wrote when it was measured.

        Checks between parts, which passed then, are not repeated, and no body is made. Raises SceneError for a part
        that this version does not know.
        """
        scene = cls.__new__(cls)
        SceneParts.__init__(scene, tables, "scene")
        return scene

    @property
    def whole(self) -> Scene:
        """The scene as described, with all its pins; `self` unless `at` made it."""
        return self._whole or self

    @cached_property
    def phases(self) -> tuple[tuple[float, Scene], ...]:
        """The scenes between releases: (time [s], scene from then on) of each time at which pins are released,
        ascending. Raises SceneError for a release that unpins nothing or leaves a scene that cannot be simulated."""
        releases = self.parts_of(Release)
        phases: list[tuple[float, Scene]] = []
        for time in sorted({release.time for release in releases.values()}):
            over = sorted((name for name, one in releases.items() if one.time <= time), key=lambda n: releases[n].time)
            tables = tables_without(self, over)
            try:
                scene = Scene(tables, self.name)
            except SceneError as error:
                reason = f"leaves a scene that cannot be simulated: {error}"
                raise SceneError(f"{over[-1]}.pins", releases[over[-1]].pins, reason) from None
            scene._whole = self
            phases.append((time, scene))
        return tuple(phases)

    def at(self, time: float) -> Scene:
        """Return the whole scene with the pins that it has at `time` [s]; the same object at any time between two
        releases."""
        whole = self.whole
        begun = time + UNSEEN * whole.method.dt
        return next((scene for begin, scene in reversed(whole.phases) if begun >= begin), whole)

    def stepped(self, **fields: object) -> Scene:
        """Return this scene, with its cached bodies, with other `fields` of the method, which are not validated
        again."""
        _ = self.grid  # built once, for both
        changed = copy(self)
        changed._whole = None
        changed.__dict__.pop("phases", None)
        method = self.name_of("method")
        changed.parts = self.parts | {method: self.method.model_copy(update=fields)}
        changed.derived = self.derived | {method: self.derived.get(method, frozenset()) - fields.keys()}
        return changed

    def with_particles(self, attribute: str, particles: ParticleSet) -> Scene:
        """Return this scene with other `particles` in place of those of its `attribute` (`body_set`, ...), all its bodies.

        Everything else, including the mass unit, is the same, and nothing is validated again.
        """
        changed = copy(self)
        changed.__dict__.update({"grid": particles, attribute: particles})
        return changed

    def replace(self, changes: Mapping[str, object]) -> Scene:
        """Return a new, validated scene with some fields replaced.

        Parameters
        ----------
        changes : mapping
            Values by dotted path, `{"grid.rows": 64}`. A path into a known part that the scene lacks adds that part.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            A path or value is not possible.
        """
        tables = self.whole.as_dict()
        for path, value in changes.items():
            part_name, _, field = path.partition(".")
            if not field or "." in field:
                raise SceneError(path, value, f"the key {path!r} must be a dotted path, such as grid.rows or method.dt")
            kind = self.kinds.get(part_name, part_name)
            if part_name in self.tanks:
                planes = ", ".join(name for name in self.kinds if name.startswith(f"{part_name}-"))
                raise SceneError(
                    path, value, f"the tank is read as its planes ({planes}); set their fields, or edit the file"
                )
            if kind in REMOVED:
                raise SceneError(path, value, REMOVED[kind])
            if kind not in NAMED_KINDS:
                names = [*self.kinds, *(name for name in NAMED_KINDS if name not in self.kinds)]
                raise SceneError(path, value, f"unknown part{suggestion(part_name, names)}; known: {', '.join(names)}")
            known = NAMED_KINDS[kind].model_fields
            if field not in known:
                raise SceneError(path, value, f"unknown key{suggestion(field, known)}; known: {', '.join(known)}")
            table = tables.setdefault(part_name, {})
            for other in _contradicted(kind, field, value, table):
                if f"{part_name}.{other}" not in changes:
                    table.pop(other, None)
            table[field] = value
        return Scene(tables, self.name)


def _contradicted(kind: str, field: str, value: object, table: Iterable[str]) -> list[str]:
    """Return the fields of a part that become invalid when `field` gets a `value`: a solver has its own fields."""
    if kind == "method" and field == "solver" and isinstance(value, str) and value in FIELDS_OF_SOLVER:
        return [name for name in table if name not in FIELDS_OF_SOLVER[value]]
    return list(NAMED_KINDS[kind].contradicts.get(field, ()))


def load_scene(name_or_path: str | Path) -> Scene:
    """Read a scene.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a catalogue scene ("lab-grid") or a TOML file.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        There is no such scene, or a file cannot be read.
    SceneError
        A field holds a value that it cannot hold.
    """
    return Scene(*scene_tables(name_or_path))
