"""One way to step a cloth by its NumPy reference, on the CPU and on a real GPU, so that one test holds them all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

each_solver = pytest.mark.parametrize("solver", ["reference", "cpu", pytest.param("gpu", marks=pytest.mark.gpu)])


def cloth(rows: int, columns: int, **parts: Any) -> Scene:
    """A cloth with these tables; keys of `cloth` itself under `sheet`."""
    sheet = {"rows": rows, "columns": columns, "pinned": "none", "spacing": 0.125} | parts.pop("sheet", {})
    return Scene({"cloth": sheet, **parts})


def solve(
    solver: str, scene: Scene, steps: int, position: Any = None, velocity: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """(position, velocity) (particles, 3) float64 after `steps` steps from such a start, in float64 and exact math."""
    begin = [
        own.copy() if given is None else np.array(given, dtype=np.float64).reshape(-1, 3)
        for given, own in zip((position, velocity), reference.start(scene), strict=True)
    ]
    if solver == "reference":
        return reference.simulate(scene, steps, *begin)
    from softlab.app.driver import open_simulation

    threads = {"threads": 1} if solver == "cpu" else {}
    initial = State(begin[0], begin[1], build(scene).inverse_mass, 0.0, 0)
    with open_simulation(
        scene, solver, precision="float64", math="exact", allow_unstable=True, initial=initial, **threads
    ) as simulation:
        simulation.advance(steps)
        state = simulation.state()
    return state.position, state.velocity


def accelerations(solver: str, scene: Scene, position: Any = None, velocity: Any = None) -> np.ndarray:
    """(particles, 3) [m/s^2] at the start of the scene, read off one step of semi-implicit Euler, v' = v + dt a."""
    dt = 2.0**-10
    stepped = scene.replace({"method.integrator": "semi-implicit-euler", "method.dt": dt})
    before = np.zeros(3) if velocity is None else np.asarray(velocity).reshape(-1, 3)
    return (solve(solver, stepped, 1, position, velocity)[1] - before) / dt
