"""Skins: weights, what a rigid motion does, and the vectorised reference against one vertex at a time."""

import numpy as np
import pytest
from closed_meshes import ball, box, rotation
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.model.assets.skin import INFLUENCES, influences, make_skin
from softlab.model.geometry.normals import mesh_normals

ANGLE = st.floats(-3, 3)
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE)


def random_centres(count, seed=0):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 300])
def test_weights(count):
    """Of the nearest clusters, nearest first, adding up to 1 to rounding; fewer than four leave entries of weight 0 that name
    a cluster there is. Any number of clusters: the source's limit was 200."""
    position, triangles = ball(halvings=3)
    centres = random_centres(count)
    skin = make_skin(position, triangles, centres)
    assert skin.clusters.shape == skin.weights.shape == (len(position), INFLUENCES)
    assert (skin.clusters.dtype, skin.weights.dtype) == (np.int32, np.float64)
    assert np.abs(skin.weights.sum(axis=1) - 1).max() < 8 * np.finfo(float).eps
    assert (skin.weights >= 0).all()
    assert (np.diff(skin.weights, axis=1) <= 0).all()
    assert ((skin.clusters >= 0) & (skin.clusters < count)).all()
    taken = min(count, INFLUENCES)
    every = np.linalg.norm(position[:, None] - centres, axis=2)
    assert np.array_equal(skin.clusters[:, :taken], np.argsort(every, axis=1, kind="stable")[:, :taken])
    assert (skin.weights[:, taken:] == 0).all()
    assert (skin.clusters[:, taken:] == skin.clusters[:, :1]).all()
    if count >= 3:
        assert len(np.unique(skin.clusters)) > 1


@settings(deadline=None, max_examples=40)
@given(VECTOR, VECTOR, st.integers(1, 9))
def test_a_rigid_motion_moves_the_skin_rigidly(vector, way, count):
    """All clusters turn about one axis: every vertex and normal with them, whatever the weights. Rounding: some twenty
    operations on numbers of the size of the body and its way."""
    position, triangles = ball()
    centres = random_centres(count, 1)
    skin = make_skin(position, triangles, centres)
    turn = rotation(vector)
    moved, normal = skin.skinned(centres @ turn.T + way, np.broadcast_to(turn, (count, 3, 3)))
    error = 64 * np.finfo(float).eps * (1 + np.linalg.norm(way))
    assert np.abs(moved - (position @ turn.T + way)).max() < error
    assert np.abs(normal - mesh_normals(position, triangles) @ turn.T).max() < 64 * np.finfo(float).eps


@settings(deadline=None, max_examples=20)
@given(st.integers(1, 12), st.integers(0, 10**6))
def test_against_one_vertex_at_a_time(count, seed):
    position, triangles = box()
    centres = random_centres(count, seed)
    skin = make_skin(position, triangles, centres)
    random = np.random.default_rng(seed + 1)
    turns = np.stack([rotation(vector) for vector in random.uniform(-2, 2, (count, 3))])
    now = centres + random.normal(0, 0.1, (count, 3))
    moved, normal = skin.skinned(now, turns)
    for v in range(len(position)):
        place, direction = np.zeros(3), np.zeros(3)
        for k in range(INFLUENCES):
            c = skin.clusters[v, k]
            place += skin.weights[v, k] * (now[c] + turns[c] @ (position[v] - centres[c]))
            direction += skin.weights[v, k] * (turns[c] @ skin.normal[v])
        assert np.allclose(moved[v], place, rtol=0, atol=1e-14)
        assert np.allclose(normal[v], direction / np.linalg.norm(direction), rtol=0, atol=1e-12)


def test_opposite_turns_leave_no_normal_rather_than_a_nan():
    position, triangles = box()
    centres = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]])
    skin = make_skin(position * [1, 1, 0] + [0, 0, 0.0], triangles, centres)  # flat: both are equally far
    turns = np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])])
    _, normal = skin.skinned(centres, turns)
    assert np.isfinite(normal).all()
    length = np.linalg.norm(normal, axis=1)
    assert (np.isclose(length, 1) | (length == 0)).all()


def test_weights_fade_where_clusters_take_turns():
    """Along a line past many clusters no weight jumps: the fifth nearest has none. Its change over a step is at most the
    slope of (1 - d^2/d5^2)^2, under 2 a distance d5 of any of the five, over the sum of weights."""
    centres = random_centres(40, 3)
    places = np.linspace([-0.4, -0.3, 0.2], [0.4, 0.35, -0.3], 20001)
    skin = make_skin(places, np.array([[0, 1, 2]]), centres)
    full = np.zeros((len(places), len(centres)))
    np.add.at(full, (np.arange(len(places))[:, None], skin.clusters), skin.weights)
    step = np.linalg.norm(places[1] - places[0])
    every = np.sort(np.linalg.norm(places[:, None] - centres, axis=2), axis=1)
    raw = ((1 - (every[:, :4] / every[:, 4:5]) ** 2) ** 2).sum(axis=1)
    slope = 2 * (2 * 2 / every[:, 4]) / raw * 4  # numerator and limit both move; four weights in the sum
    assert (np.abs(np.diff(full, axis=0)).max(axis=1) < 1.5 * slope[:-1] * step).all()


def test_five_at_one_distance_share_evenly():
    clusters, weights = influences(np.array([[4, 2, 0, 1, 3]]), np.full((1, 5), 0.5))
    assert clusters.tolist() == [[4, 2, 0, 1]]
    assert weights.tolist() == [[0.25] * 4]


def test_batches_do_not_matter(monkeypatch):
    position, triangles = ball(halvings=3)
    centres = random_centres(50)
    whole = make_skin(position, triangles, centres)
    monkeypatch.setattr("softlab.model.assets.skin.BATCH", 120)
    again = make_skin(position, triangles, centres)
    assert np.array_equal(whole.weights, again.weights)
    assert np.array_equal(whole.clusters, again.clusters)
