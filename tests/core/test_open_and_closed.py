"""The two ends of a simulation: warming up changes nothing, and a closed one says that it is closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import InputError
from softlab.model.core.simulation import Simulation
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene, load_scene

BOX = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]}, "edge": 0.1}
LUMP = {"kind": "soft_body", "shape": {"name": "box", "sides": [0.05, 0.05, 0.05]}, "particle_spacing": 0.025}
SCENES = {
    "grid": load_scene("lab-grid").replace({"grid.rows": 4, "grid.columns": 5}),
    "bodies": Scene({"lump": LUMP, "gravity": {}}),
    "world": Scene({"box": BOX, "lump": LUMP | {"origin": [0.0, 1.0, 0.0]}, "gravity": {}}),
}


@pytest.mark.parametrize("name", SCENES)
def test_warming_up_keeps_the_state_and_what_follows(name: str) -> None:
    ends = []
    for steps in (0, 1, 3):
        with open_simulation(SCENES[name], math="exact", precision="float64") as simulation:
            if steps:
                simulation.warm_up(steps)
            assert (simulation.step, simulation.time) == (0, 0.0)
            simulation.advance(4)
            ends.append(simulation.state())
    for end in ends[1:]:
        assert np.array_equal(end.position, ends[0].position) and np.array_equal(end.velocity, ends[0].velocity)


CALLS: dict[str, Callable[[Simulation, State], object]] = {
    "advance": lambda simulation, state: simulation.advance(1),
    "warm_up": lambda simulation, state: simulation.warm_up(),
    "state": lambda simulation, state: simulation.state(),
    "load": lambda simulation, state: simulation.load(state),
    "reset": lambda simulation, state: simulation.reset(),
    "read": lambda simulation, state: simulation.read("position"),
    "read strain": lambda simulation, state: simulation.read("strain"),
    "set": lambda simulation, state: simulation.set("gravity.enabled", False),
    "poke": lambda simulation, state: simulation.poke(None),
    "energies": lambda simulation, state: simulation.energies(),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_called_after_close_is_told_so(name: str) -> None:
    with open_simulation(SCENES[name]) as simulation:
        state = simulation.state()
    simulation.close()  # a second time does no harm
    for call in CALLS.values():
        with pytest.raises(InputError, match="this simulation is closed"):
            call(simulation, state)
