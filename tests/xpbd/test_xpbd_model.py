"""The position-based solvers' scene, plan and record: what is refused, what is written, what the constants are."""

from itertools import combinations

import numpy as np
import pytest

from softlab.bench.reference import xpbd
from softlab.model.base.errors import SceneError
from softlab.model.contact.substep_parameters import (
    constants_of,
    xpbd_record,
)
from softlab.model.core.build import build
from softlab.model.core.energy import energies
from softlab.model.core.families import scene_plan, stability_limit
from softlab.model.core.parameters import parameter_record
from softlab.model.position_based.plan import FAMILIES, colour_order, constraint_count, families, xpbd_parts
from softlab.model.scene.scene import Scene, load_scene

XPBD = {"method.solver": "xpbd"}
CLOTH = {
    "cloth": {"rows": 7, "columns": 10, "spacing": 0.1, "mass": 0.02, "pinned": "top-corners"},
    "structural": {"stiffness": 200.0, "damping": 0.3},
    "shear": {"compliance": 0.0},
    "bending": {"stiffness": 5.0},
    "method": {"solver": "xpbd", "dt": 0.01, "substeps": 4, "iterations": 3},
}


def test_a_scene_can_be_handed_to_another_solver():
    """What the other solver was told falls away; everything else stays."""
    lab = load_scene("lab-grid")
    moved = lab.replace({**XPBD, "method.substeps": 8})
    assert moved.as_dict()["method"] == {
        "solver": "xpbd", "dt": 0.01, "substeps": 8, "iterations": 1, "ordering": "gauss-seidel"
    }  # fmt: skip
    back = moved.replace({"method.solver": "mass-spring", "method.integrator": "lab"})
    assert back.canonical() == lab.canonical()


def test_mass_spring_scenes_keep_their_text():
    """Fields that came later are not written where they say nothing: stores of measurements know scenes by their text."""
    method = load_scene("lab-grid").as_dict()["method"]
    assert method == {"solver": "mass-spring", "integrator": "lab", "dt": 0.01}
    assert load_scene("lab-grid").as_dict()["springs"] == {"stiffness": 10.0, "rest_length": 1.0}


def test_stiffness_and_compliance_are_one_material():
    scene = load_scene("lab-grid").replace({"springs.compliance": 0.25})
    assert scene.springs.stiffness == 4.0
    assert scene.as_dict()["springs"] == {"compliance": 0.25, "rest_length": 1.0}
    assert scene.replace({"springs.stiffness": 8.0}).springs.compliance is None
    own = load_scene("lab-grid").replace({"springs.stiffness": 4.0})
    assert np.array_equal(parameter_record(scene, np.float64), parameter_record(own, np.float64))


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"method.substeps": 2}, "method.substeps"),
        ({"method.ordering": "jacobi"}, "method.ordering"),
        ({**XPBD, "method.integrator": "rk4"}, "method.integrator"),
        ({**XPBD, "method.pbd_stiffness": 0.5}, "method.pbd_stiffness"),
        ({**XPBD, "method.substeps": 0}, "method.substeps"),
        ({**XPBD, "method.iterations": 1.5}, "method.iterations"),
        ({**XPBD, "method.ordering": "red-black"}, "method.ordering"),
        ({"method.solver": "pbd", "method.pbd_stiffness": 0.0}, "method.pbd_stiffness"),
        ({"springs.compliance": 0.0}, "springs.compliance"),
        ({**XPBD, "springs.compliance": -0.1}, "springs.compliance"),
        ({"springs.compliance": 0.1, "springs.stiffness": 3.0}, "springs.stiffness"),
        ({"attachments.slack": 0.1}, "attachments.kind"),
        ({**XPBD, "attachments.slack": -0.1}, "attachments.slack"),
        ({**XPBD, "attachments.anchors": 9}, "attachments.anchors"),
        ({**XPBD, "load.at": [0, 99], "load.mass": 1.0}, "load.at"),
        ({**XPBD, "load.at": [0, 1], "load.mass": 0.0}, "load.mass"),
        ({"load.at": [0, 1], "load.mass": 1.0}, "load.kind"),
    ],
)
def test_what_cannot_be_is_refused_by_its_field(changes, field):
    with pytest.raises(SceneError) as refused:
        load_scene("lab-grid").replace(changes)
    assert refused.value.field == field


def test_no_colour_holds_a_mass_twice_and_all_constraints_are_there():
    """The families cover what the reference numbers one by one, colour for colour."""
    scene = Scene(CLOTH)
    parts, grid = xpbd_parts(scene), scene.grid
    numbered = xpbd.of_scene(scene)
    assert constraint_count(scene) == len(numbered.first)
    number = np.arange(grid.rows * grid.columns).reshape(grid.rows, grid.columns)
    for (family, colour), theirs in zip(colour_order(parts), numbered.colours, strict=True):
        ends = []
        for i in range(grid.rows - family.rows):
            for j in range(grid.columns - abs(family.columns)):
                along, stride = (i, family.rows) if family.rows else (j, family.columns)
                if along // stride % 2 == colour:
                    shift = -min(family.columns, 0)
                    ends.append((number[i, j + shift], number[i + family.rows, j + shift + family.columns]))
        masses = np.ravel(ends)
        assert len(np.unique(masses)) == len(masses)
        assert sorted(ends) == sorted(zip(numbered.first[theirs], numbered.second[theirs], strict=True))


def test_colours_are_as_few_as_the_largest_valence():
    """12 springs on a mass inside, 12 colours: no colouring has fewer."""
    scene = Scene(CLOTH)
    numbered = xpbd.of_scene(scene)
    assert len(colour_order(xpbd_parts(scene))) == 12 == numbered.valence(70).max()
    places = [place for family in FAMILIES for place in family.colours]
    assert sorted(places) == list(range(12))
    assert all(a.name != b.name for a, b in combinations(FAMILIES, 2))


def test_parts_are_those_that_need_code():
    scene = Scene(CLOTH)
    parts = xpbd_parts(scene)
    assert {"structural-compliance", "structural-damping", "bending-compliance", "gauss-seidel", "pins"} <= parts
    assert not parts & {"shear-compliance", "shear-damping", "load", "attachments", "gravity", "alternating", "jacobi"}
    soft = scene.replace({"method.solver": "pbd"})
    assert not any(part.endswith(("-compliance", "-damping")) for part in xpbd_parts(soft))
    grid = load_scene("lab-grid").replace({**XPBD, "springs.stiffness_ratio": 10.0, "attachments.slack": 0.0})
    assert {"structural", "structural-compliance", "alternating", "attachments"} <= xpbd_parts(grid)
    assert "attachments" not in xpbd_parts(grid.replace({"grid.pinned": "none"}))  # no anchors
    assert [family.name for family in families(xpbd_parts(grid))] == ["vertical", "horizontal"]


def test_the_plan_runs_stages_as_often_as_it_says():
    scene = Scene(CLOTH | {"gravity": {}})
    names = [stage.name for stage in scene_plan(scene).root.stages()]
    assert names.count("predict") == names.count("update velocity") == names.count("gravity") == 4
    assert names.count("project falling 1") == 4 * 3
    assert len([name for name in names if name.startswith("project")]) == 4 * 3 * 12
    jacobi = scene_plan(scene.replace({"method.ordering": "jacobi"}))
    assert [s.name for s in jacobi.root.stages()].count("project all") == 12


def test_the_record_holds_the_papers_constants():
    """XPBD 2016, eq. 18 and 26, with masses counted in the sheet's: a~ m = alpha m / h^2, gamma = alpha beta / h."""
    scene = Scene(CLOTH | {"damping": {"coefficient": 0.05}, "gravity": {}})
    h, m = 0.01 / 4, 0.02
    record = xpbd_record(scene, np.float64)[0]
    assert (record.dt, record.gravity) == (h, -9.81)
    assert record.keep == 1 - h * 0.05 / m
    alpha, gamma = m / 200 / h**2, 0.3 / 200 / h
    structural, shear = (constants_of(xpbd_record(scene, np.float64), kind) for kind in ("structural", "shear"))
    assert structural._asdict() == pytest.approx(
        {
            "rest": 0.1, "compliance": alpha, "damping": gamma, "stiffening": 1 + gamma,
            "both": 1 / (2 * (1 + gamma) + alpha), "one": 1 / (1 + gamma + alpha),
        },
        rel=1e-14,
    )  # fmt: skip
    assert shear == (pytest.approx(0.1 * 2**0.5), 0, 0, 1, 0.5, 1)
    soft = xpbd_record(scene.replace({"method.solver": "pbd", "method.pbd_stiffness": 0.25}), np.float64)
    assert constants_of(soft, "structural") == (0.1, 0, 0, 4, 0.125, 0.25)


def test_the_masses_damper_sets_the_only_limit():
    """v (1 - h c/m) grows from h c/m = 2 on; without a damper any step size holds."""
    scene = load_scene("lab-grid").replace({**XPBD, "method.substeps": 5})
    assert stability_limit(scene) == pytest.approx(2 * 5 * 0.01 / 0.03)
    assert stability_limit(scene.replace({"damping.coefficient": 0.0})) == np.inf


def test_a_load_weighs_in_inverse_mass_and_energy():
    scene = load_scene("lab-grid").replace({**XPBD, "load.at": [3, 2], "load.mass": 1.0})
    body = build(scene)
    assert body.inverse_mass[3 * 32 + 2] == 1.0
    velocity = np.zeros_like(body.velocity)
    velocity[3 * 32 + 2] = [0.0, 2.0]
    found = energies(scene, body.position, velocity)
    assert found["kinetic"] == 2.0
    height = 9.81 * (0.01 * body.position[:, 1].sum() + 0.99 * body.position[3 * 32 + 2, 1])
    assert found["gravity"] == pytest.approx(height, rel=1e-12)


def test_what_cannot_stretch_stores_nothing():
    scene = load_scene("lab-grid").replace({**XPBD, "springs.compliance": 0.0})
    assert energies(scene, 1.1 * build(scene).position, build(scene).velocity)["spring"] == 0
