"""Pins that let go on the GPU's kernels, in plain Python: the bits of the CPU, in one call and from a state."""

from __future__ import annotations

import numpy as np
import pytest
from release_scenes import LETS_GO, MORE, TABLES, end_state, release_scene

from softlab.app.driver import open_simulation


@pytest.mark.parametrize("name", TABLES)
def test_bits_are_the_cpus(name: str) -> None:
    scene = release_scene(name)
    expected = end_state(scene, "cpu")
    state = end_state(scene, "gpu")
    assert (state.inverse_mass > 0).all()
    assert np.array_equal(state.position, expected.position) and np.array_equal(state.velocity, expected.velocity)


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
