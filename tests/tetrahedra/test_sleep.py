"""Vertices that keep their places while they are slow: what trembles rests, what falls goes on; the same bits."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
import pytest
from kinematic_scenes import LOOSE, kinematic_scene, run

from softlab.app.driver import open_simulation
from softlab.model.formulas.elastic.sleep import GRAVITY_FRACTION
from softlab.model.scene.scene import Scene

SPEED = 0.05  # m/s
DT = 0.01
EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}
CUBE = LOOSE | {"shape": {"name": "box", "sides": [0.1, 0.1, 0.1]}}


def asleep(speed: float = SPEED, **parts: Any) -> Scene:
    """CUBE and such parts."""
    method = {"solver": "xpbd", "dt": DT, "substeps": 4, "sleeping_speed": speed}
    return kinematic_scene("xpbd", **({"bar": CUBE, "method": method} | parts))


def test_free_flight_is_left_alone() -> None:
    """From rest, and over the top of a flight: the same bits as without."""
    for speed in (0.0, 0.5):
        parts: dict[str, Any] = {"bar": CUBE | {"velocity": [0.0, speed, 0.0]}, "gravity": {}}
        without, with_it = (run(asleep(sleeping, **parts), 12, **EXACT) for sleeping in (0.0, SPEED))
        assert with_it.position.tobytes() == without.position.tobytes()
        assert with_it.velocity.tobytes() == without.velocity.tobytes()


def test_what_falls_slowly_goes_on() -> None:
    """At a terminal speed g / a of a tenth of the sleeping one. It sleeps once its speed is within SHARE of that, to begin
    anew: v = g / a (1 - exp(-a t)) until t = ln(1 / SHARE) / a, on average (1 - (1 - SHARE) / ln(1 / SHARE)) of g / a."""
    slow = CUBE | {"mass_damping": 20.0}
    state = run(asleep(bar=slow, gravity={"acceleration": 0.1}), 200, **EXACT)
    share = 1 - (1 - GRAVITY_FRACTION) / log(1 / GRAVITY_FRACTION)
    assert state.position[:, 1].max() - 0.05 == pytest.approx(-0.1 / 20.0 * 2 * share, rel=0.05)


def test_who_loses_what_bore_it_falls() -> None:
    """A cube that sleeps on a box, which leaves sideways without friction."""
    box = {"kind": "box", "half_size": [0.2, 0.05, 0.2], "center": [0.0, -0.05, 0.0], "velocity": [0.3, 0.0, 0.0]}
    parts: dict[str, Any] = {"bar": CUBE | {"origin": [0.0, 0.06, 0.0], "damping": 0.01}, "box": box, "gravity": {}}
    assert run(asleep(**parts), 130, **EXACT).position[:, 1].max() < -0.2


def test_what_rests_does_not_move_at_all() -> None:
    """A cube on the floor, which without it trembles, or creeps, by some bits of its places."""
    parts: dict[str, Any] = {
        "bar": CUBE | {"origin": [0.0, 0.06, 0.0], "damping": 0.01}, "gravity": {}, "damping": {"coefficient": 0.02},
        "floor": {"kind": "plane", "static_friction": 0.5, "dynamic_friction": 0.5},
    }  # fmt: skip
    moved = {}
    for speed in (0.0, SPEED):
        with open_simulation(asleep(speed, **parts), **EXACT) as simulation:
            simulation.advance(150)
            first = simulation.state().position
            simulation.advance(10)
            moved[speed] = float(np.abs(simulation.state().position - first).max())
    assert moved[SPEED] == 0.0 < moved[0.0]
