"""Clusters that keep a strain, and those that damp the motion inside: closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies_scenes import (
    BAR,
    bodies_scene,
    by_hand,
    end_state,
    method,
    opened,
    start,
)
from closed_meshes import rotation as rotation_by
from test_bodies_material import CORNERS, EPS, SQUEEZE, H, block, placed, run_of

from softlab.model.assets.clusters import Clusters, matching_factor
from softlab.model.core.plan import Moment

# ---------------------------------------------------------------------- creep


def held(clusters: Clusters, corners: np.ndarray, times: int) -> np.ndarray:
    """The strain of the block after `times` looks at particles that do not move."""
    scene = by_hand(clusters, method=method(1, 1, H))
    with opened(scene, kernel="stages", initial=start(scene, placed(corners))) as simulation:
        for _ in range(times):
            simulation.stages["match clusters"](Moment())
        found: np.ndarray = simulation.read("plastic")[0]
    return found


def test_a_held_block_takes_the_set_of_its_rate() -> None:
    """Sp' = (1 + k (F / p - 1)) p = p + k (F - p), over the cube root of its volume, k = 1 - exp(-c h); 12 matches."""
    clusters = block(creep=5.0, limit=0.9)
    expected, k = np.ones(3), -np.expm1(-5.0 * H)
    for _ in range(12):
        expected = expected + k * (np.diag(SQUEEZE) - expected)
        expected /= np.cbrt(expected.prod())
    found = held(clusters, CORNERS @ SQUEEZE, 12)
    assert found == pytest.approx(np.diag(expected), abs=12 * 64 * EPS)
    assert np.linalg.det(found) == pytest.approx(1, abs=8 * EPS)
    turn = rotation_by([0.5, -0.2, 1.1])  # a strain is one of the body, whichever way that is turned
    assert held(clusters, CORNERS @ SQUEEZE @ turn.T, 12) == pytest.approx(found, abs=12 * 256 * EPS)


def test_a_squeezed_block_keeps_what_is_over_the_threshold() -> None:
    """Held until nothing creeps any more its strain is the threshold's, or less by a match's creep, k of it; let go it swings
    about the shape then and comes to rest there. What is left of a swing after n steps is (1 - a)^(n / 2)."""
    threshold, creep = 0.1, 5.0
    clusters = block(3600.0, threshold=threshold, creep=creep, limit=0.9)
    kept = held(clusters, CORNERS @ SQUEEZE, 100)
    left = np.linalg.norm(SQUEEZE @ np.linalg.inv(kept) - np.eye(3))
    assert (1 - 2 * -np.expm1(-creep * H)) * threshold < left <= threshold
    assert np.linalg.norm(kept - np.eye(3)) > np.linalg.norm(SQUEEZE - np.eye(3)) - 1.3 * threshold
    scene = by_hand(clusters, method=method(1, 1, H))
    begin = replace(start(scene, placed(CORNERS @ SQUEEZE)), plastic=np.array([kept, np.eye(3)]))
    state, a = end_state(scene, start=begin, steps=200), matching_factor(3600.0, H, 1)
    assert np.array_equal(state.plastic[0], kept)
    assert np.abs(state.position[:8] - CORNERS @ kept.T).max() < (1 - a) ** 100 + 200 * 64 * EPS


def test_under_the_threshold_nothing_is_kept() -> None:
    clusters = block(3600.0, threshold=0.5, creep=1000.0, limit=0.9)
    state = run_of(clusters, CORNERS @ SQUEEZE, 200)
    assert np.array_equal(state.plastic[0], np.eye(3))
    a = matching_factor(3600.0, H, 1)
    assert np.abs(state.position[:8] - CORNERS).max() < (1 - a) ** 100 + 200 * 64 * EPS


def test_a_strain_ends_at_its_limit() -> None:
    """Cut to 0.1, over the cube root of the volume of 1 + D, which is 1 to second order."""
    found = held(block(creep=1000.0, limit=0.1), CORNERS @ np.diag([2.0, 0.5, 1.0]), 20)
    assert 0.09 < np.linalg.norm(found - np.eye(3)) < 0.1 * 1.1 and np.linalg.det(found) == pytest.approx(
        1, abs=8 * EPS
    )


# ---------------------------------------------------------------------- damping


def slowed(scene: Any, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    with opened(scene, kernel="stages", initial=start(scene, position, velocity)) as simulation:
        simulation.stages["damp clusters"](Moment())
        found: np.ndarray = simulation.read("velocity")
    return found


def test_what_is_not_rigid_decays_and_flight_and_spin_stay() -> None:
    """A block that flies at 10 m/s, spins and swells: the swelling falls by exp(-d h), all else stays. 30 roundings of
    20 m/s."""
    flight, spin = np.array([10.0, -3.0, 2.0]), np.array([1.0, -4.0, 2.0])
    rigid, swell = flight + np.cross(spin, CORNERS), CORNERS @ np.diag([1.0, 2.0, -1.0])
    scene = by_hand(block(damping=7.0), method=method(1, 1, H))
    found = slowed(scene, placed(CORNERS), placed(rigid + swell, flight))
    assert np.abs(found - placed(rigid + np.exp(-7.0 * H) * swell, flight)).max() < 30 * 20 * EPS


def test_two_halves_part_at_a_speed_that_decays() -> None:
    """Without stiffness: v = v0 exp(-d t) to rounding, at any h, and the way v0 (1 - exp(-d t)) / d to first order: a step's
    is h exp(-d t) at its beginning, too much by h / 2 of the way the speed has fallen."""
    apart = np.where(CORNERS[:, :1] > 0, 1.0, -1.0) * [1.0, 0.0, 0.0]
    state = run_of(block(0.0, damping=7.0), CORNERS, 10, apart)
    assert np.abs(state.velocity[:8] - np.exp(-0.7) * apart).max() < 10 * 4 / H * EPS
    way, fallen = (state.position[:8] - CORNERS)[:, 0] * apart[:, 0], 1 - np.exp(-0.7)
    assert way == pytest.approx(fallen / 7 + H / 2 * fallen, abs=7 * H**2 * fallen / 6)


def test_damping_keeps_momenta_of_clusters_that_overlap() -> None:
    """Of a bar, about any point; what it takes is energy. 24 particles, 1 m and 1 m/s."""
    scene = bodies_scene(bar=BAR | {"cluster_damping": 40.0, "linear": 0.5, "plastic_creep": 1.0})
    body_set, random = scene.body_set, np.random.default_rng(5)
    position = body_set.position + random.normal(0, 0.05, body_set.position.shape)
    before = random.normal(0, 1, position.shape)
    after, m = slowed(scene, position, before), body_set.clusters.mass[:, None]
    size = np.linalg.norm(m * before, axis=1).sum()
    assert np.linalg.norm((m * (after - before)).sum(axis=0)) < 16 * EPS * size
    assert np.linalg.norm(np.cross(position, m * (after - before)).sum(axis=0)) < 16 * EPS * size
    assert (m * after**2).sum() < 0.9 * (m * before**2).sum()
