"""Water at rest gains energy (SPlisHSPlasH, issue 179): the correction did not follow the gradient of its constraint.

Bounds: kinetic and potential energy per mass stay below the start plus 1e-3 g H, and the rms speed below 2 % of sqrt(g H).
Viscosity is 0. A substep of 1/60 s is too coarse for `averaged` and `divergence-free` (a note of the run says so).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.driver import open_simulation
from model.core.state import State
from model.fluid.family import fluid_note
from model.scene.scene import Scene

G, SIDE, HEIGHT = 9.81, 0.4, 0.5
METHOD = {"solver": "pbf", "dt": 1 / 60, "iterations": 10}
SCHEMES = ("macklin", "averaged", "divergence-free")
SLOW = 0.02  # of sqrt(g H); after 6 s at most 0.013 is measured of divergence-free, 0.006 of the others


def tank(scheme: str, substeps: int, spacing: float = 0.05) -> Scene:
    """Water between a floor and four walls, on the lattice."""
    sides = {"left": (1, 0, 0), "right": (-1, 0, 0), "back": (0, 0, 1), "front": (0, 0, -1)}
    walls: dict[str, Any] = {
        name: {
            "kind": "plane", "thickness": 0.0, "normal": [float(x) for x in normal],
            "point": [SIDE * (normal[0] < 0), 0.0, SIDE * (normal[2] < 0)],
        }
        for name, normal in sides.items()
    }  # fmt: skip
    water = {"kind": "fluid", "size": [SIDE, HEIGHT, SIDE], "rest_distance": spacing}
    floor = {"kind": "plane", "thickness": 0.0}
    method = METHOD | {"scheme": scheme, "substeps": substeps}
    return Scene({"water": water, "floor": floor, **walls, "gravity": {}, "method": method}, "Still tank")


def states(scene: Scene, seconds: float, disturbance: float = 0.0, **how: Any) -> list[State]:
    """The start, then a state each quarter of a second; `disturbance` [m] of every coordinate of the start, at most."""
    with open_simulation(scene, **({"precision": "float32", "math": "fast"} | how)) as simulation:
        start = simulation.state()
        if disturbance:
            shifts = np.random.default_rng(1).uniform(-disturbance, disturbance, start.position.shape)
            start = replace(start, position=start.position + shifts)
            simulation.load(start)
        found = [start]
        for _ in range(round(4 * seconds)):
            simulation.advance(15)
            found.append(simulation.state())
    return found


def energy(state: State) -> float:
    """Kinetic and potential energy per mass, over g H."""
    velocity, y = np.asarray(state.velocity, np.float64), np.asarray(state.position, np.float64)[:, 1]
    return float(((velocity**2).sum(axis=1) / 2 + G * y).mean() / (G * HEIGHT))


def rms(state: State) -> float:
    """Rms speed over sqrt(g H)."""
    return float(np.sqrt((np.asarray(state.velocity, np.float64) ** 2).sum(axis=1).mean() / (G * HEIGHT)))


def check(scene: Scene, seconds: float) -> None:
    first, *others = states(scene, seconds)
    assert max(energy(state) for state in others) <= energy(first) + 1e-3
    assert max(rms(state) for state in others[-4:]) < SLOW


@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_at_rest_stays_at_rest(scheme: str) -> None:
    check(tank(scheme, 4), 2.5)


@pytest.mark.rest
@pytest.mark.parametrize("substeps", [2, 4, 8, 16])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_stays_at_rest_at_any_substep(scheme: str, substeps: int) -> None:
    check(tank(scheme, substeps), 6)


@pytest.mark.rest
def test_macklin_stays_at_rest_in_one_substep() -> None:
    check(tank("macklin", 1), 6)


@pytest.mark.parametrize("substeps", [1, 4, 16])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_disturbed_lattice_does_not_boil(scheme: str, substeps: int) -> None:
    """A filled repeating box whose particles are off by 1e-6 m: speeds stay of that size over a substep."""
    side, shift = 0.3, 1e-6
    box = {"size": [side] * 3, "repeats": ["x", "y", "z"]}
    water = {"kind": "fluid", "size": [side] * 3, "rest_distance": 0.05}
    scene = Scene({"water": water, "domain": box, "method": METHOD | {"scheme": scheme, "substeps": substeps}}, "Box")
    found = states(scene, 1.5, shift, precision="float64", math="exact")
    fastest = max(float(np.abs(np.asarray(state.velocity, np.float64)).max()) for state in found[1:])
    assert fastest < 10 * shift * 60 * substeps


def test_a_substep_too_coarse_for_rest_is_noted() -> None:
    assert "does not come to rest" in fluid_note(tank("divergence-free", 1))
    assert "does not come to rest" in fluid_note(tank("averaged", 1))
    assert "does not come to rest" not in fluid_note(tank("macklin", 1)) + fluid_note(tank("divergence-free", 2))
