"""Contacts between particles of bodies on CPU threads: whom each finds against asking all, whole steps against the NumPy
reference and among kernels and threads, and the laws that contacts keep.

All scenes have the same parts, some of them next to nothing, so that kernels are compiled once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import SAMPLED, bodies_scene, end_state, lone_points, method, opened, start
from meeting_bodies import meeting, neighbours

from softlab.bench.reference.contact.particle_contacts import Contacts
from softlab.cpu_backend.contact.particles import ParticleContacts
from softlab.model.base.errors import Diverged
from softlab.model.contact.particle_parameters import (
    H_INVERSE_CELL,
    MAX_NEIGHBOURS,
    kinds_of_particles,
    particle_contact_record,
)
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.shape_matching.plan import body_parts

FREE = {"gravity": 0.0, "contact": {"maximum_speed": 1e3, "sleeping_speed": 1e-30}}
BAR = {"kind": "soft_body", "particle_spacing": 0.16, "adhesion": 1e-30, **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": 0.125, "adhesion": 1e-30, **SAMPLED}  # 32 particles, 0.125 m apart
STEPS = 8


def contacts_of(scene: Scene, real: Any, bands: int = 1) -> ParticleContacts:
    particles = scene.body_set.particle_count
    return ParticleContacts(scene, real, "exact", body_parts(scene), np.arange(particles), particles, bands)


def planes(position: np.ndarray, real: Any) -> np.ndarray:
    return np.ascontiguousarray(position.T, real).reshape(-1)


# ---------------------------------------------------------------------- whom they find


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("extent,bands", [(0.5, 1), (0.05, 3), (50.0, 2)])
def test_neighbours_are_those_of_asking_all(extent: float, bands: int, real: Any) -> None:
    """In a heap, in a clump where there are more than are kept, and scattered so far that the table holds but a part and goes
    round; some in one place, some on the borders of cells, some parked, lost in space or no numbers."""
    scene, random = meeting(copies=2), np.random.default_rng(5)
    particles, cell = scene.body_set.particle_count, 1 / particle_contact_record(scene, real)[H_INVERSE_CELL]
    position = random.uniform(-1, 1, (particles, 3)) * min(extent, 0.5)
    position[::3] += random.uniform(-extent, extent, 3) * (extent > 1)
    position[1::3] -= random.uniform(-extent, extent, 3) * (extent > 1)
    position[3], position[11] = position[-1], position[7]
    position[4:9] = np.round(position[4:9] / cell) * cell
    position[12], position[25, 1], position[26, 2] = np.nan, np.inf, -1e20
    weight = np.ones(particles)
    weight[[2, 20]] = 0
    contacts, lost = contacts_of(scene, real, bands), 0
    for _ in range(2):
        contacts.find(planes(position, real), weight.astype(real))
        expected = neighbours(scene, position.astype(real), weight, real)
        found = contacts.neighbours.lists()
        assert [found.get(i, []) for i in range(particles)] == [others[:MAX_NEIGHBOURS] for others in expected]
        lost += sum(max(0, len(others) - MAX_NEIGHBOURS) for others in expected)
        assert contacts.lost == lost
        position, weight = position[::-1].copy(), weight[::-1].copy()
    assert sum(map(len, expected)) > 50
    assert (lost > 0) == (extent < 0.1)


def test_kinds_and_copies_are_told_apart() -> None:
    scene = meeting(copies=2)
    assert np.array_equal(np.unique(kinds_of_particles(scene)), [0, 1]) and len(scene.body_set.copies) == 8


# ---------------------------------------------------------------------- whole steps


def test_no_number_is_told() -> None:
    scene, velocity = meeting(maximum_speed=1e306), np.zeros((29, 3))
    velocity[4, 1] = 1e150
    with opened(scene, initial=start(scene, velocity=velocity)) as simulation, pytest.raises(Diverged):
        simulation.advance(2)
        simulation.state()


def test_a_new_dt_changes_the_contacts() -> None:
    """A point that is told to go no faster than 2 m/s goes that far in the new step."""
    scene = lone_points([[0.0, 0.0, 0.0]], velocity=[[0.0, 9.0, 0.0]], maximum_speed=2.0)
    with opened(scene) as simulation:
        simulation.advance(1)
        simulation.set("method.dt", 0.02)
        simulation.advance(1)
        assert simulation.state().position[0, 1] == pytest.approx(2.0 * 0.03, rel=1e-14)


# ---------------------------------------------------------------------- laws


def test_a_collision_keeps_momentum() -> None:
    """Of two soft bars, weights 1 apart: mass times way is kept in every sweep, but for roundings of places of 0.6 m, over h:
    of 48 particles of 2^-53 x 0.6 m each, in 10 substeps of 8 operations."""
    scene = bodies_scene(
        one=BAR | {"velocity": [2.0, 0.3, 0.0]},
        other=BAR | {"origin": [1.02, 0.05, 0.1], "density": 300.0},
        method=method(1, 1),
        **FREE,
    )
    body_set, m = scene.body_set, scene.body_set.clusters.mass[:, None]
    with opened(scene) as simulation:
        simulation.advance(10)
        state, met = simulation.state(), simulation.contacts.neighbours.lists()
    assert met and np.abs(state.velocity - body_set.velocity).max() > 0.5
    change = (m * (state.velocity - body_set.velocity)).sum(axis=0)
    assert np.abs(change).max() < 10 * 8 * (m * 2.0**-53 * 0.6 / 0.01).sum()


def test_a_body_that_meets_nobody_is_left_alone() -> None:
    """A soft bar that spins and is stretched by it: its neighbours at rest do not push, nor do those that avoid it."""
    bar = BAR | {"spin": [1.0, 2.0, 9.0]}
    there = bar | {"origin": [0.05, 0.03, 0.02], "group": 3}
    alone = bodies_scene(bar=bar, method=method(1, 1), **FREE)
    avoiding = bodies_scene(bar=bar | {"avoids": [3]}, there=there, method=method(1, 1), **FREE)
    plain = bodies_scene(bar={k: v for k, v in bar.items() if k != "adhesion"}, method=method(1, 1), gravity=0.0)
    expected = end_state(plain).position
    assert np.array_equal(end_state(alone).position, expected)
    assert np.array_equal(end_state(avoiding).position[: len(expected)], expected)


PROJECTIONS = pytest.mark.parametrize("iterations,sweeps", [(1, 1), (4, 1), (1, 4), (2, 3)])


@PROJECTIONS
def test_adhesion_pulls_with_its_acceleration(iterations: int, sweeps: int) -> None:
    """Two free points just apart come nearer by a h^2 n (n + 1) / 2 in n steps, however many projections share it; to the
    roundings of 0.1 m of each, whose effect grows as the square of the steps."""
    scene = lone_points([[0.0, 0.0, 0.0], [0.11, 0.0, 0.0]], adhesion=5.0, iterations=iterations, sweeps=sweeps)
    expected = 0.11 - 5.0 * 0.01**2 * 5 * 6 / 2
    bound = 5**2 * 4 * iterations * sweeps * 2.0**-53 * 0.1
    position, velocity, contacts = scene.body_set.position, np.zeros((2, 3)), Contacts(scene)
    for _ in range(5):  # the reference's, of nothing but contacts
        before, position = position, position + 0.01 * velocity
        contacts.find(position)
        for _ in range(iterations):
            position = contacts.sweep(before, position)
        velocity = (position - before) / 0.01
    for found in (end_state(scene, steps=5).position, position):
        assert found[1, 0] - found[0, 0] == pytest.approx(expected, abs=bound)


@PROJECTIONS
@pytest.mark.parametrize("part,stays", [(0.9, True), (1.1, False)])
def test_adhesion_holds_what_it_can(part: float, stays: bool, iterations: int, sweeps: int) -> None:
    """Two points that touch, 1 kg each; a force pulls one away at a part of the acceleration with which they cling."""
    scene = lone_points([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], adhesion=5.0, iterations=iterations, sweeps=sweeps)
    with opened(scene) as simulation:
        simulation.poke(1, (5.0 * part, 0.0, 0.0))
        simulation.advance(60)
        position = simulation.state().position
    apart = position[1, 0] - position[0, 0]
    assert (apart == pytest.approx(0.1, abs=1e-14)) if stays else apart > 0.125


@pytest.mark.parametrize("slip,taken", [(0.009, 0.009), (0.02, 0.3 * 0.02)])
def test_friction_takes_back_what_its_cone_holds(slip: float, taken: float) -> None:
    """Two points that come 0.02 m too near along x and slide along z: static 0.5 holds 0.01 m, dynamic 0.3 takes 0.006 m."""
    scene = lone_points([[0.0, 0.0, 0.0], [0.1, 0.0, -slip]], static_friction=0.5, dynamic_friction=0.3)
    contacts, weights = contacts_of(scene, np.float64), np.ones(2)
    before, now = planes(scene.body_set.position, np.float64), planes(scene.body_set.position, np.float64)
    now[0], now[5] = 0.02, 0.0
    contacts.find(now, weights)
    contacts.project(before, now, weights)
    expected = [[0.01, 0.11], [0.0, 0.0], [taken / 2, -taken / 2]]
    assert now.reshape(3, 2) == pytest.approx(np.array(expected), abs=1e-16)


def test_points_in_one_place_part_upwards_and_downwards() -> None:
    """By the speed of separation, 1 m/s in 0.01 s, half of it each; the first one down."""
    state = end_state(lone_points([[0.3, 0.2, 0.1]] * 2, separation_speed=1.0), steps=1)
    assert state.position - [0.3, 0.2, 0.1] == pytest.approx(np.array([[0, -0.005, 0], [0, 0.005, 0]]), abs=1e-15)


def test_a_point_keeps_to_its_speeds() -> None:
    """0.9 m/s where 0.5 is allowed; 1 mm/s, which is asleep under 2 mm/s."""
    points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    moving = [[0.9, 0.0, 0.0], [0.0, 0.0, 0.001]]
    scene = lone_points(points, velocity=moving, maximum_speed=0.5, sleeping_speed=0.002)
    state = end_state(scene, steps=1)
    assert state.position == pytest.approx(np.array([[0.005, 0.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-16)
    assert state.velocity == pytest.approx(np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]), abs=1e-14)


def test_more_neighbours_than_are_kept_are_counted() -> None:
    points = 2 * MAX_NEIGHBOURS
    with opened(lone_points(np.zeros((points, 3)))) as simulation:
        simulation.advance(1)
        assert simulation.contacts_lost == points * (points - 1 - MAX_NEIGHBOURS)
        assert np.isfinite(simulation.state().position).all()


# ---------------------------------------------------------------------- the catalogue's


def test_the_catalogues_letters_stick() -> None:
    """The upper pair stays together: over a second and a half, a few of its oscillations, its middles come no farther apart
    than a tenth of a metre a second; the lower pair parts."""
    scene = load_scene("sticky")
    m, body = scene.body_set.clusters.mass, scene.body_set.body

    def middles(values: np.ndarray) -> np.ndarray:
        return np.array([np.average(values[body == b, 0], weights=m[body == b]) for b in range(4)])

    with opened(scene, precision="float32", live=()) as simulation:
        simulation.advance(60)
        one, other, *_ = middles(simulation.state().position)
        simulation.advance(90)
        state = simulation.state()
    after, other_after, *_ = middles(state.position)
    _, _, left, right = middles(state.velocity)
    assert abs((other_after - after) - (other - one)) < 0.1 * 1.5 and right - left > 0.3
