"""Contacts between particles on CUDA, in plain Python: who meets whom against asking all, what they do against the
independent NumPy reference, whole steps to the bits of the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import bodies_scene, lone_points, opened, start
from meeting_bodies import BRICK, SOFT, meeting, neighbours, smooth
from numba import cuda

from softlab.bench.reference.contact import particle_contacts as reference
from softlab.gpu_backend.contact.particles import ParticleContacts
from softlab.gpu_backend.core.scan import CHUNK, Scan
from softlab.model.base.errors import Diverged
from softlab.model.contact.particle_parameters import H_INVERSE_CELL, MAX_NEIGHBOURS, particle_contact_record
from softlab.model.scene.scene import Scene


def cloud(scene: Scene, extent: float, real: Any) -> np.ndarray:
    """(particles, 3): anywhere in a box around the origin; some in one place, some on borders of cells."""
    random, cell = np.random.default_rng(5), 1 / particle_contact_record(scene, real)[H_INVERSE_CELL]
    position = random.uniform(-extent, extent, (scene.body_set.particle_count, 3)).astype(real)
    position[3], position[11] = position[-1], position[7]
    position[4:9] = np.round(position[4:9] / cell) * cell
    return position


def quads(position: np.ndarray, weight: np.ndarray, real: Any) -> Any:
    return cuda.to_device(np.concatenate([position, weight[:, None]], axis=1).astype(real).reshape(-1))


def found_by(contacts: ParticleContacts, particles: int) -> list[list[int]]:
    kept = np.minimum(contacts.neighbours.neighbour_counts.copy_to_host(), MAX_NEIGHBOURS)
    table = contacts.neighbours.table.copy_to_host().reshape(MAX_NEIGHBOURS, particles)
    return [table[:n, i].tolist() for i, n in enumerate(kept)]


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("extent", [0.5, 0.05])
def test_neighbours_are_those_of_asking_all(extent: float, real: Any) -> None:
    """Also where there are more than are kept, and of particles that are parked, lost in space or no numbers. Twice, since
    the table must be empty again."""
    scene = meeting()
    particles, position = scene.body_set.particle_count, cloud(scene, extent, real)
    weight = np.ones(particles)
    weight[[2, 20]] = 0
    position[5], position[25, 1] = np.nan, np.inf
    contacts, lost = ParticleContacts(scene, real, "exact", 0), 0
    for _ in range(2):
        contacts.find(quads(position, weight, real))
        expected = neighbours(scene, position, weight, real)
        assert np.array_equal(contacts.neighbours.neighbour_counts.copy_to_host(), [len(others) for others in expected])
        assert found_by(contacts, particles) == [others[:MAX_NEIGHBOURS] for others in expected]
        lost += sum(max(0, len(others) - MAX_NEIGHBOURS) for others in expected)
        assert contacts.lost == lost
        position = position[::-1].copy()
        weight = weight[::-1].copy()
    assert any(expected)


def test_more_neighbours_than_are_kept() -> None:
    """Bodies that do not meet themselves, squeezed into a cell."""
    scene = bodies_scene(soft=SOFT | {"copies": [1, 3, 1], "self_collision": False}, contact={})
    particles = scene.body_set.particle_count
    position = np.random.default_rng(1).uniform(0.0, 0.02, (particles, 3))
    contacts = ParticleContacts(scene, np.float64, "exact", 0)
    contacts.find(quads(position, np.ones(particles), np.float64))
    expected = neighbours(scene, position, np.ones(particles), np.float64)
    assert found_by(contacts, particles) == [others[:MAX_NEIGHBOURS] for others in expected]
    assert contacts.lost == sum(len(others) - MAX_NEIGHBOURS for others in expected) > 0
    contacts.forget()
    assert contacts.lost == 0


def test_what_is_projected_is_the_references() -> None:
    scene = meeting(1, 1)
    scale, random = 1 / scene.body_set.clusters.mass.mean(), np.random.default_rng(3)
    before = scene.body_set.position + random.normal(0, 0.02, scene.body_set.position.shape)
    predicted = before + random.normal(0, 0.02, before.shape) - [0.0, 0.05, 0.0]
    checked = reference.Contacts(scene)
    weight = checked.weight / scale
    contacts = ParticleContacts(scene, np.float64, "exact", 0)
    was, now = quads(before, weight, np.float64), quads(predicted, weight, np.float64)
    contacts.find(now)
    contacts.project(was, now)
    checked.find(predicted)
    expected = checked.sweep(before, predicted)
    assert abs(expected - predicted).max() > 0.01 and contacts.lost == 0
    state = now.copy_to_host().reshape(-1, 4)
    # two sweeps of at most MAX_NEIGHBOURS contacts, of some ten operations each, of lengths under 1 m
    np.testing.assert_allclose(state[:, :3], expected, rtol=0, atol=2 * MAX_NEIGHBOURS * 10 * 2.0**-53)
    assert np.array_equal(state[:, 3], weight)


def test_two_in_one_place_part_upwards_and_downwards() -> None:
    """By the speed of separation, 1 m/s in 0.01 s, half of it each; the first one down."""
    place = [0.3, 0.2, 0.1]
    scene = lone_points([place] * 2, separation_speed=1.0)
    contacts, weight = ParticleContacts(scene, np.float64, "exact", 0), np.ones(2)
    was, now = (quads(np.array([place] * 2), weight, np.float64) for _ in range(2))
    contacts.find(now)
    contacts.project(was, now)
    moved = now.copy_to_host().reshape(-1, 4)[:, :3] - place
    np.testing.assert_allclose(moved, [[0, -0.005, 0], [0, 0.005, 0]], atol=1e-15)


def test_no_number_is_told_and_not_met() -> None:
    scene = smooth()
    velocity = np.zeros_like(scene.body_set.position)
    velocity[0, 1] = 1e300
    with (
        opened(scene, "gpu", kernel="launch", initial=start(scene, velocity=velocity)) as simulation,
        pytest.raises(Diverged),
    ):
        simulation.advance(2)
        simulation.state()


def test_sums_of_more_chunks_than_a_block_has_threads() -> None:
    count = CHUNK * (CHUNK + 1) + 5
    numbers = np.random.default_rng(2).integers(0, 9, count).astype(np.int32)
    counts, starts = cuda.to_device(numbers), cuda.to_device(np.zeros(count, np.int32))
    Scan(count, 0).run(counts, starts, starts)
    assert np.array_equal(starts.copy_to_host(), np.cumsum(numbers) - numbers)


def test_bodies_of_one_brick_have_nobody_to_meet() -> None:
    scene = bodies_scene(brick=BRICK, contact={})
    with opened(scene, "gpu", kernel="launch") as simulation:
        simulation.advance(1)
        assert not simulation.contacts.neighbours.neighbour_counts.copy_to_host().any()
