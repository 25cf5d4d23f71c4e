"""A rigid body without forces sets itself in motion (FleX, issue 12): velocities were ways over h, with all that was rounded.

A substep that leaves every bit of a state as it was leaves it so for ever: what holds of one holds of 60 s, at any number of
them. Momenta of what moves are held to roundings of velocities alone, whatever the substep.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

FRAME = 1 / 60
L, AB = {"name": "letters", "text": "L"}, {"name": "letters", "text": "AB"}
PLACES: list[Any] = [
    (L, 0.1, 4, (0.0, 0.0, 0.0)), (L, 0.1, 16, (0.0, 0.0, 0.0)), (L, 0.15, 64, (0.3, 2.0, -1.0)),
    ({"name": "star"}, 0.15, 16, (0.0, 0.0, 0.0)), ({"name": "blob"}, 0.2, 4, (0.0, 0.0, 0.0)),
    ({"name": "beam"}, 0.1, 16, (0.001, 0.0, 0.0)), ({"name": "torus"}, 0.15, 4, (20.0, -7.0, 3.0)),
    (AB, 0.15, 4, (0.0, 0.0, 0.0)),
]  # fmt: skip


def body_scene(shape: dict[str, Any], spacing: float, substeps: int, origin: Any, **other: Any) -> Scene:
    body = {"kind": "rigid_body", "shape": shape, "particle_spacing": spacing, "origin": list(origin)}
    given = {name: other.pop(name) for name in ("spin", "velocity", "angle", "axis") if name in other}
    method = {"solver": "shape-matching", "dt": FRAME, "substeps": substeps}
    return Scene({"title": "Rigid", "body": body | given, "method": method} | other)


def after(scene: Scene, steps: int, backend: str = "cpu", **how: Any) -> list[State]:
    """The states after each of so many steps, the start first."""
    how = {"precision": "float32", "math": "exact"} | how | ({"threads": 1} if backend == "cpu" else {})
    with open_simulation(scene, backend, **how) as simulation:
        found = [simulation.state()]
        for _ in range(steps):
            simulation.advance(1)
            found.append(simulation.state())
    return found


def same(one: State, other: State) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "velocity", "rotation")
    )


@pytest.mark.parametrize("shape,spacing,substeps,origin", PLACES)
def test_a_body_at_rest_keeps_every_bit(
    shape: dict[str, Any], spacing: float, substeps: int, origin: Any, backend: str, kernel: str
) -> None:
    chosen = {"kernel": kernel} if backend == "cpu" else {}
    first, *others = after(body_scene(shape, spacing, substeps, origin), 2, backend, **chosen)
    assert all(same(first, other) for other in others) and not others[-1].velocity.any()


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("math", ["exact", "fast"])
def test_so_it_does_tilted_beside_others_and_over_a_plane(precision: str, math: str, backend: str) -> None:
    """With code for contacts and colliders, which touch nothing."""
    star = {"kind": "rigid_body", "shape": {"name": "star"}, "particle_spacing": 0.25, "origin": [5.0, 0.0, 0.0]}
    scene = body_scene(
        L, 0.2, 2, (0.1, 0.2, 0.3), angle=33.0, axis=[1.0, 2.0, 3.0], star=star, contact={},
        plane={"point": [0.0, -9.0, 0.0]},
    )  # fmt: skip
    states = after(scene, 2, backend, precision=precision, math=math)
    assert same(states[1], states[2]) and not states[2].velocity.any()
    assert np.abs(states[2].position - states[0].position).max() < 1e-6


def test_a_spinning_body_flies_straight(backend: str) -> None:
    """At 1 cm/s, of which a substep's way of 1e-5 m has seven roundings of a place of 1 m: its momentum is summed from
    velocities, of up to 0.5 m/s, each rounded three times in each of 160 substeps: 160 x 3 x 0.5 x 2^-24, did all of them go
    to one side."""
    scene = body_scene(L, 0.15, 16, (1.0, 1.0, 1.0), velocity=[0.01, 0.0, 0.0], spin=[0.2, 0.5, 0.3])
    states, mass = after(scene, 10, backend), scene.body_set.clusters.mass
    velocity = np.average(states[-1].velocity, axis=0, weights=mass)
    assert velocity == pytest.approx(np.array([0.01, 0.0, 0.0]), abs=160 * 3 * 0.5 * 2.0**-24)
    way = np.average(states[-1].position, axis=0, weights=mass) - np.average(states[0].position, axis=0, weights=mass)
    assert way == pytest.approx(np.array([0.01, 0.0, 0.0]) * 10 * FRAME, abs=160 * 2.0**-23)
