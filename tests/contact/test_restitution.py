"""Colliders that give back: how high a ball comes, what friction then takes, rest, and scenes without it."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest
from bodies_scenes import AWAY, BRICK, by_hand, clusters_of, method, opened, same
from bodies_scenes import end_state as end_of_bodies
from bodies_scenes import start as start_of_bodies
from cloth_solve import cloth, each_solver, solve

from softlab.bench.reference import cloth as judge
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import SceneError
from softlab.model.base.variant import plain_formulas
from softlab.model.contact.sheet_plan import cloth_parts
from softlab.model.formulas import colliders as formulas
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

G, ROUNDING = 9.81, 1e-9  # m/s^2; m, of 3000 steps: 3000^2 x 2^-53 of 1 m
FLOOR = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "thickness": 0.0}


def ball(restitution: float, dt: float, **floor: Any) -> Scene:
    """A mass 1 m above a plane."""
    return cloth(
        1, 1, sheet={"origin": (0.0, 1.0, 0.0)}, gravity={}, plane=FLOOR | {"restitution": restitution} | floor,
        method={"integrator": "semi-implicit-euler", "dt": dt},
    )  # fmt: skip


def plate(restitution: float, dt: float) -> Scene:
    """A rigid body of one layer of particles, and one of a single one, 1 m above a plane."""
    at = [[0.2 * x, 1.0, 0.2 * z] for x in range(3) for z in range(3)]
    clusters = clusters_of([*at, [5.0, 1.0, 0.0]], [np.arange(9), [9]])
    plane = AWAY | FLOOR | {"restitution": restitution}
    return by_hand(clusters, body=BRICK, gravity=G, plane=plane, method=method(dt=dt))


def apexes(restitution: float, dt: float, bounces: int) -> list[tuple[float, float]]:
    """[m] bounds of the highest place of a step, of a fall from 1 m and after each bounce.

    Semi-implicit Euler's places lie on a parabola (apex A, S^2 = 2 g A) whose slope is g h / 2 above the velocity. It is
    seen up to a step beyond 0, where the velocity is S, give or take g h / 2; sent back at e of that, from 0, its parabola
    has S' = e v - g h / 2. Of a parabola the highest place is at most g h^2 / 8 below the apex.
    """
    missed, half = G * dt**2 / 8, G * dt / 2
    low = high = sqrt(2 * G * (1 + missed))
    found = [(1 - ROUNDING, 1 + ROUNDING)]
    for _ in range(bounces):
        low, high = restitution * (low - half) - half, restitution * (high + half) - half
        found.append((low**2 / (2 * G) - missed - ROUNDING, high**2 / (2 * G) + ROUNDING))
    return found


def falls(solver: str, scene: Scene, steps: int) -> np.ndarray:
    """(1 + steps, particles) [m]: heights after each step."""
    if solver == "reference":
        p, v = reference.start(scene)
        found = [p[:, 1]]
        for step in range(steps):
            p, v = reference.simulate(scene, 1, p, v, step)
            found.append(p[:, 1])
        return np.array(found)
    with opened(scene, **({} if scene.bodies else {"live": ()})) as simulation:  # as other tests do: the same code
        found = [simulation.state().position[:, 1]]
        for _ in range(steps):
            simulation.advance(1)
            found.append(simulation.state().position[:, 1])
    return np.array(found)


def peaks(height: np.ndarray) -> np.ndarray:
    """The start, and the places higher than both before and after (of two equal ones the first)."""
    inner = (height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])
    return np.concatenate([height[:1], height[1:-1][inner]])


@pytest.mark.parametrize("restitution", [0.5, 1.0])
@pytest.mark.parametrize(
    "solver,dt", [("reference", 0.004), ("reference", 0.001), ("cpu", 0.004), ("cpu", 0.001), ("bodies", 0.004)]
)
def test_a_ball_comes_back_to_the_restitutions_square(solver: str, dt: float, restitution: float) -> None:
    """With 1, energy is lost to first order in the step only, as the bounds are; of bodies, those whose masses all touch."""
    scene = (plate if solver == "bodies" else ball)(restitution, dt)
    bounds = apexes(restitution, dt, 3 if restitution == 1 else 2)
    seconds = 3.4 if restitution == 1 else 1.2  # the fall, 0.452 s, then 2 e, 2 e^2, ... of it
    for height in falls(solver, scene, round(seconds / dt)).T:
        found = peaks(height)
        assert len(found) >= len(bounds) and height.min() >= 0
        for place, (low, high) in zip(found, bounds, strict=False):
            assert low <= place <= high
    assert bounds[1][1] - bounds[1][0] < 2 * (1 + restitution) * sqrt(2 * G) * dt  # the bounds tell something


@pytest.mark.parametrize("solver", ["reference", "cpu"])
@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "velocity-verlet"])
def test_it_comes_to_rest(solver: str, integrator: str) -> None:
    """After 3 times the fall it has bounced for ever: then it lies at the surface, and all that a step gives it is taken."""
    scene = ball(0.5, 0.002).replace({"method.integrator": integrator})
    heights = falls("reference" if solver == "reference" else "cpu", scene, 750)[-50:]
    assert heights.tolist() == [[0.0]] * 50


def test_a_soft_body_shares_what_its_touching_masses_get() -> None:
    """Of a cube the lower half touches: of its velocity v the impulse leaves (1 - (1 + e) / 2) v. Eight particles that sum to
    within 8 roundings of 4 m/s. (Rigid ones: test_rebound.py.)"""
    e, corners = 0.5, np.array([[x, y, z] for x in (0.0, 0.2) for y in (0.0, 0.2) for z in (0.0, 0.2)])
    scene = by_hand(
        clusters_of(corners, [np.arange(8)], stiffness=1e4), body=BRICK, gravity=0.0, plane=AWAY | FLOOR | {"restitution": e},
        method=method(dt=0.001),
    )  # fmt: skip
    down = np.tile([0.0, -4.0, 0.0], (8, 1))
    state = end_of_bodies(scene, start=start_of_bodies(scene, velocity=down), steps=1)
    assert state.velocity[:, 1].mean() == pytest.approx(-4 * (1 - (1 + e) / 2), abs=1e-12)


@each_solver
def test_friction_is_limited_by_the_whole_change(solver: str) -> None:
    """A mass comes at 2 m/s down and 3 m/s along: mu (1 + e) 2 m/s of the latter are lost; 1e-14: a few roundings."""
    e, mu, dt = 0.6, 0.25, 0.01
    scene = ball(e, dt, static_friction=mu, dynamic_friction=mu, velocity=(0.5, 0.0, 0.0))
    _, velocity = solve(solver, scene, 1, (0.0, 0.01, 0.0), (3.5, -2.0 + G * dt, 0.0))
    assert velocity[0] == pytest.approx([0.5 + 3 - mu * (1 + e) * 2, e * 2, 0], abs=1e-14)


def test_the_formulas_are_the_references() -> None:
    """Slow and fast, sticking and sliding, within 16 roundings of 10 m/s; with a restitution of 0 the bits of `respond`."""
    made, random = plain_formulas(formulas, np.float64), np.random.default_rng(3)
    slow, settled, bounced = made.settling_speed(-G, 0.05), 0, 0
    for _ in range(500):
        velocity, normal = random.normal(0, 2, 3), random.normal(size=3)
        normal /= np.linalg.norm(normal)
        static, e = random.uniform(0, 1, 2)
        plane = Plane(velocity=(0.3, -0.2, 0.1), static_friction=static, dynamic_friction=static / 2, restitution=e)
        given = velocity, plane.velocity, normal, static, static / 2
        found = np.array(made.rebound(*given, e, slow))
        assert found == pytest.approx(judge.touched(plane, slow, velocity, normal), abs=16 * 10 * 2.0**-53)
        assert made.rebound(*given, 0.0, slow) == made.respond(*given)
        into = -(velocity - plane.velocity) @ normal
        settled, bounced = settled + (0 < into <= slow), bounced + (into > slow)
    assert slow == 2 * G * 0.05 and settled > 50 and bounced > 50


@pytest.mark.parametrize("solver", ["cpu", pytest.param("gpu", marks=pytest.mark.gpu)])
def test_a_cloth_bounces_off_all_kinds(solver: str) -> None:
    """As the reference has it, within 1000 roundings of 3 m by 20 steps, and of what moves by that in a step."""
    common = {"static_friction": 0.4, "dynamic_friction": 0.3, "restitution": 0.7, "thickness": 0.02}
    scene = cloth(
        6, 7, sheet={"placement": "flat", "origin": (-0.3, 0.5, -0.3)}, structural={"stiffness": 5.0}, gravity={},
        plane=common | {"point": (0.0, 0.41, 0.0), "normal": (0.3, 1.0, 0.1)},
        sphere=common | {"center": (-0.2, 0.3, -0.2), "radius": 0.15},
        capsule=common | {"start": (0.1, 0.4, -0.3), "end": (0.4, 0.42, -0.2), "radius": 0.05},
        box=common | {"center": (0.4, 0.35, 0.2), "half_size": (0.1, 0.1, 0.1)},
        mesh_collider=common | {"shape": {"name": "terrain", "resolution": 2}, "origin": (0.0, 0.4, 0.0)},
        distance_field=common
        | {"shape": {"name": "torus", "resolution": 8, "scale": 0.4}, "spacing": 0.02, "origin": (0.05, 0.45, 0.1)},
        method={"integrator": "semi-implicit-euler", "dt": 0.01},
    )  # fmt: skip
    found, expected = solve(solver, scene, 20), solve("reference", scene, 20)
    assert (expected[1][:, 1] > 0.1).any()  # on their way back
    for own, wanted, size in zip(found, expected, (3, 300), strict=True):
        np.testing.assert_allclose(own, wanted, rtol=0, atol=1000 * size * 2.0**-53)


def test_nothing_changes_without_it() -> None:
    """No code where no collider gives back; and where another one does, the bits of those that do not stay."""
    scene = cloth(
        3, 4, sheet={"placement": "flat", "origin": (0.0, 0.05, 0.0)}, gravity={},
        plane=FLOOR | {"normal": [0.3, 1.0, 0.0], "static_friction": 0.1, "dynamic_friction": 0.05},
        method={"integrator": "semi-implicit-euler", "dt": 0.01},
    )  # fmt: skip
    beside = Scene(scene.as_dict() | {"far": {"kind": "plane", "point": [0.0, -9.0, 0.0], "restitution": 1.0}})
    assert "restitution" in cloth_parts(beside) - cloth_parts(scene)
    for own, other in zip(solve("cpu", scene, 30), solve("cpu", beside, 30), strict=True):
        assert np.array_equal(own, other)


def test_settling_follows_gravity() -> None:
    """What comes slower than gravity adds in two steps rests; without gravity, switched off while it runs, it bounces."""
    plane = AWAY | FLOOR | {"restitution": 0.5}
    scene = by_hand(clusters_of([[0.0, 0.0, 0.0]], [[0]]), body=BRICK, gravity=G, plane=plane, method=method(dt=0.01))
    start, seen = start_of_bodies(scene, velocity=[[0.0, -0.05, 0.0]]), []
    for enabled in (True, False):
        with opened(scene, initial=start) as simulation:
            simulation.set("gravity.enabled", enabled)
            simulation.advance(1)
            seen.append(simulation.state().velocity[0, 1])
    assert seen[0] == 0 and seen[1] == pytest.approx(0.025, abs=1e-15)


def test_a_scene_is_written_as_before_and_read() -> None:
    """What was measured of scenes without it is kept under their text."""
    for given in (0.0, 0.5):
        scene = ball(given, 0.01)
        assert ("restitution" in scene.as_dict()["plane"]) == (given > 0)
        assert Scene(scene.as_dict()).parts["plane"].restitution == given  # type: ignore[attr-defined]


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), True, "high"])
def test_bad_input(value: Any) -> None:
    with pytest.raises(SceneError) as caught:
        cloth(2, 2, plane={"restitution": value})
    assert caught.value.field == "plane.restitution"


def test_kernels_agree() -> None:
    """Group by group and stage by stage: the bits of each other."""
    scene = plate(0.8, 0.01)
    start = start_of_bodies(scene, scene.body_set.position - [0.0, 0.95, 0.0], np.full((10, 3), -4.0))
    fused, stages = (end_of_bodies(scene, start=start, kernel=kernel) for kernel in ("fused", "stages"))
    assert same(fused, stages) and (fused.velocity[:, 1] > 2).all()
