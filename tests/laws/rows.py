"""The rows of the matrix of laws: every family, solver, integrator or material, as a scene of a dozen particles.

A scene here is a free body without weight, colliders or dampers; each law adds what it asks about. A new solver is one
more row (tests/laws/test_law_table.py compares this table with the registry).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, get_args

from softlab.model.core.families import family_of
from softlab.model.core.integrators import IMPLICIT, INTEGRATORS
from softlab.model.scene.scene import Scene
from softlab.model.tables.bodies import BODY_KINDS
from softlab.model.tables.cloth import COLLIDER_KINDS, Bending
from softlab.model.tables.method import OrderingName, RowsName, SchemeName
from softlab.model.tables.tetrahedra import MaterialName

Tables = dict[str, Any]
MATERIALS: tuple[str, ...] = get_args(MaterialName)
ORDERINGS: tuple[str, ...] = get_args(OrderingName)
ROWS: tuple[str, ...] = get_args(RowsName)
SCHEMES: tuple[str, ...] = get_args(SchemeName)
BENDINGS: tuple[str, ...] = get_args(Bending.model_fields["model"].annotation)
BODIES = tuple(BODY_KINDS)
SHEETS = ("grid", "cloth", "mesh")
REFUSED = (("blocks", "neo-hookean"),)  # by the scene: its rows balance each other at rest
MASS = 0.125  # kg, of a particle of a sheet
STEP = 1 / 128  # s


@dataclass(frozen=True, eq=False)
class Row:
    """One row: `tables` of a free body without weight. `fall`: how the scheme falls, a key of `FALLS`. `damper`:
    tables with the material's own damping. `stretch`: how far a law may draw the body, of its size. `lain`: what
    makes it a flat one, where all of it lies on a floor. `scale` [1/s]: no vibration of the body is faster. `fast`:
    whether its states do not hang on neighbours in the scene."""

    name: str
    tables: Tables
    fall: str = "substeps"
    damper: Tables | None = None
    stretch: float = 0.05
    lain: Tables = field(default_factory=dict)

    def __repr__(self) -> str:
        return self.name

    @cached_property
    def bare(self) -> Scene:
        """The free body."""
        return Scene(self.tables, "law")

    @cached_property
    def family(self) -> str:
        return family_of(self.bare).name

    @property
    def dimensions(self) -> int:
        return self.bare.dimensions

    @property
    def knows(self) -> frozenset[str]:
        return family_of(self.bare).knows

    @property
    def meets_colliders(self) -> bool:
        return self.dimensions == 3 and bool(self.knows & set(COLLIDER_KINDS))

    @property
    def h(self) -> float:
        """A substep [s]."""
        return self.bare.method.dt / self.bare.method.substeps

    @property
    def solver(self) -> str:
        return self.bare.method.solver

    @property
    def body(self) -> str:
        """The table that a law gives a velocity or a damper to."""
        return next(iter(self.tables))

    def scene(self, *more: Mapping[str, Any], **tables: Any) -> Scene:
        """The free body with further tables; a table of one that is there changes fields of it; None leaves it out."""
        result = dict(self.tables)
        for changes in (*more, tables):
            for name, table in changes.items():
                result[name] = result.get(name, {}) | table if table is not None else None
        return Scene({name: table for name, table in result.items() if table is not None}, "law")


# ------------------------------------------------------------------ sheets

GRID: Tables = {"rows": 3, "columns": 4, "spacing": 0.25, "mass": MASS, "pinned": "none"}
FLAT = GRID | {"placement": "flat"}
SPRINGS = {"springs": {"stiffness": 64.0, "rest_length": 0.25}}
KINDS_OF_SPRINGS: Tables = {
    "structural": {"stiffness": 64.0}, "shear": {"stiffness": 32.0}, "bending": {"stiffness": 16.0},
}  # fmt: skip
SPRING_DAMPER: Tables = {kind: {"damping": 0.25} for kind in KINDS_OF_SPRINGS}
FALLS_OF_INTEGRATORS = {
    "lab": "half", "semi-implicit-euler": "substeps", "velocity-verlet": "exact", "rk4": "exact", "explicit-euler": "late",
    "taylor": "exact", "implicit-euler": "substeps", "implicit-euler-linear": "substeps",
}  # fmt: skip


def stepped(sheet: str, integrator: str) -> Row:
    """A grid or a cloth of masses and springs."""
    base = {"grid": GRID} | SPRINGS if sheet == "grid" else {"cloth": FLAT} | KINDS_OF_SPRINGS
    return Row(
        f"{sheet}, {integrator}",
        base | {"method": {"integrator": integrator, "dt": STEP}},
        fall=FALLS_OF_INTEGRATORS[integrator],
        damper=SPRING_DAMPER if sheet == "cloth" else None,
    )


def projected(sheet: str, solver: str, ordering: str) -> Row:
    """A grid or a cloth by pbd or xpbd."""
    base = {"grid": GRID} | SPRINGS if sheet == "grid" else {"cloth": FLAT} | KINDS_OF_SPRINGS
    damped = sheet == "cloth" and solver == "xpbd"
    method = {"solver": solver, "dt": STEP, "substeps": 2, "iterations": 2, "ordering": ordering}
    if solver == "pbd":
        method["pbd_stiffness"] = 0.25
    return Row(
        f"{sheet}, {solver} {ordering}", base | {"method": method}, damper=SPRING_DAMPER if damped else None
    )  # fmt: skip


def mesh(bending: str, solver: str = "xpbd", diagonals: str = "alternating") -> Row:
    """A sheet of triangles."""
    sheet = {"shape": "sheet", "rows": 3, "columns": 4, "spacing": 0.25, "mass": MASS, "placement": "flat"}
    stiffness = 16.0 if bending == "distance" else 0.0625
    base = {
        "mesh": sheet | {"diagonals": diagonals}, "structural": {"stiffness": 64.0},
        "bending": {"stiffness": stiffness, "model": bending},
    }  # fmt: skip
    method: Tables = {"solver": solver, "dt": STEP, "substeps": 2, "iterations": 2}
    damper = {"structural": {"damping": 0.25}} | ({"bending": {"damping": 0.25}} if bending == "distance" else {})
    return Row(
        f"mesh, {solver} {bending} bending", base | {"method": method}, damper=damper if solver == "xpbd" else None
    )  # fmt: skip


BALLOON = Row(
    "mesh, xpbd volume",
    {
        "mesh": {"file": "ball.obj", "mass": MASS, "scale": 0.5}, "structural": {"stiffness": 64.0},
        "volume": {"stiffness": 512.0}, "method": {"solver": "xpbd", "dt": STEP, "substeps": 2, "iterations": 2},
    },
)  # fmt: skip


def windows(region: int) -> Row:
    """A grid of clusters."""
    method = {"solver": "shape-matching", "dt": STEP, "substeps": 2, "iterations": 2, "region": region}
    return Row(f"grid, shape-matching region {region}", {"grid": GRID} | SPRINGS | {"method": method})


# ------------------------------------------------------------------ bodies of clusters

MATCHED: Tables = {"method": {"solver": "shape-matching", "dt": STEP, "substeps": 2, "iterations": 2}}
SAMPLED: Tables = {"volume_sampling": 1.0, "surface_sampling": 0.0, "particle_spacing": 0.25}
BOX: Tables = {"shape": {"name": "box", "sides": [0.75, 0.5, 0.5]}}
FLAT_BOX: Tables = {"shape": {"name": "box", "sides": [0.75, 0.25, 0.5]}}  # one layer of particles
SOFT = SAMPLED | BOX | {"cluster_stiffness": 1024.0}
BODY_TABLES: dict[str, Tables] = {
    "rigid_body": SAMPLED | BOX,
    "soft_body": SOFT,
    "soft_sheet": {
        "shape": {"name": "sheet", "resolution": 3}, "particle_spacing": 0.25, "link_stiffness": 64.0,
        "cluster_stiffness": 1024.0, "density": 2.0,
    },
    "soft_lattice": {"shape": BOX["shape"], "particle_spacing": 0.25, "region": 1, "cluster_stiffness": 1024.0},
}  # fmt: skip


def bodies(kind: str, variant: str = "", **fields: Any) -> Row:
    """A body of clusters."""
    table = {"kind": kind} | BODY_TABLES[kind] | fields
    damper = None if kind == "rigid_body" else {"body": {"cluster_damping": 4.0}}
    lain = {} if kind in ("soft_sheet", "rigid_body") else {"body": FLAT_BOX}
    name = f"{kind}{variant and ', ' + variant}"
    return Row(name, {"body": table} | MATCHED, damper=damper, stretch=0.0 if kind == "rigid_body" else 0.05, lain=lain)


# ------------------------------------------------------------------ tetrahedra

CUBE: Tables = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.5, 0.25, 0.25], "resolution": 4}, "edge": 0.25,
    "young_modulus": 2.0**14, "poisson_ratio": 0.25,
}  # fmt: skip
TETRAHEDRA_DAMPER: Tables = {"body": {"damping": 0.0078125}}


def tetrahedra(solver: str, material: str, variant: str = "", fields: Tables | None = None, **method: Any) -> Row:
    """A bar of two voxels."""
    settings = {"solver": solver, "dt": STEP, "substeps": 1, "iterations": 3} | method
    name = f"tetrahedra, {solver}{variant and ' ' + variant} {material}"
    fall = "exact" if settings.get("order") == 2 else "substeps"
    table = CUBE | {"material": material} | (fields or {})
    return Row(name, {"body": table, "method": settings}, fall=fall, damper=TETRAHEDRA_DAMPER)


# ------------------------------------------------------------------ fluids


def fluid(scheme: str, dimensions: int) -> Row:
    """A block of fluid without surroundings."""
    block = {
        "kind": "fluid", "dimensions": dimensions, "size": [0.5, 0.5, 0.25][:dimensions], "rest_distance": 0.125,
    }  # fmt: skip
    method = {"solver": "pbf", "dt": STEP, "substeps": 1, "iterations": 2, "scheme": scheme}
    return Row(f"fluid, {scheme}{' in a plane' * (dimensions == 2)}", {"body": block, "method": method})


# ------------------------------------------------------------------ worlds

WORLD: Tables = {"solver": "world", "dt": STEP, "substeps": 1, "iterations": 2}
BESIDE: Tables = {"kind": "soft_body"} | SOFT | {"origin": [0.0, 0.0, 1.0]}
WORLDS = (
    Row(
        "world, clusters and xpbd tetrahedra",
        {"body": CUBE, "jelly": BESIDE, "contact": {"distance": 0.0625}, "method": WORLD | {"tetrahedra": "xpbd"}},
        damper=TETRAHEDRA_DAMPER | {"jelly": {"cluster_damping": 4.0}},
    ),
    Row(
        "world, clusters and vbd tetrahedra",
        {"body": CUBE, "jelly": BESIDE, "contact": {"distance": 0.0625}, "method": WORLD | {"tetrahedra": "vbd"}},
        damper=TETRAHEDRA_DAMPER | {"jelly": {"cluster_damping": 4.0}},
    ),
    Row(
        "world, clusters and a mesh",
        {
            "cloth": mesh("isometric").tables["mesh"] | {"kind": "mesh", "origin": [0.0, -0.125, 0.0]},
            "structural": {"stiffness": 64.0}, "jelly": BESIDE, "contact": {"distance": 0.0625}, "method": WORLD,
        },
    ),
    Row(
        "world, clusters and a fluid",
        {
            "body": fluid("macklin", 3).tables["body"] | {"rest_distance": 0.25, "size": [0.5, 0.5, 0.5]}, "jelly": BESIDE,
            "method": WORLD,
        },
    ),
)  # fmt: skip


ALL: tuple[Row, ...] = (
    *(stepped("grid", name) for name in INTEGRATORS),
    *(stepped("cloth", name) for name in INTEGRATORS | IMPLICIT),
    *(projected(sheet, solver, one) for sheet in ("grid", "cloth") for solver in ("xpbd", "pbd") for one in ORDERINGS),
    *(mesh(bending, solver) for solver in ("xpbd", "pbd") for bending in BENDINGS),
    BALLOON,
    windows(1),
    windows(2),
    bodies("rigid_body"),
    bodies("soft_body"),
    bodies("soft_body", "linear", linear=0.5),
    bodies("soft_body", "linked", link_radius=0.3, link_stiffness=64.0),
    bodies("soft_body", "plastic", plastic_threshold=0.25, plastic_creep=8.0, linear=0.5),
    bodies("soft_sheet"),
    bodies("soft_lattice"),
    *(
        tetrahedra("xpbd", material, rows * (rows != "scalar"), rows=rows)
        for rows in ROWS
        for material in MATERIALS
        if (rows, material) not in REFUSED
    ),
    tetrahedra("xpbd", "fixed-corotated", "voxel volumes", {"volume": "voxels"}),
    tetrahedra("xpbd", "neo-hookean", "voxel volumes", {"volume": "voxels"}),
    tetrahedra("xpbd", "fixed-corotated", "greedy colours", {"sweep": "tetrahedra"}),
    *(tetrahedra("vbd", material) for material in MATERIALS),
    tetrahedra("vbd", "fixed-corotated", "chebyshev", chebyshev=0.5, iterations=8),
    *(tetrahedra("newton", material, f"order {order}", order=order) for order in (1, 2) for material in MATERIALS),
    *(fluid(scheme, dimensions) for scheme in SCHEMES for dimensions in (3, 2)),
    *WORLDS,
)
BY_NAME = {row.name: row for row in ALL}
