"""The table of rows and laws is whole: every solver of the registry has a row, every row a reason, and the page is
current."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import get_args

import pytest
from fluids_at_rest import PICTURE, committed, drawing
from law import LAWS, limit_of
from limits_page import PAGE, page
from PIL import Image
from rows import ALL, BENDINGS, BODIES, MATERIALS, ORDERINGS, REFUSED, ROWS, SCHEMES, Row, tetrahedra
from slices import asked, by_default

from softlab.app.command.run import Request, run_scene
from softlab.bench.experiments.fluid_rest import TANK, still_tank
from softlab.model.base.errors import SceneError
from softlab.model.core.families import families
from softlab.model.core.integrators import IMPLICIT, INTEGRATORS
from softlab.model.core.stability.laws import LIMITS, limit_notes
from softlab.model.fluid.family import FLUID, comes_to_rest
from softlab.model.mass_spring.family import CLOTH, GRID
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.family import BODIES as BODIES_FAMILY
from softlab.model.shape_matching.family import WINDOWS
from softlab.model.tables.method import FIELDS_OF_SOLVER, Method
from softlab.model.tetrahedra.family import TETRAHEDRA
from softlab.model.tetrahedra.newton import TETRAHEDRA_NEWTON
from softlab.model.tetrahedra.vbd import TETRAHEDRA_VBD
from softlab.model.world.family import WORLD
from softlab.model.xpbd.family import MESH, SHEET

ORDERS = tuple(map(str, get_args(Method.model_fields["order"].annotation)))
MEMBERS = get_args(Method.model_fields["tetrahedra"].annotation)
SHEETS = ("grid", "cloth")
# of each family, the words that tell its rows apart: every combination is to have a row
WANTED: dict[str, list[tuple[str, ...]]] = {
    GRID.name: [(name,) for name in INTEGRATORS],
    CLOTH.name: [(name,) for name in INTEGRATORS | IMPLICIT],
    SHEET.name: [(sheet, solver, one) for sheet in SHEETS for solver in ("xpbd", "pbd") for one in ORDERINGS],
    MESH.name: [*((solver, bending) for solver in ("xpbd", "pbd") for bending in BENDINGS), ("volume",)],
    WINDOWS.name: [("1",), ("2",)],
    BODIES_FAMILY.name: [(kind,) for kind in BODIES],
    TETRAHEDRA.name: [(rows, one) for rows in ROWS for one in MATERIALS if (rows, one) not in REFUSED],
    TETRAHEDRA_VBD.name: [(material,) for material in MATERIALS],
    TETRAHEDRA_NEWTON.name: [(order, material) for order in ORDERS for material in MATERIALS],
    FLUID.name: [(scheme, axes) for scheme in SCHEMES for axes in ("2", "3")],
    WORLD.name: [(tetrahedra,) for tetrahedra in MEMBERS],
}


def words(row: Row) -> set[str]:
    """What a row's scene is made of and solved by."""
    method, result = row.bare.method, {row.solver, str(row.dimensions)}
    result |= {row.bare.kinds[name] for name in row.bare.kinds}
    result |= {method.integrator, method.ordering, method.rows, method.scheme, method.tetrahedra}
    result |= {str(method.region), str(method.order)} if row.family in (WINDOWS.name, TETRAHEDRA_NEWTON.name) else set()
    for part in row.bare.parts.values():
        result |= {str(getattr(part, field)) for field in ("material", "model") if hasattr(part, field)}
    return result


def test_every_solver_of_the_registry_has_a_row() -> None:
    """A new family, solver, integrator, ordering, material, scheme or kind of body without a row fails here."""
    assert set(WANTED) == {family.name for family in families()}
    assert {row.family for row in ALL} == set(WANTED)
    assert {row.solver for row in ALL} == set(FIELDS_OF_SOLVER)
    for family, wanted in WANTED.items():
        rows = [words(row) for row in ALL if row.family == family]
        assert not [one for one in wanted if not any(set(one) <= row for row in rows)], family


def test_what_has_no_row_is_refused() -> None:
    """A combination that a scene begins to accept needs a row."""
    for rows, material in REFUSED:
        with pytest.raises(SceneError, match=rows):
            tetrahedra("xpbd", material, rows=rows).bare.tetrahedra_set  # noqa: B018  # it raises


def test_names_are_unique() -> None:
    """Rows, laws and limits are looked up by name."""
    for names in ([row.name for row in ALL], [law.name for law in LAWS], [one.name for one in LIMITS]):
        assert len(set(names)) == len(names)


def test_every_law_has_a_body_with_an_equation_and_a_tolerance() -> None:
    """One test body a law, in tests/laws/test_law_*.py, with a docstring."""
    bodies: dict[str, str] = {}
    for file in sorted(Path(__file__).parent.glob("test_law_*.py")):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            for one in getattr(node, "decorator_list", []):
                if isinstance(one, ast.Call) and isinstance(one.func, ast.Name) and one.func.id == "of":
                    assert isinstance(node, ast.FunctionDef) and isinstance(one.args[0], ast.Constant)
                    bodies[str(one.args[0].value)] = ast.get_docstring(node) or ""
    assert bodies.keys() == {law.name for law in LAWS}
    assert all(len(text) > 150 for text in bodies.values())


def test_every_limit_is_one_of_a_law_and_of_some_row() -> None:
    """A limit that no row has would never be asked."""
    used = {limit.name for row in ALL for law in LAWS if (limit := limit_of(law.name, row))}
    assert used == {limit.name for limit in LIMITS}


def test_the_default_slice_asks_every_law_of_every_family_and_every_row() -> None:
    """What runs by default touches every solver and every law."""
    chosen = [(law, row, case) for law in LAWS for row, case in by_default(law)]
    families = {(law.name, row.family) for law in LAWS for row, _ in asked(law)}
    assert {(law.name, row.family) for law, row, _ in chosen} == families
    assert {row.name for _, row, _ in chosen} == {row.name for row in ALL}
    assert {(law.name, case) for law, _, case in chosen} == {(law.name, case) for law in LAWS for _, case in asked(law)}


def test_the_page_of_limits_is_current() -> None:
    """docs/limits.md is written by python -m tests.laws.limits_page."""
    assert PAGE.read_text(encoding="utf-8") == page(), "stale: python -m tests.laws.limits_page"


def test_a_run_notes_the_tanks_that_do_not_come_to_rest_and_no_others() -> None:
    """By every committed row: where `comes_to_rest` says so water is at rest; without viscosity nowhere else."""
    found = [row for row in committed() if row.kind == TANK and row.speed and not row.peer]
    said = {id(row): comes_to_rest(still_tank(row.who, row.substeps, row.spacing)) for row in found}
    assert all(row.rests for row in found if said[id(row)])
    assert not any(row.rests for row in found if not said[id(row)] and row.viscosity == 0)
    assert {row.rests for row in found} == {True, False}


def test_the_picture_of_fluids_at_rest_is_of_the_committed_rows() -> None:
    """Its file names the machine, the commit and the day of what it shows, as the page does."""
    with Image.open(PICTURE) as picture:
        assert picture.info["Description"] == drawing().caption, "stale: python -m tests.laws.limits_page"


@pytest.mark.parametrize(
    ("tables", "text"),
    [
        (
            {"grid": {"rows": 2, "columns": 2}, "springs": {}, "method": {"integrator": "lab"}},
            "half of the acceleration",
        ),
        ({"body": {"kind": "rigid_body", "shape": {"name": "box"}, "particle_spacing": 0.5}}, "lose spin"),
        (
            {
                "grid": {"rows": 2, "columns": 2},
                "springs": {},
                "method": {"solver": "xpbd", "ordering": "averaged-jacobi"},
            },
            "loses momentum",
        ),
        ({"grid": {"rows": 2, "columns": 2}, "springs": {}}, ""),
    ],
)
def test_a_run_says_what_its_scheme_cannot_keep(tables: dict, text: str) -> None:
    """The notes of a run name what would mislead, and nothing where there is nothing."""
    if "body" in tables:
        tables = tables | {"method": {"solver": "shape-matching"}}
    notes = limit_notes(Scene(tables, "law"))
    assert text in " ".join(notes) and bool(notes) == bool(text)


def test_the_notes_of_a_run_have_them() -> None:
    """`softlab run` prints them as it prints all notes."""
    scene = Scene({"grid": {"rows": 2, "columns": 2}, "springs": {}, "method": {"integrator": "lab"}}, "law")
    assert set(limit_notes(scene)) <= set(run_scene(scene, Request(steps=1), progress=False).notes)
