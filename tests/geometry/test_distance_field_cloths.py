"""Cloths of all solvers on a distance field: nobody enters it, by one thread or two, fused or stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from field_scenes import FALLING

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.formulas.distance_field import SETTLED
from softlab.model.scene.scene import Scene

STEPS = 12


def end_state(scene: Scene, **options: Any) -> State:
    options = {"precision": "float32", "math": "exact", "threads": 1, "allow_unstable": True} | options
    with open_simulation(scene, "cpu", **options) as simulation:
        simulation.advance(STEPS)
        return simulation.state()


@pytest.mark.parametrize("name", ["xpbd", "mesh", "rk4", "velocity-verlet", "implicit-euler"])
def test_nobody_enters_it(name: str) -> None:
    """After the last contact no mass is nearer than the thickness, less 1/64 and roundings of a metre."""
    scene = FALLING[name]()
    part: Any = scene.parts["distance_field"]
    found, free = end_state(scene), end_state(FALLING[name](origin=[0.0, -50.0, 0.0]))
    assert (np.abs(found.position - free.position).max(axis=1) > 0.01).sum() > 10
    place = (found.position - np.array(part.velocity) * found.time) @ part.turn_at(found.time)
    end = part.field.low + part.field.spacing * (np.array(part.field.distance.shape) - 1)
    within = ((place > part.field.low) & (place < end)).all(axis=1)
    assert within.sum() > 10
    assert part.field.at(place[within]).min() > 0.03 * SETTLED - 8 * np.finfo(np.float32).eps
    kernels = [{}] if name == "implicit-euler" else [{}, {"kernel": "stages"}]
    for options in kernels:
        again = end_state(scene, threads=2, **options)
        assert np.array_equal(again.position, found.position) and np.array_equal(again.velocity, found.velocity), (
            options
        )
