"""`softlab advise` and `softlab ablate` of fluids: what they try, what they answer, and what they say of each thing."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fluid_scenes import column_scene
from rich.console import Console

from softlab.bench.experiments.advise import budgets, fluids, fluids_ablation
from softlab.bench.experiments.advise.answer import measure_advice
from softlab.bench.experiments.advise.fluids import LADDER, _Search, advise_fluids
from softlab.bench.experiments.advise.fluids_ablation import (
    BREAKS,
    MOVES,
    NOT_NEEDED,
    PRESSES,
    RELIEVES,
    Left,
    ablate_fluids,
    left_out,
    print_fluid_ablation,
)
from softlab.bench.experiments.advise.fluids_advice import FluidAdvice, FluidBudget
from softlab.bench.experiments.fluid_truth.scenes import SCHEMES
from softlab.bench.measure.costs_timing import Effort
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene

HOW: dict[str, Any] = {"backends": ["cpu"], "progress": False}


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short samples."""
    for module in (budgets, fluids_ablation):
        monkeypatch.setattr(module, "QUICK", Effort(2, 1e-3, 0.01))


def afloat() -> Scene:
    """The column without its floor."""
    scene = column_scene()
    return Scene({name: table for name, table in scene.as_dict().items() if name not in ("title", "floor")})


def run_as(law: Any) -> Any:
    """In place of a run: a density error by `law(scheme, substeps, iterations)`, a time by the effort."""

    def run(self: _Search, budget: FluidBudget) -> FluidBudget:
        found = law(budget.scheme, budget.substeps, budget.iterations)
        return replace(budget, density=found, seconds=1e-3 * budget.substeps * budget.iterations)

    return run


def test_it_climbs_until_the_error_is_reached(monkeypatch: pytest.MonkeyPatch, brief: None) -> None:
    """By a law of 1 / effort the first rung under it is the answer; what is never reached is told with how near it came."""
    asked = []

    def law(scheme: str, substeps: int, iterations: int) -> float:
        asked.append((scheme, substeps, iterations))
        return 0.1 / (substeps * iterations) if scheme == "macklin" else 0.05

    monkeypatch.setattr(_Search, "run", run_as(law))
    monkeypatch.setattr(fluids, "_timed", lambda store, run, scene, able: iter(able))
    with Store(":memory:") as store:
        found = advise_fluids(store, column_scene(), 0.006, **HOW)
        held = [m.value for m in measures(store) if m.name == fluids.DENSITY]
    best = found.best
    assert best is not None and (best.scheme, best.effort) == ("macklin", "4 x 5") and len(held) == len(asked)
    assert [pair for scheme, *pair in asked if scheme == "macklin"] == [list(rung) for rung in LADDER[:5]]
    others = {name.partition(",")[0]: why for name, why in found.beaten}
    assert set(others) == set(SCHEMES) - {"macklin"} and "0.05" in others["averaged"]
    assert found.configured().method.iterations == 5 and "--set method.scheme=macklin" in str(found)


def test_efforts_that_do_not_come_to_rest_are_not_recommended(monkeypatch: pytest.MonkeyPatch) -> None:
    """One substep of 1/60 s moves a particle by .054 rest distances: `averaged` and `divergence-free` boil, macklin rests."""
    asked = []

    def law(scheme: str, substeps: int, iterations: int) -> float:
        asked.append((scheme, substeps))
        return 0.0

    monkeypatch.setattr(_Search, "run", run_as(law))
    monkeypatch.setattr(fluids, "_timed", lambda store, run, scene, able: iter(able))
    with Store(":memory:") as store:
        advise_fluids(store, afloat(), 0.01, **HOW)
        assert dict(asked) == {"macklin": 1, "averaged": 2, "divergence-free": 2}
        asked.clear()
        advise_fluids(store, column_scene(), 0.01, **HOW)
    assert dict(asked) == {"macklin": 1, "averaged": 4, "divergence-free": 2}, "a floor throws drops of averaged back"


def test_nothing_reaches_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Search, "run", run_as(lambda *_: np.inf))
    with Store(":memory:") as store:
        found = measure_advice(store, column_scene(), 0.01, how=HOW)
    assert isinstance(found, FluidAdvice) and found.best is None and "no answer" in str(found)
    assert all("diverges" in why for _, why in found.beaten)


@pytest.mark.parametrize(
    ("error", "time", "field"), [(1.0, None, "--error"), (0.0, None, "--error"), (0.01, 1e-9, "--time")]
)
def test_what_cannot_be_asked(error: float, time: float | None, field: str) -> None:
    with Store(":memory:") as store, pytest.raises(SceneError, match=field):
        advise_fluids(store, column_scene(), error, time=time, **HOW)


def test_an_answer_is_run(brief: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Really: what it promises is what a run of the configured scene has."""
    monkeypatch.setattr(fluids, "SCHEMES", ("macklin",))
    scene = column_scene()
    with Store(":memory:") as store:
        found = advise_fluids(store, scene, 0.1, time=12 * scene.method.dt, **HOW)
    best = found.best
    assert best is not None and 0 < best.density <= 0.1 and np.isfinite(best.seconds)
    again = _Search(scene, 0.1, found.time, np.inf).run(replace(best, density=np.inf))
    assert again.density == pytest.approx(best.density, rel=1e-3)  # fast math, other bits at most


def test_what_is_left_out_of_a_fluid() -> None:
    names = [one.name for one in left_out(column_scene())]
    assert "without water.viscosity" in names and "without gravity" in names and "without water.cohesion" not in names
    assert not any(name.startswith("dt") and float(name.split()[1]) < column_scene().method.dt for name in names)


def test_verdicts_need_more_than_a_twin_does() -> None:
    full, spacing = Left("full scene", "full", "cpu", 0.01, 0.0, 1.0), 0.05
    twin = replace(full, density=0.011, centre=0.2)

    def verdict(**changed: float) -> str:
        return replace(full, **changed).verdict(full, twin, spacing)

    assert verdict() == NOT_NEEDED and verdict(density=np.inf) == BREAKS
    assert (
        verdict(density=0.0129) == NOT_NEEDED and verdict(density=0.014) == PRESSES
    )  # three times what the twin differs by
    assert verdict(density=0.008) == NOT_NEEDED and verdict(density=0.002) == RELIEVES
    assert verdict(centre=0.5) == NOT_NEEDED and verdict(centre=0.7) == MOVES
    assert verdict(height=1.01) == NOT_NEEDED and verdict(height=1.02) == MOVES


def test_a_scene_is_ablated(brief: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its floor a column falls; without gravity nothing presses. What else is left out: below, not run."""
    tried = ("without floor", "without gravity")
    monkeypatch.setattr(
        fluids_ablation, "left_out", lambda scene: [one for one in left_out(scene) if one.name in tried]
    )
    scene: Scene = column_scene()
    with Store(":memory:") as store:
        summary = ablate_fluids(store, scene, time=15 * scene.method.dt, **HOW)
        held = {m.reason for m in measures(store) if m.name == fluids_ablation.DENSITY}
    ((full, twin, some),) = summary.tables
    found = {one.name: one for one in some}
    assert found["without floor"].verdict(full, twin, summary.spacing) == MOVES
    assert found["without gravity"].density < full.density
    assert {full.name, *found} == held and all(one.seconds for one in some)
    assert twin.centre < 0.01
    printed = io.StringIO()
    print_fluid_ablation(Console(file=printed, width=140), summary)
    assert "without floor" in printed.getvalue() and MOVES in printed.getvalue()
