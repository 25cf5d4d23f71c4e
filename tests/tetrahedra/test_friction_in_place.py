"""Friction of colliders under position-based tetrahedra and Newton's method: what should stick stays, what slides goes
as Coulomb says.

Friction on velocities alone left vertices where constraints had put them within the substep: a body crept by g h sin a times
how much more it weighs than what touches the slope, and slid the faster: at tan a = 1.1 mu and four substeps 379 mm in a
second instead of 246, by Newton's method 324 (536 at one substep).
"""

from __future__ import annotations

from functools import cache
from math import atan, cos, degrees, sin
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

MU, G, H, SIDE, THICKNESS, STICKING = 0.6, 9.81, 1 / 60, 0.3, 0.01, 1.05
SPEED, SECONDS = 0.2, 0.5


def sloped(
    ratio: float, mu: float, material: str, kind: str = "plane", solver: str = "xpbd", **body: Any
) -> tuple[Scene, np.ndarray]:
    """(a cube on a slope of tan a = ratio MU, the way down)."""
    angle = atan(ratio * MU)
    normal, down = np.array([sin(angle), cos(angle), 0.0]), np.array([cos(angle), -sin(angle), 0.0])
    friction = {"static_friction": mu, "dynamic_friction": mu, "thickness": THICKNESS, "kind": kind}
    turned = {"angle": -degrees(angle), "axis": [0.0, 0.0, 1.0]}
    if kind == "plane":
        floor: dict[str, Any] = {"normal": normal.tolist()}
    else:
        floor = {"shape": {"name": "box", "sides": [1.0, 0.2, 0.6]}, "origin": (-0.1 * normal).tolist()} | turned
    box = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [SIDE] * 3}, "edge": SIDE, "young_modulus": 1e6,
        "poisson_ratio": 0.3, "material": material, "origin": ((SIDE / 2 + THICKNESS) * normal).tolist(),
    }  # fmt: skip
    method: dict[str, Any] = {"solver": solver, "dt": H, "substeps": 4, "iterations": 20 if solver == "newton" else 1}
    return Scene({"box": box | turned | body, "floor": floor | friction, "gravity": {}, "method": method}), down


def after(scene: Scene, steps: int, start: State | None = None) -> tuple[State, np.ndarray]:
    """(the state, the centre's place)."""
    with open_simulation(scene, "cpu", initial=start, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(steps)
        state = simulation.state()
    mass = 1 / state.inverse_mass.reshape(-1, 1)
    return state, (mass * state.position).sum(axis=0) / mass.sum()


@cache
def settled(ratio: float, material: str, kind: str = "plane", solver: str = "xpbd") -> State:
    """At rest by friction that is STICKING times what holds it, under drag."""
    return after(sloped(ratio, STICKING * ratio * MU, material, kind, solver, mass_damping=20.0)[0], 45)[0]


@pytest.mark.parametrize(
    ("material", "kind", "solver"),
    [("fixed-corotated", "plane", "xpbd"), ("neo-hookean", "plane", "xpbd"), ("fixed-corotated", "mesh_collider", "xpbd"),
     ("fixed-corotated", "distance_field", "xpbd"), ("fixed-corotated", "plane", "newton"),
     pytest.param("neo-hookean", "plane", "newton", marks=pytest.mark.rest),
     pytest.param("fixed-corotated", "distance_field", "newton", marks=pytest.mark.rest)],
)  # fmt: skip
def test_what_should_stick_does_not_creep(material: str, kind: str, solver: str) -> None:
    """Friction holds 1.05 times what pulls: no vertex moves by more than a swing that drag has damped for 45 steps by
    exp(-20 t / 2) leaves of the 0.4 mm by which the cube gives way to its weight, rho g l^2 / E."""
    state = settled(0.9, material, kind, solver)
    scene, _ = sloped(0.9, STICKING * 0.9 * MU, material, kind, solver, mass_damping=20.0)
    later, _ = after(scene, 10, state)
    assert np.abs(later.position - state.position).max() < 1e-3 * np.exp(-20 * 45 * H / 2)


@pytest.mark.parametrize("solver", ["xpbd", "newton"])
@pytest.mark.parametrize("material", ["fixed-corotated", "neo-hookean"])
def test_what_slides_goes_as_coulomb_says(material: str, solver: str) -> None:
    """At tan a = 1.1 mu from 0.2 m/s: v t + g (sin a - mu cos a) t^2 / 2, within a per cent: letting go of its shear, of
    which a tenth is given back, moves the centre by some hundredths of a millimetre, and a substep goes at its last speed, by
    g h t (sin a - mu cos a) / 2 = 0.5 mm too far."""
    ratio = 1.1
    state, (scene, down) = settled(ratio, material, "plane", solver), sloped(ratio, MU, material, "plane", solver)
    begin = State(
        state.position, np.zeros_like(state.velocity) + SPEED * down, build(scene).inverse_mass, 0.0, 0
    )  # fmt: skip
    places = [after(scene, steps, begin)[1] for steps in (0, round(SECONDS / H))]
    angle = atan(ratio * MU)
    expected = SPEED * SECONDS + G * (sin(angle) - MU * cos(angle)) * SECONDS**2 / 2
    assert (places[1] - places[0]) @ down == pytest.approx(expected, rel=0.01)
