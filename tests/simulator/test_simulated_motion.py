"""Pins that follow a path on the GPU's kernels, in plain Python: the bits of the CPU, for every kernel."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))
from cloth_scenes import POKE, cloth_scene

from app.driver import open_simulation
from gpu_backend.cloth_pins import STILL, pin_marks
from model.build import build
from model.cloth_record import P_MOTION, body_rows
from model.errors import SceneError
from model.scene import Scene
from model.simulation import State


def end_state(scene: Scene, backend: str, kernel: str, **options: Any) -> State:
    """After five steps, in one of which `jerk` begins; after three the state is read and loaded, and dt is changed."""
    with open_simulation(
        scene, backend, math="exact", kernel=kernel, live=("poke", "dt"), allow_unstable=True, **options
    ) as simulation:
        simulation.poke(*POKE)
        simulation.advance(3)
        simulation.load(simulation.state())
        simulation.set("method.dt", 0.75 * scene.method.dt)
        simulation.advance(2)
        simulation.load(simulation.state())
        return simulation.state()


@pytest.mark.parametrize(
    ("name", "integrator", "precision"),
    [
        ("moving", "velocity-verlet", "float32"),
        ("damped moving", "velocity-verlet", "float64"),
        ("damped moving", "rk4", "float32"),
        ("moving", "lab", "float64"),
    ],
)
def test_pins_that_move_give_the_bits_of_the_cpu(name: str, integrator: str, precision: str) -> None:
    scene = cloth_scene(name, integrator)
    expected = end_state(scene, "cpu", "stages", precision=precision, threads=1)
    assert expected.velocity[build(scene).pinned].any()
    for kernel in ("launch", "stages") if integrator == "rk4" else ("launch", "stages", "one-block"):
        state = end_state(scene, "gpu", kernel, precision=precision)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_marks_tell_free_still_and_moving_masses_apart() -> None:
    scene = cloth_scene("moving", "lab")
    body = build(scene)
    bodies, first = body_rows(scene, body, np.float32)
    marks = pin_marks(body, bodies, first)
    assert np.count_nonzero(marks) == 3 and marks[6 * 6 + 5] == STILL
    motions = [int(bodies[int(marks[k]) + P_MOTION]) for k in (0, 3 * 6 + 2)]
    assert all(marks[k] > STILL for k in (0, 3 * 6 + 2)) and len(set(motions)) == 2 and max(motions) < first
    with pytest.raises(SceneError, match="at most 4194304 pins beside a motion in float32; use float64"):
        pin_marks(body, np.broadcast_to(np.float32(0), (2**24 + 1,)), first)
