"""Emitters and sinks on CUDA, in plain Python: to the bits of the CPU, launched and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flow_scenes import FLOWS

from app.driver import open_simulation
from model.core.state import State
from model.scene.scene import Scene

STEPS = 4


def run(scene: Scene, backend: str, steps: int, **options: Any) -> tuple[State, int]:
    with open_simulation(scene, backend, math="exact", **options) as simulation:
        simulation.advance(steps)
        assert simulation.contacts_lost == 0  # type: ignore[attr-defined]
        return simulation.state(), simulation.not_emitted  # type: ignore[attr-defined]


def same(a: State, b: State) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("position", "velocity", "inverse_mass"))


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", FLOWS)
def test_the_bits_are_the_cpus(name: str, precision: str) -> None:
    """Who waits, too, and how many were missing; and from a state on the way."""
    scene = FLOWS[name]()
    expected, missing = run(scene, "cpu", STEPS, precision=precision, threads=2)
    found, told = run(scene, "gpu", STEPS, precision=precision, kernel="launch")
    assert same(found, expected) and told == missing
    assert 0 < (found.inverse_mass > 0).sum() < len(found.inverse_mass)
    half, _ = run(scene, "gpu", STEPS // 2, precision=precision, kernel="stages")
    staged, _ = run(scene, "gpu", STEPS - STEPS // 2, precision=precision, kernel="stages", initial=half)
    assert same(staged, expected)


def test_it_is_taken_back() -> None:
    scene = FLOWS["flat tap"]()
    with open_simulation(scene, "gpu", math="exact", precision="float64", live=("taps",)) as simulation:
        simulation.advance(2)
        first = simulation.state()
        simulation.advance(2)
        simulation.rewind()
        assert same(simulation.state(), first)
        simulation.set("tap.speed", 1.0)
        simulation.advance(1)
        with open_simulation(scene.replace({"tap.speed": 1.0}), math="exact", precision="float64") as other:
            other.load(simulation.state())
            simulation.advance(1)
            other.advance(1)
            assert same(other.state(), simulation.state())
