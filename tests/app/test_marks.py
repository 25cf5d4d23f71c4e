"""A mark on a sample reaches the store, wherever samples are taken: with what was wrong with the answer, and with the word
that no GPU was there. Nothing is stepped: samples are made up, what takes them is the lab's own."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from softlab.bench.experiments import group as measure_group
from softlab.bench.experiments.accuracy import experiment as accuracy
from softlab.bench.experiments.advise import ablate
from softlab.bench.experiments.advise import search as advise_search
from softlab.bench.measure import case_timing, costs_timing, samples, timing
from softlab.bench.measure.timing import Sample
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, timings
from softlab.model.scene.scene import load_scene

SCENE = load_scene("lab-grid")
NOTHING: Callable[..., None] = lambda *_, **__: None  # noqa: E731


def described(backend: str) -> dict[str, Any]:
    return configuration(SCENE, backend=backend, threads=2 if backend == "cpu" else None)


def case_of(backend: str) -> Any:
    simulation = SimpleNamespace(kernel="fused", limit=1.0, scene=SCENE)
    return SimpleNamespace(
        description=described(backend), sources="s", backend=backend, scene=SCENE, particles=4, kind=("made up",),
        simulation_kind=backend, open=lambda: nullcontext(simulation),
    )  # fmt: skip


def subject_of(name: Any) -> Any:
    return SimpleNamespace(name=name, restore_seconds=0.0, simulation=SimpleNamespace(kernel="fused"))


def by_group(store: Store, run: str, backend: str) -> None:
    """bench/experiments/group.py, of comparisons with peers too, with the mark of a wrong answer beside the sample's own."""
    effort = SimpleNamespace(repeats_of=lambda case: 1, again=0)
    summary = SimpleNamespace(run=run, machine="m", samples=0, suspect=0, measured=0)
    runner = measure_group.GroupRunner(store, effort, summary, [backend], {}, NOTHING)  # type: ignore[arg-type]
    runner._sample([subject_of(case_of(backend))], {backend: "wrong answer: 3 spacings off"})  # type: ignore[dict-item]
    assert (summary.samples, summary.suspect, summary.measured) == (1, 1, 1)


def by_accuracy(store: Store, run: str, backend: str) -> None:
    summary = SimpleNamespace(run=run, measured=0)
    group = accuracy._Group(store, summary, 1, 0.1, NOTHING)  # type: ignore[arg-type]
    group._sample([subject_of(case_of(backend))])


def by_advice(store: Store, run: str, backend: str) -> None:
    search = advise_search.Search(store, SimpleNamespace(run=run, machine="m"))  # type: ignore[arg-type]
    search._sample([case_of(backend)])


def by_ablation(store: Store, run: str, backend: str) -> None:
    work = object.__new__(ablate._Work)
    work.store, work.summary = store, SimpleNamespace(run=run)
    added: list[Any] = []
    work._add = lambda variant, numbers: added.append(numbers)
    variant = SimpleNamespace(case=case_of(backend), ablation=SimpleNamespace(name="all"))
    work._time([subject_of(variant)], NOTHING)
    assert added[0][ablate.SUSPECT][0] == 1 and "load" in added[0][ablate.SUSPECT][2]


class OfCases(case_timing.Rates):
    name = "cases"
    stage = "step"


def by_cases(store: Store, run: str, backend: str) -> None:
    rates = OfCases()
    summary = SimpleNamespace(run=run, measured=0, skipped=[])
    rates._time(store, summary, [case_of(backend)], 1)  # type: ignore[arg-type]


def by_findings(store: Store, run: str, backend: str) -> None:
    case_timing.StepTimes("exact", [case_of(backend)], True).run(store, run, NOTHING)


def by_costs(store: Store, run: str, backend: str) -> None:
    record = costs_timing.Record(store, run, "s")
    (told,) = costs_timing.in_turn(record, [subject_of(described(backend))], 1)
    assert "load" in (told[costs_timing.RATIO][2] or "")


WAYS = {
    by_group: measure_group, by_accuracy: accuracy, by_advice: advise_search, by_ablation: ablate,
    by_cases: case_timing, by_findings: case_timing, by_costs: costs_timing,
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS, ids=[way.__name__ for way in WAYS])
@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_marks_reach_the_store(way: Any, backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = WAYS[way]

    def taken(subjects: Any, repeats: Any, _: Any = None, again: int = 0) -> Any:
        for _ in range(max(repeats)):
            for subject in subjects:
                yield subject, Sample(1.0, 10, "load: other programs ran on the cores in use")

    for sampling in (module, samples):
        monkeypatch.setattr(sampling, "interleaved", taken, raising=False)
    monkeypatch.setattr(samples, "gpu_simulated", lambda: True)
    for preparing in (module, timing):
        monkeypatch.setattr(preparing, "warm_up", NOTHING, raising=False)
        monkeypatch.setattr(preparing, "choose_steps", NOTHING, raising=False)
    with Store(":memory:") as store:
        store.add_machine("m", "Some CPU", {"cpu": "Some CPU", "cores": 2})
        way(store, store.start_run("m", "test"), backend)
        found = timings(store, stage=None)
        assert found
        for one in found:
            reasons = [reason for mark in one.suspect for reason in mark.split("; ")]
            assert "load: other programs ran on the cores in use" in reasons
            assert ("CUDA simulator, no GPU" in reasons) == (backend == "gpu")
            assert ("wrong answer: 3 spacings off" in reasons) == (module is measure_group)
