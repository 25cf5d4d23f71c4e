"""Emitters on CUDA, in plain Python: what came is taken back, and a tap is turned."""

from __future__ import annotations

from bits_row import different
from flow_scenes import FLOWS

from softlab.app.driver import open_simulation


def test_what_came_is_taken_back_and_a_tap_is_turned() -> None:
    scene = FLOWS["flat tap"]()
    with open_simulation(scene, "gpu", math="exact", precision="float64", live=("taps",)) as simulation:
        simulation.advance(2)
        first = simulation.state()
        simulation.advance(2)
        simulation.rewind()
        assert not different(simulation.state(), first)
        simulation.set("tap.speed", 1.0)
        simulation.advance(1)
        with open_simulation(scene.replace({"tap.speed": 1.0}), math="exact", precision="float64") as other:
            other.load(simulation.state())
            simulation.advance(1)
            other.advance(1)
            assert not different(other.state(), simulation.state())
