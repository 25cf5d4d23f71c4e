"""Peers beyond the grid: Warp and Newton on cloth and on rigid bodies, held against the lab's references."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.checks import displaced
from softlab.bench.peers.base import Peer
from softlab.bench.peers.lab_xpbd import LabXpbd
from softlab.bench.peers.newton_rigid import NewtonRigid, _quaternions, _rotations
from softlab.bench.peers.newton_sheet import NewtonSemiImplicit, NewtonVbd, NewtonXpbd, _lattice_colours
from softlab.bench.peers.scenes import SCENES, peer_scenes, shape_of, word_of
from softlab.bench.peers.warp_cloth import WarpCloth
from softlab.bench.peers.warp_xpbd import WarpXpbd
from softlab.bench.reference import xpbd
from softlab.bench.reference.mass_spring import simulate
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene

STEPS = 60
LIMITS = {"float32": 1e-4, "float64": 1e-11}  # m, of sheets a metre wide


def here(peer: Peer) -> Peer:
    """The peer, or the test is skipped with its reason."""
    able, reason = peer.available()
    if not able:
        pytest.skip(reason)
    return peer


def sized(word: str, rows: int, columns: int, **changes: Any) -> Scene:
    scene = SCENES[word].make(rows, columns)
    return scene.replace(changes) if changes else scene


def ran(peer: Peer, scene: Scene, precision: str, steps: int, start: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """The state after `steps`, in two parts of which the first is odd; from its start again it must be the same."""
    with peer.open(scene, precision, 1) as opened:
        if start is not None:
            opened.load(*start)
        opened.advance(steps // 2 + 1 - steps // 2 % 2)
        opened.advance(steps - steps // 2 - 1 + steps // 2 % 2)
        opened.synchronize()
        position, velocity = opened.read()
        assert position.dtype == velocity.dtype == np.dtype(precision)
        return position, velocity


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("shape", [(1, 9), (7, 6), (13, 11)])
def test_warp_s_cloth_is_the_reference_s(shape: tuple[int, int], precision: str) -> None:
    scene = sized("cloth", *shape, **{"cloth.pinned": [[0, 0]], "cloth.placement": "hanging"})
    position, velocity = ran(here(WarpCloth("cpu")), scene, precision, STEPS)
    expected, expected_velocity = simulate(scene, STEPS)
    assert np.abs(position - expected).max() < LIMITS[precision]
    assert np.abs(velocity - expected_velocity).max() < 100 * LIMITS[precision]


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_warp_s_xpbd_projects_in_the_lab_s_order(ordering: str, precision: str) -> None:
    changes = {"method.ordering": ordering, "shear.damping": 0.01, "damping.coefficient": 0.0001}
    scene = sized("xpbd", 9, 8, **changes)
    position, velocity = ran(here(WarpXpbd("cpu")), scene, precision, 20)
    how = {"substeps": 2, "iterations": 10, "ordering": ordering}
    expected, expected_velocity = xpbd.simulate(scene, 20, **how)
    assert np.abs(position - expected).max() < LIMITS[precision]
    assert np.abs(velocity - expected_velocity).max() < 100 * LIMITS[precision]


@pytest.mark.parametrize("word", ["grid", "cloth"])
def test_newton_s_semi_implicit_euler_takes_the_lab_s_step(word: str) -> None:
    """The hand-out's too, with doubled masses and half of gravity, drag included."""
    scene = sized(word, 13, 11)
    position, velocity = ran(here(NewtonSemiImplicit("cpu")), scene, "float32", STEPS)
    expected, expected_velocity = simulate(scene, STEPS)
    assert np.abs(position - expected).max() < LIMITS["float32"]
    assert np.abs(velocity - expected_velocity).max() < 100 * LIMITS["float32"]


@pytest.mark.parametrize(
    "word,peer,off",
    [
        ("implicit-16", NewtonXpbd("cpu", 10), 1e-3),
        ("implicit-16", NewtonVbd("cpu", 10), 1e-3),
        ("implicit-4", NewtonVbd("cpu", 10), 1e-3),
        ("implicit-16", LabXpbd("cpu", 10), 1e-3),
    ],
    ids=lambda part: getattr(part, "name", str(part)),
)
def test_iterations_approach_implicit_euler(word: str, peer: Peer, off: float) -> None:
    """In spacings, by the root mean square, after 60 steps from a start in which every spring pulls."""
    here(peer)
    scene = sized(word, 11, 9)
    with open_simulation(scene, "cpu", precision="float64", math="exact") as judge:
        state = displaced(judge)
        judge.load(state)
        judge.advance(STEPS)
        expected = judge.state().position
    position, _ = ran(peer, scene, "float32", STEPS, (state.position, state.velocity))
    error = np.sqrt(np.mean(np.sum((position - expected) ** 2, axis=1))) / scene.grid.spacing
    assert error < off
    assert np.abs(expected - state.position).max() > 10 * off * scene.grid.spacing  # it did move


def test_newton_s_xpbd_sums_unweighted_corrections_and_fails_at_long_steps() -> None:
    """So that its mark in the tables is a finding and no mistake of ours."""
    peer = here(NewtonXpbd("cpu", 10))
    position, _ = ran(peer, sized("implicit-1", 11, 9, **{"cloth.placement": "hanging"}), "float32", 100)
    assert not np.isfinite(position).all() or np.abs(position).max() > 10


def test_the_colours_given_to_newton_share_no_spring() -> None:
    springs = xpbd.of_scene(sized("cloth", 8, 7))
    colour = np.empty(56, int)
    for number, members in enumerate(_lattice_colours(8, 7)):
        colour[members] = number
    assert (colour[springs.first] != colour[springs.second]).all()


def test_rigid_motions_come_back_from_their_particles() -> None:
    random = np.random.default_rng(1)
    quaternion = random.normal(size=(50, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    back = _quaternions(_rotations(quaternion))
    assert np.abs(np.abs(np.sum(back * quaternion, axis=1)) - 1).max() < 1e-12


def test_newton_s_tower_is_loaded_stepped_and_read() -> None:
    """What was loaded is read again; falling freely, a beam is where every body would be; then the tower stands."""
    peer = here(NewtonRigid("cpu", "XPBD", 10))
    scene = SCENES["rigid"].make(1, 1)
    start = scene.body_set.position
    with peer.open(scene, "float32", 1) as opened:
        moved = start + np.array([0.0, 5.0, 0.0])
        speed = np.broadcast_to([0.5, 0.0, -0.25], moved.shape)
        opened.load(moved, speed)
        position, velocity = opened.read()
        assert np.abs(position - moved).max() < 1e-5 and np.abs(velocity - speed).max() < 1e-5
        opened.advance(6)
        position, velocity = opened.read()
        drop = 9.81 * (0.1**2 / 2 + 0.1 / 960)  # semi-implicit Euler in steps of 1/480 s
        assert np.abs(position - moved - 0.1 * speed + [0, drop, 0]).max() < 1e-4
        assert np.abs(velocity - speed + [0, 0.981, 0]).max() < 1e-3
        opened.load(start, np.zeros_like(start))
        opened.advance(SCENES["rigid"].check_steps)
        middle = opened.read()[0].reshape(10, -1, 3).mean(axis=1)
    assert np.abs(middle[:, 1] - (0.125 + 0.25 * np.arange(10))).max() < 0.01


def test_scenes_are_told_apart_as_the_store_describes_them() -> None:
    for word, scene in SCENES.items():
        (made,) = scene.sized(False, [3])
        assert word_of(made.as_dict()) == word
        assert shape_of(made.as_dict()) == ((9, 10) if word == "rigid" else (3, 3))
    assert [scene.word for scene in peer_scenes(None, True)] == ["grid"]
    with pytest.raises(SceneError, match="one of grid, cloth"):
        peer_scenes(["clothes"], False)


def test_what_a_peer_does_not_know_is_refused() -> None:
    flag = load_scene("cloth-flag")
    for peer in (WarpCloth("cpu"), WarpXpbd("cpu"), NewtonSemiImplicit("cpu"), NewtonVbd("cpu", 10), LabXpbd("cpu", 2)):
        assert peer.refusal(flag)
    assert "dampers" in str(NewtonVbd("cpu", 10).refusal(sized("implicit-4", 4, 4, **{"shear.damping": 0.1})))
    assert "rigid" in str(NewtonRigid("cpu", "XPBD").refusal(flag))
    assert "soft_body" in str(NewtonRigid("cpu", "XPBD").refusal(load_scene("jelly-drop")))
    assert "minutes" in str(NewtonSemiImplicit("cpu").refusal(sized("cloth", 1024, 1024)))
    assert NewtonSemiImplicit("cpu").refusal(sized("grid", 1024, 1024)) is None
