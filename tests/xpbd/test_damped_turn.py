"""Dampers of springs do not damp a rigid turn: neither a sheet's rows nor a mesh's (newton 208, 224: of other materials)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

RATE, STEPS, H = 10.0, 30, 1 / 60
STIFFNESS = 100.0


def spinning(kind: str, damping: float, **method: Any) -> Scene:
    """A free sheet of 3 x 3 masses, 10 cm apart, that lies."""
    springs = {"stiffness": STIFFNESS, "damping": damping}
    sheet = {"rows": 3, "columns": 3, "spacing": 0.1, "placement": "flat", "pinned": "none"}
    own = {"structural": springs, "bending": springs}
    if kind == "mesh":
        sheet |= {"shape": "sheet", "density": 1.0}
    else:
        own["shear"] = springs
    return Scene({kind: sheet, **own, "method": {"solver": "xpbd", "dt": H} | method})


def spin(mass: np.ndarray, state: Any) -> float:
    middle = (mass * state.position).sum(axis=0) / mass.sum()
    return float((mass * np.cross(state.position - middle, state.velocity)).sum(axis=0)[1])


@pytest.mark.parametrize(("kind", "method"), [
    ("mesh", {}), ("mesh", {"iterations": 3}), ("cloth", {}), ("cloth", {"ordering": "jacobi"}),
])  # fmt: skip
def test_a_damped_sheet_keeps_the_spin_of_an_undamped_one(
    run: Callable[..., Any], kind: str, method: dict[str, Any]
) -> None:
    """A damper of tau = c / k = 10 ms at 10 rad/s. Eq. 26's rate, grad C . (x - x_before), is l (w h)^2 / (2 h) in a turn and
    pulled by tau w^2 h / 2 = 0.8 % of each length; the spin lost another tenth. What is left are swings of the lengths."""
    kept = []
    for damping in (0.0, 0.01 * STIFFNESS):
        scene = spinning(kind, damping, **method)
        body = build(scene)
        mass = 1 / body.inverse_mass.reshape(-1, 1)
        velocity = np.cross([0.0, RATE, 0.0], body.position - (mass * body.position).sum(axis=0) / mass.sum())
        begin = State(body.position, velocity, body.inverse_mass, 0.0, 0)
        kept.append(spin(mass, run(scene, STEPS, initial=begin)) / spin(mass, begin))
    assert kept[1] == pytest.approx(kept[0], rel=0.02)
