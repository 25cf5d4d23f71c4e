"""What rises or sinks in water (Genesis, issue 2070), against buoyancy and the added mass of potential flow.

A cube begins as those say. Then the packing of the water's particles holds it back: a fluid of particles under pressure
resists shear (model/fluid/shear.py), by its modulus and, once it gives way, as grains do (docs/method/fluids.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ideal_flow import added_mass
from test_archimedes import HOW, D, in_tank

from softlab.app.driver import open_simulation
from softlab.model.core.state import State
from softlab.model.fluid.shear import shear_lines
from softlab.model.scene.scene import Scene

G, WATER, LAYERS = 9.81, 1000.0, 6
TANK, BELOW, ABOVE = 14, 5, 5  # layers
SETTLING, EARLY, LATE = 60, 6, 30  # steps of 1/60 s


def submerged(density: float, substeps: int, above: int = ABOVE) -> Scene:
    """A cube of 6 layers in the middle of a tank of water without viscosity, 14 layers wide, `above` layers over it."""
    scene = in_tank(density, (LAYERS, LAYERS), TANK, BELOW, LAYERS, above)
    return scene.replace({"method.substeps": substeps, "water.viscosity": 0.0})


def settled(substeps: int, above: int = ABOVE) -> tuple[State, float]:
    """Water a second later, around a cube of its own density that is put back to its place after each step, and the mean
    push on the cube in the last third of it, over its weight."""
    scene, pushes = submerged(WATER, substeps, above), []
    block = scene.world_set.slices()["bodies"]
    with open_simulation(scene, **HOW) as simulation:
        start = simulation.state()
        for _ in range(SETTLING):
            simulation.advance(1)
            state = simulation.state()
            pushes.append(1 + state.velocity[block, 1].mean() / scene.method.dt / G)
            position, velocity = state.position.copy(), state.velocity.copy()
            position[block], velocity[block] = start.position[block], 0
            state = replace(state, position=position, velocity=velocity)
            simulation.load(state)
    return state, float(np.mean(pushes[-SETTLING // 3 :]))


def moved(density: float, substeps: int, start: State, above: int = ABOVE) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m] by which the cube has risen, and its speeds [m/s], after each step."""
    scene = submerged(density, substeps, above)
    block, heights, speeds = scene.world_set.slices()["bodies"], [], []
    with open_simulation(scene, **HOW) as simulation:
        simulation.load(replace(simulation.state(), position=start.position, velocity=start.velocity))
        for _ in range(LATE):
            simulation.advance(1)
            heights.append(float((simulation.read("position")[block, 1] - start.position[block, 1]).mean()))
            speeds.append(float(simulation.read("velocity")[block, 1].mean()))
    return np.array(heights), np.array(speeds)


def test_potential_flow_knows_the_added_mass_of_a_cube() -> None:
    """0.67 of the displaced mass in water without end; the surface and the walls of a tank that is 8 times as wide hardly
    change it."""
    assert added_mass(4, 32, 14, 14, 1) == pytest.approx(0.67, abs=0.03)


@pytest.mark.rest
@pytest.mark.parametrize("substeps", [2, 4, 8])
def test_a_cube_rises_and_sinks_as_its_density_says(substeps: int) -> None:
    """g (rho_w - rho) / (rho + C rho_w), C the added mass. Half the difference of 900 and 1100 kg/m^3 leaves out what the
    settling water does to both: after the first step it is that of the law within a tenth (0.98 to 1.06 of it measured),
    whatever the substeps. After 0.1 s the packing has taken a third of the speed, and after half a second it bears both
    cubes, or nearly. One of 500 has gained 0.8 of the law over 0.1 s, with the push that was measured."""
    start, push = settled(substeps)
    added = added_mass(LAYERS, TANK, BELOW, ABOVE, 1)

    def law(density: float, buoyancy: float = 1.0) -> float:
        return G * (WATER * buoyancy - density) / (density + added * WATER)

    assert push == pytest.approx(1, abs=0.07)
    (up, rising), (down, sinking) = (moved(density, substeps, start) for density in (900.0, 1100.0))
    times = np.arange(1, LATE + 1) / 60
    gained = (rising - sinking) / (law(900.0) - law(1100.0)) / times
    assert gained[0] == pytest.approx(1, abs=0.1)
    assert 0.5 < gained[EARLY - 1] < 1
    assert up[-1] > D / 3 and down[-1] < -D / 10
    height, _ = moved(500.0, substeps, start)
    assert 0.75 < 2 * height[EARLY - 1] / times[EARLY - 1] ** 2 / law(500.0, push) < 1


@pytest.mark.rest
def test_deeper_water_holds_a_body_back_more() -> None:
    """Speed gained by 0.1 s over that of the first step, each over its time: 0.67 and 0.48 measured under a layer and under
    15. In a fluid the pressure is without effect."""
    remains = []
    for above in (1, 15):
        start, _ = settled(4, above)
        gained = moved(900.0, 4, start, above)[1] - moved(1100.0, 4, start, above)[1]
        remains.append(gained[EARLY - 1] / EARLY / gained[0])
    assert remains[1] < remains[0] - 0.1, remains


def test_a_run_notes_bodies_that_the_lattice_supports() -> None:
    """The same cubes: those of 900 and 1100 kg/m^3, not one of 500, nor one of the water's own density."""
    notes = {density: shear_lines(submerged(density, 4)) for density in (500.0, 900.0, 1000.0, 1100.0)}
    assert notes[500.0] == [] == notes[1000.0]
    for density in (900.0, 1100.0):
        (line,) = notes[density]
        assert line.startswith("block: ") and "shear of 0.57" in line
