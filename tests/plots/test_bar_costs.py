"""What the answers of the bar cost: really timed, read back beside the answers, drawn and told."""

from __future__ import annotations

import io
from typing import Any

import pytest
from read_figures import LABELS, labels
from rich.console import Console
from synthetic_store import GPU_RECORD, Maker

from softlab.bench.experiments import bar_costs
from softlab.bench.experiments.bar import FINEST, SOLVERS, SOME_LINKS, STRIP, SUBSTEPS, TETRAHEDRA
from softlab.bench.experiments.bar_costs import COST, BarCosts, costs, groups, settings
from softlab.bench.experiments.bar_rows import JELLY
from softlab.bench.experiments.bar_strip import (
    FRAME,
    FREQUENCY,
    OPTIONS,
    SAG,
    frame_steps,
    method_of,
    rod_frequency,
    rod_sag,
    strip,
)
from softlab.bench.measure.costs_timing import RATIO, SECONDS
from softlab.bench.measure.experiment import described
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.bar_costs import CLAIMS
from softlab.plots.core.read import load
from softlab.plots.core.style import settings as drawing_settings
from softlab.plots.figures.bar_costs import draw


def test_every_method_is_timed_at_every_number_of_substeps() -> None:
    every = [(name, substeps) for name, substeps, _ in settings()]
    assert len(set(every)) == len(every) == len(SUBSTEPS) * (len(SOLVERS) + 1 + len(TETRAHEDRA))
    assert {name for name, _ in every} == {*SOLVERS, JELLY, *TETRAHEDRA}
    with Store(":memory:") as store:
        (group,) = groups(store, ["cpu"], True)
    assert len(group.descriptions) < len(every)
    for _, substeps, scene in settings(True):
        assert frame_steps(scene) * scene.method.dt == pytest.approx(FRAME) and substeps in SUBSTEPS


def test_they_are_really_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two methods, and one that is refused: it has a reason in place of a time."""
    ways = [
        (name, substeps, strip(SOME_LINKS, method_of(SOLVERS[name][0], substeps)))
        for name, substeps in (("xpbd", 2), ("mass-spring", 16), ("mass-spring", 1))
    ]
    monkeypatch.setattr(bar_costs, "settings", lambda quick=False: iter(ways))
    monkeypatch.setattr("softlab.bench.measure.costs_timing.QUICK", bar_costs.Effort(2, 1e-3, 0.01))
    with Store(":memory:") as store:
        for held in (0, 1):
            summary = BarCosts()(store, quick=True, backends=["cpu"], progress=False)
            assert (summary.measured, summary.stored) == (1 - held, held)
        held_measures = measures(store)
        found = costs(held_measures)
        assert [(one.solver, one.substeps) for one in found] == [("mass-spring", 16), ("xpbd", 2)]
        assert all(one.frame > 0 and one.sag is None and not one.close for one in found)
        (refused,) = (m for m in held_measures if m.name == SECONDS and m.value is None)
        assert refused.description["substeps"] == 1 and "limit" in (refused.reason or "")
        console = Console(width=120, record=True, file=io.StringIO())
        BarCosts().show(console, store, summary.machine)
    assert "frame / ms" in console.export_text()


def _made_up() -> Any:
    """Of n substeps n ms on either backend; positions are off by 1 / n, springs that are stepped by a hundredth."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "c")
    for backend in ("cpu", "gpu"):
        for name in ("mass-spring", "xpbd"):
            for substeps in SUBSTEPS:
                scene = strip(SOME_LINKS, method_of(SOLVERS[name][0], substeps))
                told = described(scene, backend, COST, solver=name, substeps=substeps, **OPTIONS)
                for measure, value in ((SECONDS, 1e-3 * substeps / frame_steps(scene)), (RATIO, 1.0)):
                    store.add_measure(maker.run, told, "s", measure, value, "s", "of 9 pairs")
                off = 0.01 if name == "mass-spring" else 1 / substeps
                for load_, exact in ((SAG, rod_sag()), (FREQUENCY, rod_frequency())):
                    how = {"load": load_, "solver": name, "links": SOME_LINKS, "substeps": substeps, "region": 1}
                    answer = described(scene, backend, STRIP, **OPTIONS, **how)
                    store.add_measure(maker.run, answer, "s", load_, exact * (1 + off), "", None)
    return load(store)


def test_time_stands_beside_error() -> None:
    results = _made_up()
    (source,) = [source for source in results.everyone if costs(source.measures)]
    found = {(one.backend, one.solver, one.substeps): one for one in costs(source.measures)}
    assert found["cpu", "xpbd", 4].frame == pytest.approx(4e-3) and found[
        "cpu", "mass-spring", 4
    ].frame == pytest.approx(4e-3)
    assert found["gpu", "xpbd", 4].sag == pytest.approx(0.25) and not found["gpu", "xpbd", 4].close
    assert found["cpu", "xpbd", FINEST].close and found["cpu", "mass-spring", 1].close
    claim = CLAIMS["bar-costs"](results)
    assert claim.supported and claim.numbers["gpu xpbd"] == pytest.approx(16e-3)
    assert claim.numbers["cpu mass-spring"] == pytest.approx(1e-3)
    with drawing_settings():
        drawing = draw(results)
    assert not isinstance(drawing, str) and drawing.sources
    assert labels(drawing.figure) == LABELS["bar-costs"]


def test_nothing_is_told_of_nothing() -> None:
    assert isinstance(draw(load(None)), str) and not CLAIMS["bar-costs"](load(None)).supported
