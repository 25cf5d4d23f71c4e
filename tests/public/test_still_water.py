"""Water at rest gains energy (SPlisHSPlasH, issue 179): the correction did not follow the gradient of its constraint.

Kinetic and potential energy per mass stay below the start plus 1e-3 g H, and speeds below 1.5 times what was measured.
Viscosity is 0. A substep of 1/60 s is too coarse for `averaged` and `divergence-free` (a note of the run says so).
"""

from __future__ import annotations

from typing import Any

import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.fluid_rest import (
    ENERGY_BOUND,
    GRAVITY,
    SPEED,
    disturb,
    repeating_box,
    rms,
    still_tank,
    watched,
)
from softlab.bench.experiments.fluid_truth.scenes import SCHEMES
from softlab.bench.experiments.fluids import FRAME
from softlab.model.fluid.family import fluid_note

# by seconds: rms speed over sqrt(g H) in the last span; 1.5 times the largest measured, with 2 to 16 substeps (macklin: 1)
SLOW = {
    "macklin": {4: 0.018, 8: 0.006},
    "averaged": {4: 0.024, 8: 0.006},
    "divergence-free": {4: 0.026, 8: 0.018},
}


def check(scheme: str, substeps: int, seconds: int) -> None:
    with open_simulation(still_tank(scheme, substeps)) as simulation:
        found = watched(simulation, GRAVITY, seconds)
    largest = {name: value for name, (value, _, _) in found.items()}
    assert max(value for name, value in largest.items() if not name.startswith(SPEED)) <= ENERGY_BOUND
    assert largest[f"{SPEED}{seconds}"] < SLOW[scheme][seconds]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_at_rest_stays_at_rest(scheme: str) -> None:
    check(scheme, 4, 4)


@pytest.mark.rest
@pytest.mark.parametrize("substeps", [2, 4, 8, 16])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_stays_at_rest_at_any_substep(scheme: str, substeps: int) -> None:
    check(scheme, substeps, 8)


@pytest.mark.rest
def test_macklin_stays_at_rest_in_one_substep() -> None:
    check("macklin", 1, 8)


@pytest.mark.rest
@pytest.mark.parametrize(("scheme", "substeps"), [("averaged", 8), ("divergence-free", 4)])
def test_the_lattice_of_a_tank_is_an_unstable_balance(scheme: str, substeps: int) -> None:
    """Water that a drag has calmed for 4 s moves again without it: what is left of its speed grows at 8 to 9 /s until the
    lattice gives way (0.7 and 1.1 % of sqrt(g H) measured), which releases the energy of 13 and 30 um of height. No
    substep shortens that, so that speeds at rest do not fall with substeps."""
    scene = still_tank(scheme, substeps)
    how: dict[str, Any] = {"precision": "float64", "threads": 1}
    with open_simulation(scene.replace({"water.drag": 5.0}), **how) as simulation:
        simulation.advance(240)
        calm = simulation.state()
    speeds = []
    with open_simulation(scene, **how) as simulation:
        simulation.load(calm)
        for _ in range(16):
            simulation.advance(15)
            speeds.append(rms(simulation.read("velocity")))
    assert rms(calm.velocity) < 1e-4
    assert 3 < speeds[1] / speeds[0] < 20, speeds
    assert 0.003 < max(speeds) < SLOW[scheme][4], speeds


@pytest.mark.parametrize("substeps", [1, 4, 16])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_disturbed_lattice_does_not_boil(scheme: str, substeps: int) -> None:
    """A filled repeating box whose particles are off by 1e-6 m: they come back at no more than 1.2 times that over a substep
    (0.79 measured), and from half a second on at no more than a tenth (0.064 measured); in the end at 2.5e-7 of the tank's
    sqrt(g H), rms (1.6e-7 measured)."""
    shift = 1e-6
    with open_simulation(repeating_box(scheme, substeps), precision="float64", math="exact") as simulation:
        disturb(simulation, shift)
        speeds = []
        for _ in range(90):
            simulation.advance(1)
            speeds.append(float(abs(simulation.read("velocity")).max()) / (shift * substeps / FRAME))
        assert rms(simulation.read("velocity")) < 2.5e-7
    assert 0 < max(speeds) < 1.2
    assert max(speeds[30:]) < 0.1


def test_a_substep_too_coarse_for_rest_is_noted() -> None:
    assert "does not come to rest" in fluid_note(still_tank("divergence-free", 1))
    assert "does not come to rest" in fluid_note(still_tank("averaged", 1))
    assert "does not come to rest" not in fluid_note(still_tank("macklin", 1)) + fluid_note(
        still_tank("divergence-free", 2)
    )
