"""What `softlab run` prints for people: numbers under names that say what they are."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from softlab.app.command.tables import print_report
from softlab.model.core.energy import keeps
from softlab.model.scene.scene import load_scene


@pytest.mark.parametrize(
    "integrator, told", [("lab", r"modified energy +7 J \(2 x kinetic"), ("velocity-verlet", r"total energy +5 J")]
)
def test_an_energy_is_told_by_its_name(integrator: str, told: str) -> None:
    """Of the hand-out's step what its scheme conserves is not the sum of energies (model/core/energy.py), of others it is."""
    report = {
        "method": f"mass-spring {integrator}",
        "kinetic_energy": 2.0,
        "potential_energy": 3.0,
        "error_reason": None,
    }
    text = io.StringIO()
    print_report(Console(file=text), report | {"conserved": 7.0 if integrator == "lab" else 5.0, "error": None}, [])
    assert re.search(told, text.getvalue())


@pytest.mark.parametrize(
    "changes, told",
    [
        ({}, "would conserve without damping"),
        ({"damping.coefficient": 0.0}, "conserves"),
        ({"damping.coefficient": 0.0, "external.magnitude": 0.1}, "would conserve if nothing acted on it"),
    ],
)
def test_an_energy_is_conserved_where_nothing_takes_or_gives_any(changes: dict[str, float], told: str) -> None:
    """A damper takes energy, a random force gives some; one of magnitude 0 is not there."""
    assert keeps(load_scene("lab-grid").replace(changes)) == told
