"""Claims on accuracy against numbers worked out by hand."""

from __future__ import annotations

from typing import Any

import pytest
from synthetic_store import (
    CPU_RECORD,
    GPU_RECORD,
    Maker,
)  # fmt: skip

from softlab.bench.experiments.findings import experiment as findings
from softlab.bench.store.database import Store
from softlab.labbook.claims import accuracy as accuracy_claims
from softlab.labbook.claims import findings as findings_claims
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import Point
from softlab.plots.core.read import load


def accurate(**errors: tuple[float, float, str, str]) -> Any:
    """Runs of S1, name -> (error, cost, precision, backend), each of rk4 at 10 ms."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    for error, cost, precision, backend in errors.values():
        maker.point("lab-curtain", "rk4", 0.01, error, cost, None, precision, backend)
    return load(store)


@pytest.mark.parametrize(
    ("costs", "words"),
    [
        ((1e-2, 1e-3), "the GPU is 10\N{NO-BREAK SPACE}times as fast as the CPU"),
        ((1e-3, 1e-2), "the CPU is 10\N{NO-BREAK SPACE}times as fast as the GPU"),
        ((1e-3, 1e-3), "differ by no more than measurement noise"),
    ],
)
def test_which_backend_is_faster_at_equal_error(costs: tuple[float, float], words: str) -> None:
    results = accurate(one=(1e-5, costs[0], "float64", "cpu"), other=(1e-5, costs[1], "float64", "gpu"))
    assert words in accuracy_claims.equal_error(results).sentence


def on_a_stiff_scene(monkeypatch: pytest.MonkeyPatch, *runs: tuple[str, str, float, float, int | None]) -> Any:
    """Runs (method, backend, error, cost, iterations) of any scene."""
    found = [
        Point("S4", method, 0.01, "float32", backend, error, None, cost, cost, cost, True, iterations=iterations)
        for method, backend, error, cost, iterations in runs
    ]
    monkeypatch.setattr(accuracy_claims, "points", lambda source, scene: found)
    return accurate(one=(1e-5, 1e-3, "float64", "cpu"))


def test_families_are_told_by_how_long_each_takes_to_the_error(monkeypatch: pytest.MonkeyPatch) -> None:
    results = on_a_stiff_scene(
        monkeypatch, ("rk4", "gpu", 0.05, 2.0, None), ("semi-implicit-euler", "gpu", 0.2, 1.0, None),
        ("xpbd gauss-seidel", "cpu", 0.05, 30.0, 4), ("implicit-euler", "cpu", 0.3, 5.0, None),
    )  # fmt: skip
    made = accuracy_claims.families(results)
    assert made.numbers == {"explicit": 1, "position-based": 15}
    assert "reached fastest by rk4" in made.sentence and "implicit methods do not reach it" in made.sentence
    assert "position-based methods take 15\N{NO-BREAK SPACE}times as long" in made.sentence


def test_a_cloth_in_a_game_takes_the_fastest_method_within_a_tenth(monkeypatch: pytest.MonkeyPatch) -> None:
    """6 s of wall time per simulated second are 0.1 s for a frame of 1/60 s; the faster run is too far off."""
    runs = [("rk4", "gpu", 0.05, 6.0, None), ("lab", "cpu", 0.5, 1.0, None), ("implicit-euler", "cpu", 0.05, 9.0, None)]
    made = accuracy_claims.game_cloth(on_a_stiff_scene(monkeypatch, *runs))
    assert made.supported and made.numbers == {"frame": pytest.approx(0.1), "error": 0.05}
    assert "rk4" in made.sentence and "on the Made-up GPU" in made.sentence


def test_a_rope_is_told_by_the_processor_that_is_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [("xpbd gauss-seidel", "gpu", 0.05, 6.0, 4), ("xpbd gauss-seidel", "cpu", 0.05, 2.0, 4)]
    made = accuracy_claims.rope(on_a_stiff_scene(monkeypatch, *runs))
    assert "the CPU is 3.0\N{NO-BREAK SPACE}times as fast as the GPU" in made.sentence
    assert "65" in made.sentence and made.numbers == {"ratio": pytest.approx(1 / 3)}


@pytest.mark.parametrize(("ratio", "stops"), [(1.9, False), (2.1, True), (15.0, True)])
def test_where_float32_stops_to_gain(ratio: float, stops: bool) -> None:
    """Twice the error of float64 is its floor."""
    made = accuracy_claims.float32_floor(
        accurate(one=(1e-6 * ratio, 1e-3, "float32", "cpu"), other=(1e-6, 1e-3, "float64", "cpu"))
    )
    assert made.supported == stops and ("rounding dominates" in made.sentence) == stops
    assert made.numbers == {"float32": pytest.approx(1e-6 * ratio), "float64": 1e-6}


@pytest.mark.parametrize(("ratio", "rises"), [(1.9, False), (2.1, True), (15.0, True)])
def test_where_smaller_steps_make_it_worse(ratio: float, rises: bool) -> None:
    store = Store(":memory:")
    maker, scene = Maker(store, CPU_RECORD, "c"), load_scene("lab-curtain")
    for dt, value in ((0.01, 3e-5), (0.005, 1e-6), (0.001, 1e-6 * ratio)):
        maker.finding(scene, findings.FLOOR, dt, findings.ERROR, value, integrator="rk4", precision="float32")
    made = findings_claims.floor(load(store))
    assert made.supported == rises and ("make it worse" in made.sentence) == rises
    assert made.numbers == {"rk4": 1e-6} and "at 5.0\N{NO-BREAK SPACE}ms" in made.sentence
