"""Small scenes of tetrahedral bodies by implicit Euler, for the tests of the kernels."""

from __future__ import annotations

from typing import Any

from tetrahedra_scenes import BODY, moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "newton", "dt": 0.01, "substeps": 2, "iterations": 3}
LONG: dict[str, Any] = {"shape": {"name": "box", "sides": [0.8, 0.2, 0.1], "resolution": 10}, "damping": 0.02}


def newton_scene(name: str, **changes: Any) -> Scene:
    """One of tetrahedra_scenes.py, by Newton's method."""
    return tetrahedra_scene(name, method=METHOD, **changes)


def groups_and_bodies() -> Scene:
    """Three bodies of all materials, with dampers, forces and a floor; particles of two groups of SUMMED, the first body of
    several groups that move as rigid ones."""
    return newton_scene("everything", body=BODY | LONG)


def bar(across: int, **changes: Any) -> Scene:
    """The bar of `softlab tetrahedra`, without a brake: 400 tetrahedra with 2 across, 3200 with 4, 25 600 with 8."""
    shape = {"name": "box", "sides": [1.0, 0.1, 0.1]}
    beam = BODY | {"shape": shape, "edge": 0.1 / across, "young_modulus": 1e7} | changes
    method = METHOD | {"dt": 1 / 60, "substeps": 1, "iterations": 1}
    return Scene({"beam": beam, "gravity": {}, "method": method}, "bar")


def shaken(scene: Scene) -> State:
    """Its beginning, particles off by a tenth of an edge."""
    return moving(scene, 0.1 * min(part.edge for part in scene.tetrahedra.values()))


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> tuple[State, list[int]]:
    """(state, what was done on the way) after `steps` steps from a start out of shape."""
    with open_simulation(scene, backend, **({"initial": shaken(scene)} | options)) as simulation:
        simulation.advance(steps)
        done = simulation.done  # type: ignore[attr-defined]
        return simulation.state(), list(done)
