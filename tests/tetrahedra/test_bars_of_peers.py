"""Bars that peers are held against: their exact answers, the laws of Newton's materials, and the comparison's table."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from softlab.app.driver import open_simulation
from softlab.bench.experiments.tetrahedral.cantilever import POISSON
from softlab.bench.peers.bars.fem import WarpFem
from softlab.bench.peers.bars.lab import LabTetrahedra
from softlab.bench.peers.bars.newton import NewtonTetrahedra, squares_stress, stable_substeps
from softlab.bench.peers.bars.tip import BARS, by_stress, exact_tip, quickest
from softlab.bench.peers.base import Peer
from softlab.bench.peers.registry import PEERS
from softlab.bench.peers.results import print_peers, ratios
from softlab.bench.peers.scenes import SCENES, peer_scenes, shape_of, word_of
from softlab.bench.peers.sweep import run_peers
from softlab.bench.reference.elastic_materials import cofactor, lame, linear_tangent, stress
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.core.build import build

WORD = "tetrahedra-1e7"


def _neo_hookean(gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    return stress("neo-hookean", gradient, mu, lam)


def _with_logarithm(gradient: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> np.ndarray:
    """Newton's semi-implicit Euler, as its kernel writes it, of the numbers that it is given."""
    mu, lam = 4 / 3 * mu[..., None, None], (lam + 5 / 6 * mu)[..., None, None]
    square = np.einsum("...ij,...ij->...", gradient, gradient)[..., None, None]
    swell = np.linalg.det(gradient)[..., None, None] - (1 + 3 / 4 * mu / lam)
    return mu * gradient * (1 - 1 / (square + 1)) + lam * swell * cofactor(gradient)


def _slope(law: Any, mu: float, lam: float) -> np.ndarray:
    """(9, 9) [Pa]: of the stress at rest, by central differences."""
    numbers = np.full(1, mu), np.full(1, lam)
    found = np.zeros((9, 9))
    for k, change in enumerate(1e-5 * np.eye(9).reshape(9, 1, 3, 3)):
        found[:, k] = (law(np.eye(3) + change, *numbers) - law(np.eye(3) - change, *numbers)).ravel() / 2e-5
    return found


def test_materials_of_newton_are_those_asked_for_but_one() -> None:
    """Given the numbers that they are given, VBD's and semi-implicit Euler's are Hooke's law at rest. XPBD's resists nothing
    but stretch of the trace: of nine eigenvalues one is not 0."""
    mu, lam = (float(value) for value in lame(1.0, POISSON))
    hooke = linear_tangent(np.float64(mu), np.float64(lam))
    for law in (_neo_hookean, _with_logarithm):
        np.testing.assert_allclose(_slope(law, mu, lam), hooke, atol=1e-6)
    assert np.count_nonzero(np.abs(np.linalg.eigvalsh(_slope(squares_stress, mu, lam))) > 1e-6) == 1


def test_the_judge_by_stress_comes_to_the_modes_and_xpbd_falls_freely() -> None:
    """A bar of XPBD's law is a mechanism: g t^2 / 2 after t, whatever mu."""
    scene = SCENES[WORD].make(1, 1)
    exact = exact_tip(scene)
    assert by_stress(1, 1e7, _neo_hookean, "its own").displacement == pytest.approx(exact.displacement, rel=3e-3)
    falling = scene.gravity.acceleration * (exact.frames / 60) ** 2 / 2  # type: ignore[union-attr]
    assert by_stress(1, 1e7, squares_stress, "its own").displacement == pytest.approx(falling, rel=1e-6)


def test_the_quickest_vibration_bounds_an_explicit_step() -> None:
    """Of a finer mesh as many times as much; so many substeps hold, and are even."""
    assert quickest(2, 1e5) == pytest.approx(2 * quickest(1, 1e5), rel=0.3)
    scene = SCENES[WORD].make(1, 1)
    substeps = stable_substeps(scene)
    assert substeps % 2 == 0 and 2 / quickest(1, 1e7) > scene.method.dt / substeps


def test_words_choose_bars() -> None:
    assert [scene.word for scene in peer_scenes(["tetrahedra"], False)] == ["tetrahedra", *BARS]
    for word in BARS:
        scene = SCENES[word].make(2, 2).as_dict()
        assert word_of(scene) == word and shape_of(scene) == (2, 2)
        assert {peer.backend for peer in PEERS if word in peer.scenes} == {"cpu", "gpu"}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The coarsest bar, the lab's Newton method beside its position-based one, with 128 substeps and with too few."""
    with Store(tmp_path_factory.mktemp("bars") / "results.sqlite") as store:
        summary = run_peers(
            store, scenes=[WORD], sizes=[1], backends=["cpu"], precisions=["float64"], repeats=1, min_seconds=1e-3,
            max_seconds=1e6, total_seconds=1e6,  # of a busy machine, too
            peers=[LabTetrahedra("cpu", "xpbd", 128, 1), LabTetrahedra("cpu", "xpbd", 4, 1)], progress=False,
        )  # fmt: skip
        yield store, summary


def test_error_stands_beside_time(kept: Any) -> None:
    store, summary = kept
    assert summary.measured == 3 and len(summary.wrong) == 1 and "4x1" in summary.wrong[0][0]
    found = {ratio.peer: ratio for ratio in ratios(store, summary.machine)}
    many, few = (found[f"softlab_tetrahedra_xpbd_{n}x1_cpu"] for n in (128, 4))
    assert few.wrong and not many.wrong and (many.difference or 1) < 0.05
    assert (many.our_difference or 1) < 0.01  # the lab's row: 24 substeps of Newton's method
    console = Console(width=120, record=True, file=io.StringIO())
    print_peers(console, store, summary.machine)
    text = console.export_text()
    assert "softlab newton, 24 x 1" in text and "off the tip's way" in text


def test_an_answer_that_takes_too_long_is_not_waited_for(tmp_path: Any) -> None:
    with Store(tmp_path / "results.sqlite") as store:
        summary = run_peers(
            store, scenes=[WORD], sizes=[1], backends=["cpu"], precisions=["float64"], repeats=1, min_seconds=1e-3,
            max_seconds=1e-4, peers=[LabTetrahedra("cpu", "xpbd", 4, 1)], progress=False,
        )  # fmt: skip
        assert summary.measured == 0 and any("its answer would take" in reason for _, reason in summary.skipped)
        assert not [m for m in measures(store) if m.name == "peer_difference"]


@pytest.mark.parametrize(
    "peer",
    [WarpFem("cpu"), NewtonTetrahedra("cpu", "SemiImplicit"), NewtonTetrahedra("cpu", "VBD", 4, 10)],
    ids=lambda peer: peer.name,
)
def test_peers_move_as_the_lab_does(peer: Peer) -> None:
    """Two frames of the softest bar, of 2.8 mm: warp.fem's substep is the lab's, to float32; others are near."""
    able, reason = peer.available()
    if not able:
        pytest.skip(reason)
    scene = SCENES["tetrahedra-1e5"].make(1, 1)
    assert peer.refusal(scene) is None
    with open_simulation(scene, "cpu", precision="float64", math="exact") as simulation:
        simulation.advance(2)
        moved = simulation.state().position - build(scene).position
    with peer.open(scene, "float32", 1) as opened:
        opened.advance(1)
        opened.advance(1)
        opened.synchronize()
        away = opened.read()[0] - build(scene).position
        opened.load(build(scene).position, np.zeros_like(moved))
        opened.advance(2)
        opened.synchronize()
        again = opened.read()[0] - build(scene).position
    largest = np.abs(moved).max()
    np.testing.assert_allclose(away, moved, atol=(0.005 if isinstance(peer, WarpFem) else 0.2) * largest)
    np.testing.assert_array_equal(again, away)


def test_what_they_do_not_know_they_refuse() -> None:
    scene = SCENES[WORD].make(1, 1)
    for peer in (WarpFem("cpu"), NewtonTetrahedra("cpu", "VBD", 4, 10), LabTetrahedra("cpu", "vbd", 4, 30)):
        assert peer.refusal(scene) is None
        assert "damping" in str(peer.refusal(scene.replace({"damping.coefficient": 1.0})))
        assert "material" in str(peer.refusal(scene.replace({"beam.material": "fixed-corotated"})))
        assert "bar" in str(peer.refusal(SCENES["tetrahedra"].make(1, 1)))
