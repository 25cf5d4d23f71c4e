"""A small bar whose ends are pinned, and move, for the tests of every solver of tetrahedra."""

from __future__ import annotations

from typing import Any

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

SOLVERS = ("xpbd", "vbd", "newton")
BAR: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.3, 0.1, 0.1]}, "edge": 0.05, "young_modulus": 2e4,
    "poisson_ratio": 0.3, "pinned": ["left", "right"],
}  # fmt: skip
ENDS: dict[str, Any] = {
    "left_end": {"kind": "motion", "pins": "left", "body": "bar", "angular_velocity": 2.0},
    "right_end": {
        "kind": "motion", "pins": "right", "body": "bar", "angular_velocity": -3.0, "velocity": [0.2, 0.0, 0.0],
    },
}  # fmt: skip
LOOSE = BAR | {"pinned": []}
CUBE = LOOSE | {
    "shape": {"name": "box", "sides": [0.1, 0.1, 0.1]}, "origin": [0.03, -0.1, 0.01], "velocity": [0.3, 0.1, -0.2],
    "spin": [1.0, 2.0, 3.0],
}  # fmt: skip
CLAMP: dict[str, Any] = {"kind": "attachment", "body": "bar", "vertices": "left", "compliance": 1e-4}
HOOK = {"kind": "attachment", "body": "cube", "vertices": "top", "to": "bar"}


def kinematic_scene(solver: str, **parts: Any) -> Scene:
    """The bar and such parts."""
    method = {"solver": solver, "dt": 0.01, "substeps": 2, "iterations": 3}
    return Scene({"bar": BAR, "method": method} | parts, "bar")


def run(scene: Scene, steps: int, backend: str = "cpu", **options: Any) -> State:
    """After so many steps."""
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps)
        return simulation.state()
