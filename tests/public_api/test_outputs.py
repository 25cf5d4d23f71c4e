"""The outputs that each family declares: `read` returns each with the declared shape, and refuses all others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.family import Output, on_host
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
    "fluid": {"water": WATER, "method": {"solver": "pbf", "dt": 0.01}},
    "world": {"beam": BEAM, "water": WATER, "method": {**XPBD, "solver": "world"}},
}
OWN = {
    "grid": {"strain"}, "cloth": {"strain", "normal"}, "bodies": {"rotation", "centre", "deformation"},
    "plastic bodies": {"rotation", "centre", "deformation", "plastic"}, "tetrahedra": {"strain", "normal"},
    "fluid": {"strain", "pressure"}, "world": {"strain", "normal"},
}  # fmt: skip


def shape_of(output: Output, simulation: Any) -> tuple[int | None, ...]:
    """Return the shape that the declaration names; None for a number that only the family knows."""
    particles, dimensions = simulation.body.position.shape
    known = {"particles": particles, "dimensions": dimensions}
    return tuple(
        known.get(word) or (int(word) if word.isdigit() else None) for word in output.shape.strip("(),").split(", ")
    )


@pytest.mark.parametrize("name", SCENES)
def test_each_output_has_its_shape_and_no_other_is_read(name: str) -> None:
    with open_simulation(Scene(SCENES[name]), "cpu") as simulation:
        simulation.advance(1)
        assert set(simulation.outputs) == {"position", "velocity"} | OWN[name]
        for output in simulation.outputs.values():
            found = simulation.read(output.name)
            wanted = shape_of(output, simulation)
            assert found.ndim == len(wanted) and all(
                b in (None, a) for a, b in zip(found.shape, wanted, strict=True)
            ), output
            into = np.full_like(found, np.nan)
            assert simulation.read(output.name, into) is into and np.array_equal(into, found)
            assert output.doc and output.unit
        for absent in {"pressure", "normal", "rotation", "nonsense"} - set(simulation.outputs):
            with pytest.raises(SceneError, match=f"must be one of {', '.join(simulation.outputs)}$"):
                simulation.read(absent)


def test_an_output_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """As docs/add-a-solver.md adds one: one entry of a family, and `read` returns it."""
    density = Output(
        "kinetic_energy_density", "(particles,)", "J/m^3", "kinetic energy over volume at rest",
        on_host(lambda one: 500.0 * (one.read("velocity").astype(float) ** 2).sum(axis=1)),
    )  # fmt: skip
    declared = FLUID.outputs
    monkeypatch.setitem(vars(FLUID), "outputs", lambda scene: (*declared(scene), density))
    scene = Scene({"water": WATER, "gravity": {"acceleration": 10.0}, "method": SCENES["fluid"]["method"]})
    with open_simulation(scene, "cpu", precision="float64") as simulation:
        simulation.advance(1)
        np.testing.assert_allclose(simulation.read("kinetic_energy_density"), 500 * 0.1**2, rtol=1e-10)
