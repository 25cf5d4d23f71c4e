"""Colliders that act before each iteration of xpbd tetrahedra: against the NumPy reference, and against Newton's method,
which solves for elements and contacts together.

Where they acted after the solve alone, the lowest elements were shortened by another g h^2 M/m, however many iterations:
a cube that starts without strain on a slope of tan a = 0.9 mu jumped from that and went 967 mm in a second.
"""

from __future__ import annotations

from itertools import pairwise
from math import atan, cos, degrees, sin
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import tetrahedra_cloth as reference
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

EDGE, SIDE, G, H, MU = 0.1, 0.3, 9.81, 1 / 60, 0.5
EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}


def cube(ratio: float, **method: Any) -> tuple[Scene, np.ndarray]:
    """(A cube of three voxels along each side on a slope of tan a = ratio MU, the way down), with one substep a step."""
    tilt, up = atan(ratio * MU), SIDE / 2 + 1e-9
    normal = np.array([sin(tilt), cos(tilt), 0.0])
    body = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [SIDE] * 3, "resolution": 4}, "edge": EDGE,
        "young_modulus": 1e5, "angle": -degrees(tilt), "axis": [0.0, 0.0, 1.0], "origin": (up * normal).tolist(),
    }  # fmt: skip
    floor = {
        "kind": "plane", "normal": normal.tolist(), "thickness": 0.0, "static_friction": MU, "dynamic_friction": MU
    }  # fmt: skip
    settings = {"solver": "xpbd", "dt": H, "substeps": 1} | method
    scene = Scene({"cube": body, "floor": floor, "gravity": {"acceleration": G}, "method": settings}, "cube")
    return scene, np.array([cos(tilt), -sin(tilt), 0.0])


def centres(scene: Scene, *steps: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """(Place, velocity) of the centre of mass after so many steps."""
    mass, found = scene.tetrahedra_set.masses, []
    with open_simulation(scene, "cpu", **EXACT) as simulation:
        for since, until in pairwise((0, *steps)):
            simulation.advance(until - since)
            state = simulation.state()
            found.append((mass @ state.position / mass.sum(), mass @ state.velocity / mass.sum()))
    return found


@pytest.mark.parametrize("iterations", [1, 3])
def test_states_are_the_references(iterations: int) -> None:
    """Rounding alone, as in test_tetrahedra_cpu.py: 1e-12 m, and 1/h times that; some vertices start inside the floor."""
    scene, _ = cube(0.9, substeps=2, iterations=iterations)
    body, random = build(scene), np.random.default_rng(3)
    start = body.position + random.normal(0, 0.01, body.position.shape)
    begin = State(start, body.velocity + random.normal(0, 0.1, start.shape), body.inverse_mass, 0.0, 0)
    position, velocity = reference.simulate(scene, 2, begin.position, begin.velocity, 0, 0.0)
    with open_simulation(scene, "cpu", initial=begin, **EXACT) as simulation:
        simulation.advance(2)
        state = simulation.state()
    np.testing.assert_allclose(state.position, position, atol=1e-12)
    np.testing.assert_allclose(state.velocity, velocity, atol=2e-10)


def test_the_height_at_rest_tends_to_that_of_the_implicit_step() -> None:
    """Each doubling of the iterations more than halves what is left, as `contact_sag` assumes; 16 leave less than a twentieth
    of one's: scalar rows end some per cent off."""
    implicit = centres(cube(0.0, solver="newton", iterations=20)[0], 240)[0][0][1]
    off = [abs(centres(cube(0.0, iterations=n)[0], 240)[0][0][1] - implicit) for n in (1, 2, 4, 8, 16)]
    assert off[0] > 0.01, "one iteration leaves the weight on the floor to the lowest elements"
    assert all(later < first / 2 for first, later in pairwise(off[:4]))
    assert off[-1] < off[0] / 20


def test_it_sticks_below_the_cone_and_slides_above_it_as_coulomb_says() -> None:
    """With one substep a step, from the state without strain: after two seconds it creeps by less than 0.1 mm/s; above the
    cone its speed grows by g (sin a - mu cos a), within a per cent: the swings of a soft body have not died away."""
    scene, down = cube(0.9, iterations=8)
    (first, _), (last, _) = centres(scene, 120, 180)
    assert abs((last - first) @ down) < 1e-4
    scene, down = cube(1.1, iterations=8)
    (_, first), (_, last) = centres(scene, 60, 180)
    angle = atan(1.1 * MU)
    assert (last - first) @ down == pytest.approx(120 * H * G * (sin(angle) - MU * cos(angle)), rel=0.01)
