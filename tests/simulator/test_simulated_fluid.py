"""Fluids on CUDA, in plain Python: against the NumPy judge, fused against stage by stage, to the bits of the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fluid_scenes import in_a_cup
from small_fluids import few, flat, free, rich, stirred

from app.driver import open_simulation
from bench.reference import fluid as judge
from model.core.state import State
from model.scene.scene import Scene

SCENES = {
    "rich": rich(),
    "flat": flat(),
    "averaged": flat(scheme="averaged", iterations=1),
    "few": few((0.1, 0.15, 0.15)),
    "cup": in_a_cup(),
    "free rich": free(rich()),
    "free flat": flat(scheme="divergence-free"),
}


def end_of(scene: Scene, backend: str = "gpu", steps: int = 1, **options: Any) -> State:
    options = {"precision": "float64", "math": "exact", "initial": stirred(scene)} | options
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps)
        assert simulation.contacts_lost == 0
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)


@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_judges_and_stage_by_stage_the_same_bits(name: str) -> None:
    """A substep's sums have some fifty terms; slopes and pulls divide by distances, here of a tenth of the support at least:
    a thousand roundings of numbers around 1."""
    scene = SCENES[name]
    found = end_of(scene, kernel="launch")
    start = stirred(scene)
    position, velocity = judge.simulate(scene, 1, start.position, start.velocity)
    assert abs(found.position - start.position).max() > 0.005
    np.testing.assert_allclose(found.position, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.velocity, velocity, rtol=0, atol=1e-10)
    assert same(end_of(scene, kernel="stages"), found)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", ["rich", "flat", "averaged", "cup", "free rich", "free flat"])
def test_the_bits_are_the_cpus(name: str, precision: str) -> None:
    """Also of the multipliers, from which pressures are read."""
    found, multipliers = [], []
    for backend, kernel in (("cpu", None), ("gpu", "launch")):
        options = {"precision": precision, "math": "exact", "kernel": kernel, "initial": stirred(SCENES[name])}
        with open_simulation(SCENES[name], backend, **options) as simulation:
            simulation.advance(1)
            found.append(simulation.state())
            multipliers.append(simulation._multipliers())
    assert same(*found)
    assert np.array_equal(*multipliers) and multipliers[0].min() < 0


def test_a_particle_that_was_flung_away_makes_cells_larger() -> None:
    """A thousand metres away, where the table of cells cannot reach with cells of the support: lists stay the same."""
    start = stirred(SCENES["few"])
    start.position[5] = 1000.0, 900.0, -800.0
    ends = [end_of(SCENES["few"], backend, initial=start) for backend in ("cpu", "gpu")]
    assert same(*ends) and np.isfinite(ends[0].position).all()
