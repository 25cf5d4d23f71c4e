"""Contacts between particles on a real GPU: neighbours, `fast` math near `exact`, states without numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import end_state, opened
from meeting_bodies import meeting, neighbours

from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu


def crowded() -> Scene:
    """450 bodies of two kinds, 6525 particles: the table's sums take several chunks."""
    return meeting(2, 1, copies=15, sweeps=1)


def test_neighbours_are_those_of_asking_all() -> None:
    from softlab.gpu_backend.contact.particles import ParticleContacts

    scene = meeting()
    particles, random = scene.body_set.particle_count, np.random.default_rng(4)
    weight = np.ones(particles)
    weight[[2, 20]] = 0
    for real in (np.float32, np.float64):
        contacts = ParticleContacts(scene, real, "exact", 0)
        for extent in (0.5, 0.1, 0.02):
            position = random.uniform(-extent, extent, (particles, 3)).astype(real)
            position[3], position[5], position[25, 1] = position[-1], np.nan, np.inf
            expected = neighbours(scene, position, weight, real)
            contacts.find(on_device(position, weight, real))
            found = contacts.neighbours.neighbour_counts.copy_to_host()
            table = contacts.neighbours.table.copy_to_host().reshape(MAX_NEIGHBOURS, particles)
            assert np.array_equal(found, [len(others) for others in expected])
            for i, others in enumerate(expected):
                assert table[: found[i], i].tolist() == others[:MAX_NEIGHBOURS]


def on_device(position: np.ndarray, weight: np.ndarray, real: Any) -> Any:
    from numba import cuda

    return cuda.to_device(np.concatenate([position, weight[:, None]], axis=1).astype(real).reshape(-1))


def test_fast_math_is_near_exact() -> None:
    """Neighbours are the same ones. Two sweeps over MAX_NEIGHBOURS contacts at most are some ten operations each, on lengths
    under 1 m, and approximate roots and quotients are good to 2^-22."""
    from softlab.gpu_backend.contact.particles import ParticleContacts

    scene, random, found = meeting(), np.random.default_rng(6), []
    before = scene.body_set.position + random.normal(0, 0.02, scene.body_set.position.shape)
    predicted = before + random.normal(0, 0.02, before.shape) - [0.0, 0.05, 0.0]
    weight = np.ones(len(before))
    for math in ("fast", "exact"):
        was, now = (on_device(a, weight, np.float32) for a in (before, predicted))
        contacts = ParticleContacts(scene, np.float32, math, 0)
        contacts.find(now)
        contacts.project(was, now)
        found.append((contacts.neighbours.neighbour_counts.copy_to_host(), now.copy_to_host().reshape(-1, 4)[:, :3]))
    assert np.array_equal(found[0][0], found[1][0])
    assert abs(found[1][1] - predicted).max() > 0.005
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=0, atol=2 * MAX_NEIGHBOURS * 10 * 2.0**-22)


def test_a_state_without_numbers_is_told() -> None:
    """And does not let all particles meet in one cell."""
    from softlab.model.base.errors import Diverged

    scene = crowded().replace({"contact.maximum_speed": None})
    state: State = end_state(scene, "gpu", steps=1)
    state.velocity[:, 1] = 1e300
    with opened(scene, "gpu", initial=state) as simulation, pytest.raises(Diverged):
        simulation.advance(4)
        simulation.state()
