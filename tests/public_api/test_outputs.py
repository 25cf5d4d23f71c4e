"""The outputs that each family declares: `read` returns each with the declared shape, and refuses all others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.families import family_of
from softlab.model.core.family import Field
from softlab.model.core.state import FAMILY_ARRAYS
from softlab.model.fluid.family import FLUID
from softlab.model.scene.scene import Scene

XPBD = {"solver": "xpbd", "dt": 0.01}
MATCHING = {"solver": "shape-matching", "dt": 0.01}
JELLY: dict[str, Any] = {
    "kind": "soft_body",
    "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]},
    "particle_spacing": 0.1,
    "density": 1000,
}
BEAM: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.25, 0.125, 0.125]}, "edge": 0.125,
    "young_modulus": 1e4, "density": 64.0,
}  # fmt: skip
WATER: dict[str, Any] = {"kind": "fluid", "size": [0.1, 0.1, 0.1], "rest_distance": 0.05, "origin": [0.0, -1.0, 0.0]}
SCENES: dict[str, dict[str, Any]] = {
    "grid": {"grid": {"rows": 3, "columns": 4}, "springs": {}, "method": {"dt": 0.001}},
    "cloth": {"cloth": {"rows": 3, "columns": 4, "spacing": 0.1}, "structural": {}, "method": XPBD},
    "bodies": {"jelly": JELLY, "method": MATCHING},
    "plastic bodies": {"jelly": {**JELLY, "plastic_creep": 1.0}, "method": MATCHING},
    "tetrahedra": {"beam": BEAM, "method": XPBD},
    "implicit tetrahedra": {"beam": BEAM, "method": {"solver": "newton", "dt": 0.01}},
    "fluid": {"water": WATER, "method": {"solver": "pbf", "dt": 0.01}},
    "world": {"beam": BEAM, "water": WATER, "method": {**XPBD, "solver": "world"}},
}
OWN = {
    "grid": {"strain"}, "cloth": {"strain", "normal"}, "bodies": {"rotation", "centre", "deformation"},
    "plastic bodies": {"rotation", "centre", "deformation", "plastic"}, "tetrahedra": {"strain", "normal"},
    "fluid": {"strain", "pressure", "neighbours_lost", "speed_limited"},
    "world": {"strain", "normal", "neighbours_lost", "speed_limited"},
    "implicit tetrahedra": {"strain", "normal", "matrices", "newton_steps", "matrix_products"},
}  # fmt: skip


def shape_of(field: Field, simulation: Any) -> tuple[int | str, ...]:
    """Return the shape that the declaration names, with the number of rows in words where only the family knows it."""
    particles, dimensions = simulation.body.position.shape
    rows: tuple[int | str, ...] = (particles,) if field.rows == "particles" else (field.rows,)
    return (*rows, *(dimensions if side == "dimensions" else side for side in field.shape))


@pytest.mark.parametrize("name", SCENES)
def test_each_output_has_its_shape_and_no_other_is_read(name: str) -> None:
    with open_simulation(Scene(SCENES[name]), "cpu") as simulation:
        simulation.advance(1)
        assert set(simulation.outputs) == {"position", "velocity"} | OWN[name]
        for field in simulation.outputs.values():
            value = simulation.read(field.name)
            assert field.doc and field.unit
            if field.rows == "one":
                assert isinstance(value, int | float) and value == simulation.counters()[field.name]
                continue
            shape = shape_of(field, simulation)
            assert value.shape == tuple(
                b if isinstance(b, int) else a for a, b in zip(value.shape, shape, strict=True)
            ), field
            into = np.full_like(value, np.nan)
            assert simulation.read(field.name, into) is into and np.array_equal(into, value)
        for absent in {"pressure", "normal", "rotation", "taps", "nonsense"} - set(simulation.outputs):
            with pytest.raises(SceneError, match=f"must be one of {', '.join(simulation.outputs)}$"):
                simulation.read(absent)


def test_arrays_of_families_are_attributes_of_a_state() -> None:
    """Each array of a state that a family declares is one of State's, and the other way round."""
    emitter = {"kind": "emitter", "fluid": "water", "radius": 0.1}
    pour = {"water": {**WATER, "capacity": 100}, "tap": emitter, "method": SCENES["fluid"]["method"]}
    declared = set()
    for tables in (*SCENES.values(), pour):
        scene = Scene(tables)
        declared |= {field.name for field in family_of(scene).fields(scene) if field.is_state}
    assert declared == set(FAMILY_ARRAYS)


def test_an_output_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example in docs/add-a-solver.md: one entry of a family, and `read` returns it."""
    page = (Path(__file__).parents[2] / "docs/add-a-solver.md").read_text(encoding="utf-8")
    example: dict[str, Any] = {}
    exec(page.split("## An output")[1].split("```python\n")[1].split("```")[0], example)
    declared, density = FLUID.fields, example["DENSITY"]
    monkeypatch.setitem(vars(FLUID), "fields", lambda scene: (*declared(scene), density))
    scene = Scene({"water": WATER, "gravity": {"acceleration": 10.0}, "method": SCENES["fluid"]["method"]})
    with open_simulation(scene, "cpu", precision="float64") as simulation:
        simulation.advance(1)
        np.testing.assert_allclose(simulation.read("kinetic_energy_density"), 500 * 0.1**2, rtol=1e-10)
