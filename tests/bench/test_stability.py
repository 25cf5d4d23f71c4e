"""Where integrators break, as run: the measured edge against the analytic one, the three outcomes, and what is stored."""

from __future__ import annotations

from functools import partial
from math import inf, pi, sin, sqrt

import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.stability import experiment as stability
from softlab.bench.experiments.stability import runs as stability_runs
from softlab.bench.experiments.stability.experiment import Extent, analytic, cases, chain, run_stability
from softlab.bench.experiments.stability.points import EDGE, OUTCOME, disagreements, place_of
from softlab.bench.experiments.stability.runs import (
    DIVERGED,
    GROWS,
    LIVE,
    MOVING,
    SETTLES,
    linear,
    measured_edge,
    outcome,
)
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.stability.limit import scene_frequency
from softlab.model.scene.scene import load_scene

N = 10
CHAIN = sqrt(1000 * 4) * sin((2 * N - 1) * pi / (2 * (2 * N + 1)))  # 1/s: the closed form of docs/method/cases.md A1
LIMITED = [(name, gamma) for name in INTEGRATORS for gamma in (0.0, 3.0) if INTEGRATORS[name].limit(CHAIN, gamma) > 0]


def test_the_chain_is_the_one_of_the_closed_form():
    assert scene_frequency(chain(0.03)).estimate == pytest.approx(CHAIN, rel=1e-12)
    assert {name for name, gamma in LIMITED if gamma == 0} == set(INTEGRATORS) - {"explicit-euler", "taylor"}


@pytest.mark.parametrize(("name", "gamma"), LIMITED)
def test_the_measured_edge_is_the_analytic_one(opened, name, gamma, precision):
    """Every explicit scheme with a limit, within 1 % as asked; found to a quarter of that, since bisection ends at 0.1 %."""
    scene = chain(0.01 * gamma).replace({"method.integrator": name})
    with opened(scene, live=LIVE, precision=precision) as simulation:
        edge = measured_edge(simulation)
    limit = INTEGRATORS[name].limit(CHAIN, gamma)
    assert edge == pytest.approx(limit, rel=0.01)
    assert edge == pytest.approx(limit, rel=0.0025)


@pytest.mark.parametrize("name", ["explicit-euler", "taylor"])
def test_without_a_damper_there_is_no_edge_to_measure(name):
    """They grow at every step size, so that no edge is looked for; the other four integrators have all of theirs."""
    assert analytic(chain(0.0).replace({"method.integrator": name})) == 0
    edges = [c for c in cases(stability.FULL, ["cpu"]) if c.edge and c.scene.method.integrator == name]
    assert edges and all(c.scene.damping.coefficient > 0 for c in edges)


@pytest.mark.parametrize(
    ("dt", "damping", "code"), [(0.01, 0.03, SETTLES), (0.01, 0.0, MOVING), (0.06, 0.03, DIVERGED)]
)
def test_the_three_outcomes(opened, dt, damping, code):
    """At dt 0.01 the damped curtain comes to rest and the undamped one does not; at 2.7 times the limit it diverges at
    once. Afterwards the same simulation does the first again: nothing is left over."""
    curtain = load_scene("lab-curtain").replace(
        {"grid.rows": 8, "grid.columns": 8, "method.integrator": "semi-implicit-euler"}
    )
    with opened(curtain, live=LIVE) as simulation:
        found = outcome(simulation, dt, 10.0, damping)
        again = outcome(simulation, dt, 10.0, damping)
    assert found.code == code
    assert again == found
    assert (found.step is not None) == (code == DIVERGED)
    if code == DIVERGED:
        assert 1 < found.step < 100 and f"step {found.step}" in found.note
    else:
        assert (found.speed < stability_runs.SETTLED) == (code == SETTLES)


def test_slow_growth_is_not_called_bounded(opened):
    """Explicit Euler at 8 times its limit gains 1.4 % a hundred steps near rest, (dt w^2 - gamma) dt / 2 a step at half of
    the bound's w^2: finite after the six seconds, and so run on until it is seen where it goes."""
    curtain = load_scene("lab-curtain").replace(
        {"grid.rows": 8, "grid.columns": 8, "method.integrator": "explicit-euler"}
    )
    with opened(curtain, live=LIVE) as simulation:
        found = outcome(simulation, 0.0003, 10.0, 0.003)
    assert found.code in (GROWS, DIVERGED)
    assert found.steps > stability_runs.steps_of(0.0003)


@pytest.mark.parametrize("limit", [0.0004, 0.0015, 0.2, 0.256, 3.0, 400.0, 3000.0])
def test_the_search_finds_an_edge_on_either_side_of_where_it_begins(opened, monkeypatch, limit):
    """dt w of a scheme that grows exactly above it; below and above the range of the search there is none to find."""
    with opened(chain(0.03), live=LIVE, precision="float64") as simulation:
        monkeypatch.setattr(stability_runs, "grows", lambda simulation, start, dt, w, gamma: dt * w > limit)
        edge = measured_edge(simulation)
    outside = {0.0004: 0.0, 3000.0: inf}
    assert edge == outside.get(limit, pytest.approx(limit / CHAIN, rel=stability_runs.TOLERANCE))


def test_edges_of_a_net_need_its_fastest_mode():
    """The grid of the map without rest lengths: the limit of its own frequency lies over that of any state."""
    curtain = load_scene("lab-curtain").replace({"grid.rows": 8, "grid.columns": 8})
    net = linear(curtain)
    assert 1 < analytic(net) / stability_limit(net) < 1.03
    shape, w = stability_runs.edge_start(net)
    assert w == scene_frequency(net).estimate
    assert not shape[:8].any() and shape[8:].all()


SMALL = Extent((0.001, 0.05), (10.0,), (0.03, 0.3), (10.0,), (), (0.03,))


@pytest.fixture
def small(monkeypatch):
    """Two integrators, one precision, few points, the kernels of the other tests."""
    monkeypatch.setattr(stability, "QUICK", SMALL)
    monkeypatch.setattr(stability, "INTEGRATORS", {n: INTEGRATORS[n] for n in ("semi-implicit-euler", "taylor")})
    monkeypatch.setattr(stability, "PRECISIONS", ("float64",))
    monkeypatch.setattr(stability, "open_simulation", partial(open_simulation, kernel="fused", math="exact"))


def test_a_run_is_stored_and_resumed(small, monkeypatch, tmp_path):
    """Ctrl-C in the middle keeps what was done; the same command does the rest; a third time there is nothing to do."""
    done = []

    def interrupted(simulation):
        if done:
            raise KeyboardInterrupt
        done.append(simulation)
        return measured_edge(simulation)

    with Store(tmp_path / "results.sqlite") as store:
        with monkeypatch.context() as patch:
            patch.setattr(stability, "measured_edge", interrupted)
            broken = run_stability(store, quick=True, backends=["cpu"], progress=False)
        assert broken.interrupted and "resumes" in str(broken)
        assert 0 < broken.measured < len(cases(SMALL, ["cpu"])) == 12
        rest = run_stability(store, quick=True, backends=["cpu"], progress=False)
        assert (rest.stored, rest.measured, rest.interrupted) == (broken.measured, 12 - broken.measured, False)
        third = run_stability(store, quick=True, backends=["cpu"], progress=False)
        assert (third.stored, third.measured, third.run) == (12, 0, "")
        assert (third.points, third.edges) == (rest.points, rest.edges)
        stored = measures(store)
    assert len(rest.points) == 8 and len(rest.edges) == 4
    assert all(abs(edge.off) < 0.0025 for edge in rest.edges)
    assert not any(p.diverged for p in rest.points if not p.over)
    at = {(p.place.integrator, p.place.dt, p.place.damping): p for p in rest.points}
    assert at["semi-implicit-euler", 0.05, 0.03].diverged and at["semi-implicit-euler", 0.05, 0.03].step < 200
    assert at["semi-implicit-euler", 0.001, 0.03].code == SETTLES
    table = str(rest).splitlines()
    assert table[0].split()[:3] == ["integrator", "backend", "precision"]
    assert len(table) == 1 + 2 + 2 and "taylor" in table[2]
    reasons = {m.value: m.reason for m in stored if m.name == OUTCOME}
    assert "diverged at step" in reasons[DIVERGED] and "its speed is" in reasons[SETTLES]
    assert {m.unit for m in stored if m.name == EDGE} == {"s"}
    assert {place_of(m.description).chain for m in stored if m.name == EDGE} == {True, False}
    assert disagreements(rest.points) == (0, 0)  # one backend


def test_the_quick_map_is_part_of_the_whole():
    """So that `--quick` first and everything later does nothing twice; and the limits lie inside the map."""
    quick, full = stability.QUICK, stability.FULL
    for one, all_of_them in ((quick.steps, full.steps), (quick.stiffnesses, full.stiffnesses),
                             (quick.dampings, full.dampings), (quick.edge_stiffnesses, full.edge_stiffnesses),
                             (quick.edge_dampings, full.edge_dampings)):  # fmt: skip
        assert set(one) <= set(all_of_them)
    limits = [stability_limit(c.scene) for c in cases(quick, ["cpu"]) if not c.edge]
    assert quick.steps[0] < max(limits) < 1.1 * quick.steps[-1]
