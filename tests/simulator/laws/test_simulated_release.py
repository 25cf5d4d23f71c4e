"""Pins that let go on the GPU's kernels, in plain Python: a restart pins again, and a state goes on."""

from __future__ import annotations

import numpy as np
from release_scenes import LETS_GO, MORE, release_scene

from softlab.app.driver import open_simulation


def test_a_restart_pins_again_and_a_state_goes_on() -> None:
    scene = release_scene("mesh")
    with open_simulation(scene, "gpu", math="exact", precision="float64") as simulation:
        simulation.advance(LETS_GO)
        middle = simulation.state()
        simulation.advance(MORE)
        end = simulation.state()
        simulation.reset()
        assert len(simulation.body.pinned) == 6
        simulation.load(middle)
        assert not len(simulation.body.pinned)
        simulation.advance(MORE)
        assert np.array_equal(simulation.state().position, end.position)
