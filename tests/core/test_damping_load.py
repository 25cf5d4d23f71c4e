"""Damping that the sweeps of a substep do not resolve holds up loads at rest: a run notes it; no catalogue scene has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from softlab.app.command.run import Request, run_scene
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tetrahedra.contact_sag import sag_lines
from softlab.model.tetrahedra.damping_load import UNRESOLVED, damping_lines, damping_load

CATALOGUE = Path(__file__).parents[2] / "model" / "catalogue"
BODIES = sorted(path.stem for path in CATALOGUE.glob("*.toml") if "tetrahedral_body" in path.read_text())
BOX = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]},
    "edge": 0.1,
    "young_modulus": 1e6,
}


def boxes(tau: float, **method: object) -> Scene:
    return Scene(
        {"one": BOX | {"damping": tau}, "two": BOX, "method": {"solver": "xpbd", "dt": 1 / 60} | method}, "boxes"
    )


@pytest.mark.parametrize("name", BODIES)
def test_no_catalogue_scene_damps_more_than_it_resolves_or_sags_on_colliders(name: str) -> None:
    assert damping_lines(load_scene(name)) == sag_lines(load_scene(name)) == []


def test_the_load_is_that_of_its_formula() -> None:
    """tau h E / (rho e^2), over the iterations; e is the mean edge of a voxel's surface, between its side and diagonal."""
    load = damping_load(boxes(0.1, substeps=4, iterations=2))
    side = 0.1 * (1 / 240) * 1e6 / (1000 * 0.1**2) / 2
    assert side / 2 < load[0] < side and load[1] == 0
    assert damping_load(boxes(0.1, substeps=8, iterations=2))[0] == pytest.approx(load[0] / 2)
    assert damping_load(boxes(0.1, substeps=4, iterations=4))[0] == pytest.approx(load[0] / 2)
    assert damping_load(boxes(0.05, substeps=4, iterations=2))[0] == pytest.approx(load[0] / 2)


def test_a_run_notes_it_and_names_what_helps() -> None:
    result = run_scene(boxes(0.1), Request(steps=0), progress=False)
    (note,) = [note for note in result.notes if "one.damping = 0.1 s" in note]
    limit = 0.1 / damping_load(boxes(0.1))[0]
    assert f"reduce it to {limit:.2g} s" in note and damping_lines(boxes(limit)) == []
    times = int(note.split("take ")[1].split()[0])
    substeps = times * boxes(0.1).method.substeps
    assert damping_load(boxes(0.1, substeps=substeps))[0] <= 1 < UNRESOLVED
    assert damping_lines(boxes(0.0)) == [] and damping_lines(boxes(0.1, solver="newton")) == []
