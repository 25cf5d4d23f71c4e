"""Folded cloths of the catalogue come to rest on the CPU, and stay out of themselves; the row B19's thickness is refused."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring
from softlab.model.contact.penetration import measure
from softlab.model.core.build import build
from softlab.model.scene.scene import load_scene

NAMES = ("cloth-self", "hard/b18", "hard/b19")


@pytest.mark.parametrize("name", NAMES)
def test_the_reference_starts_them_alike(name: str) -> None:
    scene = load_scene(name)
    assert np.abs(mass_spring.start(scene)[0] - build(scene).position).max() < 1e-14


@pytest.mark.parametrize(("name", "changes", "seconds"), [
    ("hard/b18", {"cloth.rows": 32, "fold.rows": 8, "cloth.columns": 6}, 1.5),
    ("hard/b19", {}, 1.0),
])  # fmt: skip
def test_layers_come_to_rest_apart(name: str, changes: dict[str, int], seconds: float) -> None:
    """B18 (four layers of 8 x 6 here) and B19: kinetic energy under 1e-3 of its peak, no gap under 0.8 thicknesses, no edge
    through a triangle. Without contacts all layers lie in one place."""
    scene = load_scene(name).replace(changes)
    grid, part = scene.grid, scene.self_collision
    assert part is not None
    peak = 0.0
    with open_simulation(scene, "cpu", threads=1) as simulation:
        for _ in range(round(seconds / scene.method.dt)):
            simulation.advance(1)
            energy = float((simulation.read("velocity").astype(np.float64) ** 2).sum())
            peak = max(peak, energy)
        position = simulation.read("position").astype(np.float64)
    found = measure(grid.rows, grid.columns, grid.spacing, position, part.thickness)
    assert energy < 1e-3 * peak
    assert found.min_gap > 0.8 * part.thickness
    assert found.crossings == 0
