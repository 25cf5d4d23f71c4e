"""Live fields reach the water of a world on CUDA, in plain Python."""

from __future__ import annotations

import numpy as np
from wet_scenes import wet_scene
from world_scenes import moving

from softlab.app.driver import open_simulation


def test_live_fields_reach_the_water() -> None:
    """What is set is set for all members: without gravity they move as if they had never had any."""
    scene = wet_scene("tetrahedra")
    ends = []
    for given, live in ((scene, ("gravity",)), (scene.replace({"gravity.enabled": False}), ())):
        options = {"initial": moving(scene, 0.001), "math": "exact", "precision": "float64", "kernel": "launch"}
        with open_simulation(given, "gpu", live=live, **options) as simulation:  # type: ignore[arg-type]
            if live:
                simulation.set("gravity.enabled", False)
            simulation.advance(1)
            ends.append(simulation.state().position)
    assert np.abs(ends[0] - ends[1]).max() < 1e-12
