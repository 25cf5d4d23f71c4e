"""Tetrahedra in C++ with OpenMP: the lab's answer, what it refuses, and that it is asked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.bench.peers.cpp_tetrahedra import CppTetrahedra
from softlab.bench.peers.registry import PEERS
from softlab.bench.peers.scenes import SCENES, shape_of, word_of
from softlab.bench.peers.sweep import run_peers
from softlab.bench.store.database import Store


@pytest.fixture
def peer() -> CppTetrahedra:
    peer = CppTetrahedra()
    able, reason = peer.available()
    if not able:
        pytest.skip(reason)
    return peer


@pytest.mark.parametrize("sweep", ["voxels", "tetrahedra"])
@pytest.mark.parametrize("precision,limit", [("float32", 2e-5), ("float64", 1e-12)])
def test_its_states_are_the_lab_s(peer: CppTetrahedra, precision: str, limit: float, sweep: str) -> None:
    """One order and the same rows: rounding apart, of positions of half a metre in five steps of 20 substeps."""
    scene = SCENES["tetrahedra"].make(2, 1).replace({"bar.sweep": sweep})
    start = moving(scene)
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1, initial=start) as simulation:
        simulation.advance(5)
        expected = simulation.state()
    for threads in (1, 2):
        with peer.open(scene, precision, threads) as opened:
            opened.load(start.position, start.velocity)
            opened.advance(2)
            opened.advance(3)
            position, velocity = opened.read()
        np.testing.assert_allclose(position, expected.position, atol=limit)
        np.testing.assert_allclose(velocity, expected.velocity, atol=2000 * limit)


@pytest.mark.parametrize(
    "name,why", [("fixed-corotated", "no fixed-corotated"), ("everything", "one set"), ("neo-hookean", "one iteration")]
)
def test_what_it_does_not_know_it_refuses(name: str, why: str) -> None:
    assert why in (CppTetrahedra().refusal(tetrahedra_scene(name, **ONCE if name == "fixed-corotated" else {})) or "")


ONCE: dict[str, Any] = {"method": {"solver": "xpbd", "dt": 0.01, "substeps": 3, "iterations": 1}}


def test_it_is_asked_and_checked(peer: CppTetrahedra, tmp_path: Any) -> None:
    assert any(isinstance(one, CppTetrahedra) for one in PEERS)
    scene = SCENES["tetrahedra"].make(3, 2)
    assert word_of(scene.as_dict()) == "tetrahedra" and shape_of(scene.as_dict()) == (3, 2)
    assert peer.refusal(scene) is None
    with Store(tmp_path / "results.sqlite") as store:
        summary = run_peers(
            store, scenes=["tetrahedra"], sizes=[1], backends=["cpu"], precisions=["float64"], repeats=1,
            min_seconds=1e-3, peers=[peer], progress=False,
        )  # fmt: skip
    assert summary.measured == 2 and summary.wrong == []
