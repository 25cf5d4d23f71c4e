"""Fluids on CUDA, in plain Python: against the NumPy judge, fused against stage by stage, to the bits of the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flow_scenes import FLOWS
from fluid_scenes import in_a_cup
from small_fluids import few, flat, free, rich, stirred

from softlab.app.driver import open_simulation
from softlab.bench.reference import fluid as judge
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

SCENES = {
    "rich": rich(),
    "flat": flat(),
    "averaged": flat(scheme="averaged", iterations=1),
    "few": few((0.1, 0.15, 0.15)),
    "cup": in_a_cup(),
    "free rich": free(rich()),
    "free flat": flat(scheme="divergence-free"),
}

BOTH = ["float64", "float32"]


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


@pytest.mark.parametrize(
    "name,precision",
    [(name, precision) for name in ("rich", "flat", "averaged", "free rich", "free flat") for precision in BOTH]
    + [("cup", "float32")],  # in float64 it is held against the judge
)
def test_the_bits_are_the_cpus(name: str, precision: str) -> None:
    """Also of the multipliers, from which pressures are read, and how often the speed limit slowed a particle."""
    found, multipliers, limited = [], [], []
    for backend, kernel in (("cpu", None), ("gpu", "launch")):
        options = {"precision": precision, "math": "exact", "kernel": kernel, "initial": stirred(SCENES[name])}
        with open_simulation(SCENES[name], backend, **options) as simulation:
            simulation.advance(1)
            found.append(simulation.state())
            multipliers.append(simulation._multipliers())
            limited.append(simulation.speed_limited)
    assert limited[0] == limited[1]
    assert same(*found)
    assert np.array_equal(*multipliers) and multipliers[0].min() < 0


def test_a_particle_that_was_flung_away_makes_cells_larger() -> None:
    """A thousand metres away, where the table of cells cannot reach with cells of the support: lists stay the same."""
    start = stirred(SCENES["few"])
    start.position[5] = 1000.0, 900.0, -800.0
    ends = [end_of(SCENES["few"], backend, initial=start) for backend in ("cpu", "gpu")]
    assert same(*ends) and np.isfinite(ends[0].position).all()


STEPS = 4  # of what comes and goes


def run(scene: Scene, backend: str, steps: int, **options: Any) -> tuple[State, int]:
    """The state after so many steps, and how many particles were missing at nozzles."""
    with open_simulation(scene, backend, math="exact", **options) as simulation:
        simulation.advance(steps)
        return simulation.state(), simulation.not_emitted  # type: ignore[attr-defined]


def waiting_alike(a: State, b: State) -> bool:
    return same(a, b) and np.array_equal(a.inverse_mass, b.inverse_mass)


@pytest.mark.parametrize(
    "name,precision", [(name, precision) for name in FLOWS for precision in (BOTH if name != "tap" else ["float32"])]
)
def test_what_comes_and_goes_has_the_cpus_bits(name: str, precision: str) -> None:
    """Who waits, too, and how many were missing; launched and stage by stage from a state on the way."""
    scene = FLOWS[name]()
    expected, missing = run(scene, "cpu", STEPS, precision=precision, threads=2)
    found, told = run(scene, "gpu", STEPS, precision=precision, kernel="launch")
    assert waiting_alike(found, expected) and told == missing
    assert 0 < (found.inverse_mass > 0).sum() < len(found.inverse_mass)
    half, _ = run(scene, "gpu", STEPS // 2, precision=precision, kernel="stages")
    staged, _ = run(scene, "gpu", STEPS - STEPS // 2, precision=precision, kernel="stages", initial=half)
    assert waiting_alike(staged, expected)


def test_what_came_is_taken_back_and_a_tap_is_turned() -> None:
    scene = FLOWS["flat tap"]()
    with open_simulation(scene, "gpu", math="exact", precision="float64", live=("taps",)) as simulation:
        simulation.advance(2)
        first = simulation.state()
        simulation.advance(2)
        simulation.rewind()
        assert waiting_alike(simulation.state(), first)
        simulation.set("tap.speed", 1.0)
        simulation.advance(1)
        with open_simulation(scene.replace({"tap.speed": 1.0}), math="exact", precision="float64") as other:
            other.load(simulation.state())
            simulation.advance(1)
            other.advance(1)
            assert waiting_alike(other.state(), simulation.state())
