"""Pinned vertices of tetrahedral bodies that move: by motions and by targets, with every solver; against closed forms."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
import pytest
from kinematic_scenes import BAR, ENDS, SOLVERS, kinematic_scene, run
from vbd_scenes import elastic_force

from softlab.app.driver import open_simulation
from softlab.model.base.errors import InputError, SceneError, UnstableTimeStep
from softlab.model.scene.scene import Scene
from softlab.model.tables.regions import Region

DT = 0.01
EXACT: dict[str, Any] = {"precision": "float64", "math": "exact", "threads": 1}


@pytest.mark.parametrize("solver", SOLVERS)
def test_pins_are_where_their_motion_has_them_and_as_fast(solver: str) -> None:
    """To rounding: of an angle of at most 0.3 over 0.1 m, and of sums of some tenths of a metre."""
    scene = kinematic_scene(solver, **ENDS)
    found = scene.tetrahedra_set
    with open_simulation(scene, **EXACT) as simulation:
        for steps in (0, 3, 7):
            simulation.advance(steps)
            state = simulation.state()
            for word, rate, along in (("left", 2.0, 0.0), ("right", -3.0, 0.2)):
                x, y, z = found.position[found.chosen(word)].T
                angle = rate * state.time
                c, s = cos(angle), sin(angle)
                place = np.column_stack([x + along * state.time, c * y - s * z, s * y + c * z])
                speed = np.column_stack([np.full(len(x), along), -rate * place[:, 2], rate * place[:, 1]])
                at = found.chosen(word)
                np.testing.assert_allclose(state.position[at], place, atol=1e-15)
                np.testing.assert_allclose(state.velocity[at], speed, atol=1e-14)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_body_that_moves_as_its_end_does_goes_on_so(solver: str) -> None:
    """Nothing is strained, so that every place is the start's plus v t, to the rounding of 20 steps: of lengths of 0.3 m,
    which stiffnesses of E h^2 / (rho l^2) = 1 magnify little."""
    speed = (0.3, -0.2, 0.1)
    scene = kinematic_scene(
        solver, bar=BAR | {"pinned": ["left"], "velocity": list(speed)},
        end={"kind": "motion", "pins": "left", "velocity": list(speed), "duration": 9.0},
    )  # fmt: skip
    state = run(scene, 20, **EXACT)
    np.testing.assert_allclose(state.position, scene.tetrahedra_set.position + 20 * DT * np.array(speed), atol=1e-13)
    np.testing.assert_allclose(state.velocity, np.tile(speed, (len(state.velocity), 1)), atol=3e-11)


def test_an_end_that_is_driven_takes_the_body_with_it() -> None:
    """In the end the body moves as its end does, sags as one that hangs does, and weighs what its free part weighs there.
    Its damper does not slow a turn, so that it swings for longer than its strain does."""
    scene = kinematic_scene(
        "newton", bar=BAR | {"pinned": ["left"], "damping": 0.05}, gravity={"acceleration": 9.81},
        end={"kind": "motion", "pins": "left", "velocity": [0.1, 0.2, 0.0], "duration": 90.0},
        method={"solver": "newton", "dt": 0.05, "iterations": 20},
    )  # fmt: skip
    found = scene.tetrahedra_set
    state = run(scene, 160, **EXACT)
    np.testing.assert_allclose(state.velocity - [0.1, 0.2, 0.0], 0, atol=1e-6)
    still = kinematic_scene(
        "newton", bar=BAR | {"pinned": ["left"], "damping": 0.05}, gravity={"acceleration": 9.81},
        method={"solver": "newton", "dt": 0.05, "iterations": 20},
    )  # fmt: skip
    np.testing.assert_allclose(
        state.position - state.time * np.array([0.1, 0.2, 0.0]), run(still, 120, **EXACT).position, atol=1e-6
    )
    weight = 9.81 * np.delete(found.masses, found.pinned_vertices).sum()
    held = elastic_force(found, state.position)[found.pinned_vertices].sum(axis=0)
    np.testing.assert_allclose(held, [0.0, -weight, 0.0], atol=1e-4 * weight)


def test_both_ends_of_a_twisted_bar_are_turned_back_alike() -> None:
    """The torques add up to nothing once it rests. Their size: between Saint-Venant's G J theta / L, J = 0.1406 a^4 of a
    square, and half as much more: displacements that are linear in tetrahedra, and ends that stay flat, only stiffen."""
    bar = BAR | {
        "pinned": ["left", "right"],
        "damping": 0.05,
        "shape": {"name": "box", "sides": [0.4, 0.1, 0.1]},
        "edge": 0.025,
    }
    turn = {"kind": "motion", "angular_velocity": 0.1, "duration": 0.5}
    scene = kinematic_scene(
        "newton", bar=bar, left_end=turn | {"pins": "left"},
        right_end=turn | {"pins": "right", "angular_velocity": -0.1},
        method={"solver": "newton", "dt": 0.05, "iterations": 20},
    )  # fmt: skip
    found = scene.tetrahedra_set
    state = run(scene, 60, **EXACT)
    force = elastic_force(found, state.position)
    torque = {
        word: float(np.cross(state.position[at], force[at])[:, 0].sum())
        for word, at in (("left", found.chosen("left")), ("right", found.chosen("right")))
    }
    assert torque["left"] == pytest.approx(-torque["right"], rel=1e-6)
    exact = bar["young_modulus"] / 2.6 * 0.1406 * 0.1**4 * 0.1 / 0.4
    assert 1 < abs(torque["left"]) / exact < 1.5


@pytest.mark.parametrize("solver", SOLVERS)
def test_pinned_vertices_go_to_their_targets_and_rest_there(solver: str) -> None:
    scene = kinematic_scene(solver)
    found = scene.tetrahedra_set
    at, steps = found.pinned_vertices, np.array([[0.01, 0.02, -0.03], [0.0, 0.01, 0.0]])
    with open_simulation(scene, live=("targets",), **EXACT) as simulation:
        goal = found.position
        for way in steps:
            goal = goal + way
            simulation.targets(goal)
            simulation.advance(1)
            state = simulation.state()
            np.testing.assert_allclose(state.position[at], goal[at], atol=1e-15)
            np.testing.assert_allclose(state.velocity[at], np.tile(way / DT, (len(at), 1)), atol=1e-12)
        simulation.advance(2)
        np.testing.assert_allclose(simulation.state().position[at], goal[at], atol=1e-15)
        assert not simulation.state().velocity[at].any()
        simulation.targets(goal + 1.0)
        simulation.reset()
        simulation.advance(1)
        np.testing.assert_allclose(simulation.state().position[at], found.position[at], atol=1e-15)


def test_a_motion_of_the_scene_goes_before_targets() -> None:
    scene = kinematic_scene("xpbd", **ENDS)
    found, expected = scene.tetrahedra_set, run(scene, 2, **EXACT)
    with open_simulation(scene, live=("targets",), **EXACT) as simulation:
        simulation.targets(np.full_like(found.position, np.nan))  # of none that is its own
        simulation.advance(2)
        assert simulation.state().position.tobytes() == expected.position.tobytes()


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"bar": BAR | {"pinned": []}, "end": {"kind": "motion", "pins": "left"}}, r"end.pins = 'left'.*bar.pinned"),
        ({"end": {"kind": "motion", "pins": "top"}}, r"of these \d+ vertices are not pinned; name them in bar.pinned"),
        ({"end": {"kind": "motion", "pins": "middle"}}, "must be one of left, right"),
        ({"end": {"kind": "motion", "pins": "left", "body": "ball"}}, "end.body = 'ball': must be one of bar"),
        ({"end": {"kind": "motion", "pins": [[0, 1]]}}, "must be a side, a region or all"),
        ({"a": {"kind": "motion", "pins": "all"}, "b": {"kind": "motion", "pins": "left"}}, "already follows a"),
        ({"bar": BAR | {"pinned": ["leff"]}}, r"bar.pinned = 'leff'.*did you mean left"),
        ({"there": {"kind": "region", "radius": 1.0}}, "a region is given by one of"),
        ({"there": {"kind": "region", "center": [0.0] * 3}}, "there.radius"),
        ({"there": {"kind": "region", "shape": {"name": "sheet"}}}, "has no inside"),
        ({"there": {"kind": "region", "low": [1.0] * 3, "high": [0.0] * 3}}, "there.high"),
        (
            {
                "there": {"kind": "region", "center": [9.0] * 3, "radius": 0.1},
                "end": {"kind": "motion", "pins": "there"},
            },
            "no vertex lies there",
        ),
    ],
)
def test_what_no_motion_can_be_is_one_clear_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises((SceneError, InputError), match=words) as caught:
        kinematic_scene("xpbd", **changes)
    assert "\n" not in str(caught.value)


def test_what_no_target_can_be_is_one_clear_line() -> None:
    scene = kinematic_scene("xpbd")
    place = scene.tetrahedra_set.position
    bad = place.copy()
    bad[scene.tetrahedra_set.pinned_vertices[0], 1] = np.nan
    with open_simulation(scene, live=("targets",), **EXACT) as simulation:
        for given, words in ((place[1:], "a place for every particle"), (bad, "must be finite")):
            with pytest.raises(SceneError, match=words):
                simulation.targets(given)
    for other, live, words in (
        (scene, (), "not live"),
        (kinematic_scene("xpbd", bar=BAR | {"pinned": []}), ("targets",), "no vertex is pinned"),
    ):
        with open_simulation(other, live=live, **EXACT) as simulation, pytest.raises(SceneError, match=words):
            simulation.targets(place)


REGIONS: dict[str, tuple[dict[str, Any], list[bool]]] = {
    "box": ({"low": [0.0] * 3, "high": [1.0, 0.5, 1.0]}, [True, True, False, False]),
    "open box": ({"low": [0.0, 0.4, 0.0]}, [False, True, True, False]),
    "ball": ({"center": [0.0, 0.5, 0.0], "radius": 0.3}, [False, True, False, False]),
    "capsule": ({"start": [0.0, 0.0, 0.0], "end": [0.0, 0.8, 0.0], "radius": 0.1}, [True, True, False, False]),
    "half-space": ({"point": [0.0, 0.2, 0.0], "normal": [0.0, -1.0, 0.0]}, [True, False, False, True]),
    "mesh": (
        {"shape": {"name": "box", "sides": [0.4, 0.4, 2.2]}, "angle": 90.0, "axis": [1.0, 0.0, 0.0]},
        [True, True, True, False],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REGIONS)
def test_regions_hold_what_lies_in_them(name: str) -> None:
    """Four points along y: at 0.01, 0.5, 1 and -2 m."""
    points = np.array([[0.01, 0.01, 0.01], [0.01, 0.5, 0.01], [0.01, 1.0, 0.01], [0.01, -2.0, 0.01]])
    table, expected = REGIONS[name]
    assert Region(**table).holds(points, 1e-9).tolist() == expected


def test_what_is_within_a_moving_mesh_follows_it() -> None:
    """A tube within the bar: the vertices that it holds turn with it as a rigid body does."""
    scene = Scene({
        "bar": BAR | {"pinned": ["tube"]},
        "tube": {"kind": "region", "shape": {"name": "box", "sides": [1.0, 0.02, 0.02]}},
        "turn": {"kind": "motion", "pins": "tube", "angular_velocity": 3.0, "axis": [0.0, 1.0, 0.0], "duration": 9.0},
        "method": {"solver": "xpbd", "dt": DT, "substeps": 2},
    })  # fmt: skip
    found = scene.tetrahedra_set
    inside = np.abs(found.position[:, 1:]).max(axis=1) < 0.01
    assert found.pinned_vertices.tolist() == np.flatnonzero(inside).tolist() and 1 < inside.sum() < len(inside)
    state, rest = run(scene, 5, **EXACT), found.position[inside]
    for here, there in ((state.position[inside], rest),):
        apart = np.linalg.norm(here[:, None] - here[None], axis=2)
        np.testing.assert_allclose(apart, np.linalg.norm(there[:, None] - there[None], axis=2), atol=1e-15)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_body_s_own_damping_is_a_terminal_speed(solver: str) -> None:
    """Explicit: v is v (1 - h a) + h g a substep, so that g / a (1 - (1 - h a)^n) is the speed after n of them, whatever the
    masses; the other body falls freely."""
    rate, heavy = 4.0, {"kind": "material", "region": "half", "density": 5000.0}
    scene = kinematic_scene(
        solver, bar=BAR | {"pinned": [], "mass_damping": rate}, gravity={"acceleration": 9.81}, heavy=heavy,
        half={"kind": "region", "low": [0.0, -1.0, -1.0]}, free=BAR | {"pinned": [], "origin": [0.0, 1.0, 0.0]},
    )  # fmt: skip
    state, found = run(scene, 20, **EXACT), scene.tetrahedra_set
    first = found.first_particle[1]
    fallen = 9.81 / rate * (1 - (1 - rate * DT / 2) ** 40)
    np.testing.assert_allclose(state.velocity[:first, 1], -fallen, rtol=1e-9)
    np.testing.assert_allclose(state.velocity[first:, 1], -9.81 * 20 * DT, rtol=1e-9)


def test_a_step_that_its_damping_would_overshoot_is_refused() -> None:
    scene = kinematic_scene("xpbd", bar=BAR | {"mass_damping": 500.0})
    with pytest.raises(UnstableTimeStep, match=r"0\.008"):
        open_simulation(scene, **EXACT)
