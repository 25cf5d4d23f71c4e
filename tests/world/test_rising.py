"""What rises or sinks in water (Genesis, issue 2070): acceleration by buoyancy with added mass."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_archimedes import D, HOW, in_tank

from softlab.app.driver import open_simulation
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

G, WATER, LAYERS = 9.81, 1000.0, 6
SETTLING, WATCHED = 60, 6  # steps of 1/60 s


def submerged(density: float, substeps: int) -> Scene:
    """A cube of 6 layers in the middle of a tank of 14 x 16 x 14 layers of water."""
    return in_tank(density, (LAYERS, LAYERS), 14, 5, LAYERS, 5).replace({"method.substeps": substeps})


def settled(substeps: int) -> State:
    """Water a second later, around a cube of its own density that is put back to its place after each step."""
    scene = submerged(WATER, substeps)
    block = scene.world_set.slices()["bodies"]
    with open_simulation(scene, **HOW) as simulation:
        start = simulation.state()
        for _ in range(SETTLING):
            simulation.advance(1)
            state = simulation.state()
            position, velocity = state.position.copy(), state.velocity.copy()
            position[block], velocity[block] = start.position[block], 0
            state = replace(state, position=position, velocity=velocity)
            simulation.load(state)
    return state


def acceleration(scene: Scene, start: State) -> float:
    """Mean acceleration [m/s^2] of the cube over its first 0.1 s, 2 y / t^2."""
    block = scene.world_set.slices()["bodies"]
    with open_simulation(scene, **HOW) as simulation:
        simulation.load(replace(simulation.state(), position=start.position, velocity=start.velocity))
        simulation.advance(WATCHED)
        end, time = simulation.read("position"), WATCHED * scene.method.dt
    return float(2 * (end[block, 1] - start.position[block, 1]).mean() / time**2)


@pytest.mark.rest
@pytest.mark.parametrize("substeps", [4, 16])
def test_a_cube_rises_and_sinks_as_its_density_says(substeps: int) -> None:
    """g (rho_w - rho) / (rho + C rho_w), C the added mass: 0.5 (sphere) to 0.9 (a cube between these walls). Of 500 kg/m^3
    it gains 3.5 to 4.9 m/s^2; the method's own resistance takes up to a sixth of the lower bound off. 900 and 1100 go up and
    down; of their difference, from which the error of the push at rest (5 %) drops out, as much."""
    start = settled(substeps)
    found = {rho: acceleration(submerged(rho, substeps), start) for rho in (500.0, 900.0, 1100.0)}

    def law(rho: float, added: float) -> float:
        return G * (WATER - rho) / (rho + added * WATER)

    assert law(500.0, 0.9) * 5 / 6 < found[500.0] < law(500.0, 0.5), found
    assert found[900.0] > 0 > found[1100.0], found
    apart = [law(900.0, added) - law(1100.0, added) for added in (0.9, 0.5)]
    assert apart[0] * 2 / 3 < found[900.0] - found[1100.0] < apart[1], found
