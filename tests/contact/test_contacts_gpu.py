"""A cloth stays out of itself on a real GPU in `fast` math."""

from __future__ import annotations

import pytest

from softlab.app.driver import open_simulation
from softlab.model.contact.penetration import measure
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


def test_fast_math_keeps_the_cloth_out_of_itself() -> None:
    """After two seconds on the floor: as for the CPU in test_contacts_scenes.py."""
    scene = load_scene("hard/b18")
    with open_simulation(scene, "gpu") as simulation:
        simulation.advance(120)
        position = simulation.read("position")
    found = measure(scene.grid.rows, scene.grid.columns, scene.grid.spacing, position, scene.self_collision.thickness)  # type: ignore[union-attr]
    assert found.min_gap > 0.8 * scene.self_collision.thickness  # type: ignore[union-attr]
    assert found.crossings == 0
