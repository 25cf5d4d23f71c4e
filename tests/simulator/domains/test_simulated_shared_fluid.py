"""A fluid in slabs on the GPU, under the simulator: the bits of one, on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

SCENE: dict[
    str, Any
] = {  # two rows of fluids beside each other that fall and are pushed on; a wall, and more than gravity
    "oil": {"kind": "fluid", "dimensions": 2, "size": [0.5, 0.1], "rest_distance": 0.05, "support": 0.06}
    | {"velocity": [2.0, 0.0, 0.0], "maximum_speed": 3.0, "viscosity": 20.0, "surface_tension": 0.05},
    "water": {"kind": "fluid", "dimensions": 2, "size": [0.5, 0.1], "origin": [0.5, 0.0], "rest_distance": 0.05}
    | {"support": 0.06, "maximum_speed": 3.0, "density": 1500.0},
    "floor": {"kind": "plane", "thickness": 0.0},
    "gravity": {},
    "method": {"solver": "pbf", "dt": 0.02, "substeps": 2, "iterations": 1},
}


def end(scene: Scene, **options: Any) -> tuple[State, np.ndarray]:
    with open_simulation(scene, math="exact", live=frozenset({"poke"}), **options) as simulation:
        simulation.poke(11, (300.0, 10.0))
        simulation.advance(1)
        simulation.rewind()
        simulation.advance(2)
        return simulation.state(), simulation.read("pressure")


@pytest.mark.parametrize("gpus, precision", [(2, "float32"), (3, "float64")])
def test_slabs_have_the_bits_of_the_cpu(gpus: int, precision: str) -> None:
    """A force on a particle by its number, a state put aside, pressures."""
    (found, told), (wanted, pressure) = (
        end(Scene(SCENE), precision=precision, **how) for how in ({"backend": "gpu", "gpus": gpus}, {"threads": 1})
    )
    assert np.array_equal(found.position, wanted.position) and np.array_equal(found.velocity, wanted.velocity)
    assert np.array_equal(told, pressure)


def test_slabs_need_no_link_and_one_kernel() -> None:
    with pytest.raises(SceneError, match="through the host"):
        end(Scene(SCENE), backend="gpu", gpus=2, link="nccl")
    with pytest.raises(SceneError, match="must be one of stages"):
        end(Scene(SCENE), backend="gpu", gpus=2, kernel="graph")
