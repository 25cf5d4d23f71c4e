"""Bodies by shape matching: against the NumPy reference, among kernels and threads, and by the laws that they keep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies_scenes import (
    BAR,
    BRICK,
    STEPS,
    bodies_scene,
    by_hand,
    clusters_of,
    degenerate,
    end_state,
    everything,
    method,
    opened,
    same,
    start,
)
from closed_meshes import rotation as rotation_by

from softlab.app.output.files import read_state, write_state
from softlab.bench.reference import shape_matching as reference
from softlab.bench.stress.rotations import matrices_of
from softlab.model.assets.clusters import matching_factor
from softlab.model.base.errors import Diverged, InputError, SceneError
from softlab.model.shape_matching.cluster_tables import matching_factors

CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-0.5, 0.5) for z in (-0.3, 0.3)])
KERNELS = [("stages", 1), ("stages", 3), ("fused", 1), ("fused", 2), ("fused", 5)]  # two of them share bodies out


def test_fast_math_is_near_exact() -> None:
    fast, exact = (end_state(everything(), precision="float32", math=math, threads=2) for math in ("fast", "exact"))
    assert np.abs(fast.position - exact.position).max() < 1e-12 * 2.0**29  # as above


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_last_small_bodies_after_large_ones_have_a_thread(threads: int) -> None:
    """Whatever the sizes: each group belongs to one thread."""
    small, far = BAR | {"particle_spacing": 0.25}, {"apart": [2.0, 0.0, 0.0], "copies": [4, 1, 1]}
    scene = bodies_scene(large=BAR | {"particle_spacing": 0.07} | far, small=small | {"origin": [0.0, 3.0, 0.0]})
    with opened(scene, threads=threads) as simulation:
        bounds = simulation.layout.bands(threads)
        assert bounds[0] == 0 and bounds[-1] == len(simulation.layout.groups) and (np.diff(bounds) >= 0).all()
    position, _ = reference.simulate(scene, 2)
    assert np.abs(end_state(scene, steps=2, threads=threads).position - position).max() < 1e-12


def test_threads_share_what_can_be_shared() -> None:
    """Whole bodies, where they are alike; parts of them where four threads have three bodies."""
    with opened(everything(1, 1), threads=1) as alone, opened(everything(1, 1), threads=4) as many:
        assert alone._apart and not many._apart
        assert alone.layout.groups[:, 4].sum() == 1  # the two bricks, which are one cluster each, go together
    bricks = bodies_scene(brick=BRICK | {"copies": [5, 4, 2], "apart": [2.0, 1.0, 1.0]})
    with opened(bricks, threads=2) as two:
        assert two._apart and two.layout.evenness(2) == 1
        assert np.diff(two.layout.groups[:, 2:4]).max() <= 16


# ---------------------------------------------------------------------- laws


@pytest.mark.parametrize("iterations", [1, 3])
def test_momentum_is_kept(iterations: int) -> None:
    """Split masses: of 24 particles and their clusters, pushed about at random. From rest, so that angular momentum's arms
    are those before the first iteration; in later ones only linear momentum is kept. Ways of 0.1 m at places of 0.5 m: each
    is wrong by 2^-54 m, 1e-15 of it, and sums of 24 by a few."""
    scene = bodies_scene(bar=BAR, gravity=0.0, method=method(1, iterations))
    body_set, random = scene.body_set, np.random.default_rng(4)
    pushed = body_set.position + random.normal(0, 0.1, body_set.position.shape)
    state = end_state(scene, start=start(scene, pushed), steps=1)
    m = body_set.clusters.mass[:, None]
    assert np.linalg.norm((m * state.velocity).sum(axis=0)) < 1e-14 * np.linalg.norm(m * state.velocity, axis=1).sum()
    if iterations == 1:
        arms = np.cross(pushed - pushed.mean(axis=0), m * state.velocity)
        assert np.linalg.norm(arms.sum(axis=0)) < 1e-14 * np.linalg.norm(arms, axis=1).sum()


def test_a_rigid_body_loses_spin_by_its_law() -> None:
    """NUMERICS A8 and S7, 2 s: an angle D a substep becomes atan(sin D), the first being atan(omega h), as a body's velocity
    is a rigid motion (model/formulas/shape_matching/rigid.py); that of a way over h, atan2(sin D, 2 - cos D), lost twice as
    much. 200 turns of 1e-15 rad, each of which changes all later ones: 200^2 x 1e-15."""
    omega, h, steps = 2 * np.pi, 0.01, 200
    scene = by_hand(clusters_of(CORNERS, [np.arange(8)]))
    axis = np.array([0.0, 0.0, 1.0])
    state = end_state(scene, start=start(scene, velocity=omega * np.cross(axis, CORNERS)), steps=steps)
    angle, total = np.arctan(omega * h), 0.0
    for _ in range(steps):
        total, angle = total + angle, np.arctan(np.sin(angle))
    turn = np.arctan2(*(np.cross(CORNERS, state.position)[:, 2].sum(), (CORNERS * state.position)[:, :2].sum()))
    assert turn == pytest.approx((total + np.pi) % (2 * np.pi) - np.pi, abs=1e-10)
    assert total > 2 * np.pi  # more than a whole turn
    # the rotation kept is that of the last prediction, ahead of the particles: `read` tells of where they are
    with opened(scene, initial=state) as simulation:
        assert matrices_of(simulation.read("rotation"))[0] == pytest.approx(rotation_by([0, 0, turn]), abs=1e-10)


@pytest.mark.parametrize("iterations", [1, 2, 5])
def test_a_stretch_decays_as_a_step_of_implicit_euler_says(iterations: int) -> None:
    """One cluster: e' = (1 - a) (2 e - e_before), a = w^2 h^2 / (1 + w^2 h^2), so that its envelope falls by sqrt(1 - a) a
    step (NUMERICS A10), for any number of iterations."""
    scene = by_hand(clusters_of(CORNERS, [np.arange(8)], stiffness=3600.0), method=method(1, iterations))
    a = matching_factor(3600.0, 0.01, 1)
    before = now = 0.1
    for _ in range(STEPS):
        before, now = now, (1 - a) * (2 * now - before)
    state = end_state(scene, start=start(scene, CORNERS * [1.1, 1.0, 1.0]))
    assert state.position == pytest.approx(CORNERS * [1 + now, 1.0, 1.0], abs=1e-13)


# ---------------------------------------------------------------------- clusters that do not tell how they lie


@pytest.mark.parametrize("precision,exponent", [("float64", 0), ("float32", 29)])
@pytest.mark.parametrize("kernel", ["stages", "fused"])
def test_clusters_without_a_volume(kernel: str, precision: str, exponent: int) -> None:
    """NUMERICS B20: every rotation is one, and a shape that was only turned and shifted is its own goal. Offsets of 1 m and
    places of 2 m, 16 roundings."""
    clusters = degenerate()
    scene = by_hand(clusters)
    turned = clusters.position @ rotation_by([0.5, 2.0, -1.0]).T + [0.3, 0.2, 0.1]
    state = end_state(scene, start=start(scene, turned), steps=1, kernel=kernel, precision=precision)
    assert np.abs(state.position - turned).max() < 16 * 2 * 2.0 ** (exponent - 53)
    random = np.random.default_rng(2)
    state = end_state(
        scene, start=start(scene, turned + random.normal(0, 0.03, turned.shape)), kernel=kernel, precision=precision
    )
    assert np.isfinite(state.position).all() and state.rotation is not None
    assert np.abs(np.linalg.norm(state.rotation.astype(float), axis=1) - 1).max() < 4 * 2.0 ** (exponent - 53)
    assert np.linalg.det(matrices_of(state.rotation)) == pytest.approx(1, abs=1e-6)


def test_far_from_the_origin_float32_keeps_its_digits() -> None:
    """NUMERICS B14: 4096 m away, where places are 2^-12 m apart, the rotation is still that of the places as they are:
    offsets between them are exact, and 8 of them are summed up with 2^-24."""
    scene = by_hand(clusters_of(CORNERS, [np.arange(8)]))
    there = (CORNERS @ rotation_by([0.3, -0.2, 0.5]).T + 4096).astype(np.float32)
    with opened(scene, initial=start(scene, there), precision="float32") as simulation:
        found, centre = matrices_of(simulation.read("rotation"))[0], simulation.read("centre")
    assert found == pytest.approx(scene.body_set.clusters.rotations(there.astype(float))[0], abs=16 * 2.0**-24)
    assert centre[0] == pytest.approx(there.mean(axis=0, dtype=float), abs=2.0**-12)


# ---------------------------------------------------------------------- states, and what changes while running


def test_a_state_goes_on_bit_for_bit(tmp_path: Path) -> None:
    """Also through a file; without the rotations of before the next ones differ by rounding."""
    scene = everything()
    half, whole = end_state(scene, precision="float32"), end_state(scene, precision="float32", steps=2 * STEPS)
    kept = read_state(write_state(tmp_path / "half.npz", half), scene)
    assert same(end_state(scene, precision="float32", start=kept), whole)
    with opened(scene, precision="float32", initial=half) as simulation:
        simulation.advance(2)
        simulation.rewind()
        assert same(simulation.state(), half)
        before = simulation.state()
        rotation, centre = simulation.read("rotation"), simulation.read("centre")
        assert same(simulation.state(), before)  # reading changes nothing
    assert rotation.shape == (5, 4) and rotation.dtype == np.float32
    assert centre == pytest.approx(scene.body_set.clusters.centres(half.position), abs=4 * 2.0**-24)
    assert matrices_of(rotation) == pytest.approx(scene.body_set.clusters.rotations(half.position), abs=64 * 2.0**-24)


@pytest.mark.parametrize("angle", [0.5, 2.0, np.pi])
def test_a_state_without_rotations_starts_cold(angle: float) -> None:
    scene = bodies_scene(bar=BAR)
    turn = rotation_by(angle * np.array([2.0, -1.0, 2.0]) / 3)
    with opened(scene, initial=start(scene, scene.body_set.position @ turn.T)) as simulation:
        rotation = simulation.state().rotation
        assert rotation is not None and matrices_of(rotation) == pytest.approx(
            np.broadcast_to(turn, (3, 3, 3)), abs=1e-13
        )


@pytest.mark.parametrize(
    "rotation,word",
    [
        (np.eye(4)[:2], r"shape \(2, 4\), this scene needs \(1, 4\)"),
        (np.zeros((1, 4)), "cluster 0 has the length 0"),
        (np.array([[np.nan, 0, 0, 0]]), "length nan; it must be 1"),
        (np.ones((1, 4), int), "real numbers"),
    ],
)
def test_bad_rotations_are_refused(rotation: Any, word: str) -> None:
    scene = bodies_scene(brick=BRICK)
    with opened(scene) as simulation:
        before = simulation.state()
        with pytest.raises(InputError, match=word):
            simulation.load(start(scene, rotation=rotation))
        assert same(simulation.state(), before)


def test_dt_changes_how_far_particles_go() -> None:
    """As if the scene had been opened with it."""
    scene = bodies_scene(bar=BAR)
    other = scene.replace({"method.dt": 0.02})
    with opened(scene) as simulation, opened(other) as expected:
        simulation.set("method.dt", 0.02)
        simulation.advance(STEPS)
        expected.advance(STEPS)
        assert same(simulation.state(), expected.state())
    assert matching_factors(clusters_of(CORNERS, [np.arange(8)]), 1e-9, 3) == pytest.approx(1)


def test_what_diverges_is_named() -> None:
    scene = bodies_scene(brick=BRICK)
    velocity = np.zeros_like(scene.body_set.position)
    velocity[:, 0] = 1e9
    with opened(scene, initial=start(scene, velocity=velocity)) as simulation, pytest.raises(Diverged) as found:
        simulation.advance(STEPS)
        simulation.state()
    assert found.value.step == 1


def test_unknown_arrays_are_refused() -> None:
    with (
        opened(bodies_scene(brick=BRICK)) as simulation,
        pytest.raises(SceneError, match="position, velocity, rotation, centre"),
    ):
        simulation.read("strain")
