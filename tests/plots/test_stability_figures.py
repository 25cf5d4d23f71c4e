"""Figures, table and claims of stability: every expected number follows from the law in tests/tools/synthetic_store.py."""

from __future__ import annotations

from dataclasses import replace

import pytest
from synthetic_store import CPU_RECORD, Maker, cpu_store, gpu_store

from softlab.bench.store.database import Store
from softlab.labbook.claims import stability as stability_claims
from softlab.model.core.integrators import INTEGRATORS
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures import stability


@pytest.fixture(scope="module")
def cpu() -> Results:
    return load(cpu_store())


@pytest.fixture(scope="module")
def gpu() -> Results:
    return load(gpu_store())


def without(results: Results, keep) -> Results:
    """The results with only those measures that `keep` lets through."""
    return Results(tuple(replace(s, measures=tuple(m for m in s.measures if keep(m))) for s in results.sources))


@pytest.mark.parametrize("draw", [stability.draw_stiffness, stability.draw_damping])
def test_a_panel_an_integrator(gpu: Results, draw) -> None:
    with settings():
        drawing = draw(gpu)
        drawing.figure.canvas.draw()
    panels = drawing.figure.axes
    assert [ax.get_title() for ax in panels] == list(INTEGRATORS)
    assert panels[0].get_ylabel() and all(ax.get_xlabel() for ax in panels)
    assert "CPU, float64" in drawing.caption
    (legend,) = drawing.figure.legends
    assert [text.get_text() for text in legend.get_texts()][:4] == list(stability.WORDS)


def test_line_and_diamonds_stand_where_the_law_puts_them(cpu: Results) -> None:
    """The line at the limit of any state, the edges at 0.999 of the net's own; explicit Euler has neither undamped."""
    with settings():
        panels = dict(zip(INTEGRATORS, stability.draw_damping(cpu).figure.axes, strict=True))
    line, diamonds = panels["lab"].get_lines()
    assert line.get_xdata() == pytest.approx([0.0316228, 0.03125], rel=1e-5)
    assert list(line.get_ydata()) == list(diamonds.get_ydata()) == [0, 1]
    assert [tick.get_text() for tick in panels["lab"].get_yticklabels()] == ["0", "0.03"]
    assert (diamonds.get_xdata() / line.get_xdata()) == pytest.approx([1.018, 1.018], abs=0.002)
    line, diamonds = panels["explicit-euler"].get_lines()
    assert list(line.get_ydata()) == list(diamonds.get_ydata()) == [1]


def test_outcomes_are_the_colours(cpu: Results) -> None:
    """Rows from below by stiffness, 1 and 10 N/m; columns by step size, 1, 10 and 100 ms: lab holds to 98 and 31 ms."""
    with settings():
        ax = stability.draw_stiffness(cpu).figure.axes[0]
    (mesh,) = ax.collections
    assert mesh.get_array().reshape(2, 3).tolist() == [[0, 0, 0], [0, 0, 3]]


def test_claims_of_a_machine_with_a_gpu(gpu: Results) -> None:
    claims = {name: claim(gpu) for name, claim in stability_claims.CLAIMS.items()}
    assert all(claim.supported for name, claim in claims.items() if name != "stability-precisions"), claims
    assert "lie within 0.10\N{NO-BREAK SPACE}% of the analytic limits" in claims["stability-edges"].sentence
    assert "on the CPU and the GPU, in float64" in claims["stability-edges"].sentence
    assert claims["stability-under"].numbers["diverged"] == 0
    assert claims["stability-over"].numbers["diverged"] > 0
    assert claims["stability-over"].numbers["farthest"] <= 1.2
    assert claims["stability-backends"].numbers == {"differing": 0, "shared": 54}
    assert "only" in claims["stability-precisions"].sentence
    assert claims["stability-trap"].numbers["ratio"] == pytest.approx(20.35, abs=0.1)  # 31.2 ms over 1.53 ms
    assert claims["stability-first-loss"].numbers == {"median": 90, "last": 90}


def test_claims_follow_the_data(cpu: Results) -> None:
    """An edge that is off is said to be, a run that diverged under its limit, too."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "m")
    scene = stability_claims.chapter_runs(cpu)
    assert scene[0] and scene[1]
    maker.stability()
    for measure in load(store).sources[0].measures:
        (table,) = [t for t in measure.description["scene"].values() if "integrator" in t]
        if table["integrator"] == "rk4":
            if measure.name == "stability_edge":
                store.add_measure(
                    maker.run, measure.description, "sources", measure.name, 1.5 * measure.value, "s", "off"
                )
            elif measure.name == "stability_outcome":
                store.add_measure(maker.run, measure.description, "sources", measure.name, 3.0, "", "lost")
    found = load(store)
    off = stability_claims.edges(found)
    assert not off.supported and "rk4 lies 50" in off.sentence
    lost = stability_claims.under(found)
    assert lost.numbers["diverged"] > 0 and "with rk4" in lost.sentence


def test_nothing_measured_is_said(cpu: Results) -> None:
    for empty in (load(None), without(cpu, lambda m: not m.name.startswith("stability"))):
        assert isinstance(stability.draw_stiffness(empty), str)
        assert not any(claim(empty).supported for claim in stability_claims.CLAIMS.values())
    edges_alone = without(cpu, lambda m: m.name in ("stability_edge", "stability_limit"))
    assert stability.draw_damping(edges_alone) == "the stability runs hold no map"
    assert not stability_claims.under(edges_alone).supported and stability_claims.edges(edges_alone).supported
