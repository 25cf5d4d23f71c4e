"""Speed against error: the Pareto front as a pure function, and the grid of cases run small into a store."""

import math
import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.app.command.scene_file import write_scene
from softlab.bench.experiments.accuracy import cases as accuracy_cases
from softlab.bench.experiments.accuracy import experiment as accuracy
from softlab.bench.experiments.accuracy import judge
from softlab.bench.experiments.accuracy import points as accuracy_points
from softlab.bench.experiments.accuracy.experiment import run_accuracy
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.judgement import ERROR, LARGEST, MOMENTUM_OFF
from softlab.bench.experiments.accuracy.points import FAR, pareto_front
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.bench.store.results import by_configuration, measures
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import State
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import points
from softlab.plots.core.read import load


@dataclass(frozen=True)
class P:
    error: float
    seconds: float | None
    resolved: bool = True


def test_front_by_hand():
    front = [P(1.0, 1.0), P(0.1, 2.0), P(0.01, 5.0)]
    beaten = [P(1.0, 1.5), P(0.2, 2.0), P(0.1, 2.5), P(0.5, 4.0)]
    absent = [P(math.inf, 0.1), P(1e-9, None), P(1e-12, 0.5, resolved=False)]
    assert pareto_front([*beaten, *absent, *reversed(front)]) == front
    assert pareto_front(absent) == []
    assert pareto_front([]) == []


def test_of_equal_points_one_stands():
    first, second = P(0.5, 1.0), P(0.5, 1.0)
    assert [p is first for p in pareto_front([first, second])] == [True]


errors = st.sampled_from([0.0, 1e-3, 0.1, 1.0, math.inf]) | st.floats(0, 10)


@settings(deadline=None, max_examples=200)
@given(
    st.lists(
        st.builds(P, errors, st.none() | st.sampled_from([1.0, 2.0]) | st.floats(0.1, 5), st.booleans()), max_size=12
    )
)
def test_front_against_its_definition(points):
    """On the front stand the (error, seconds), up to FAR, that no other point equals or beats in both and beats in one."""
    entered = {(p.error, p.seconds) for p in points if p.resolved and p.seconds is not None and p.error <= FAR}
    best = {a for a in entered if not any(b != a and b[0] <= a[0] and b[1] <= a[1] for b in entered)}
    front = [(p.error, p.seconds) for p in pareto_front(points)]
    assert set(front) == best
    assert len(front) == len(best)
    assert front == sorted(front, key=lambda pair: pair[1])


def test_distance_is_over_the_free_masses():
    """RMS of 3 and 4 m is 5 / sqrt 2, over a spacing of 2 m; the pinned mass, 100 m off, does not count."""
    position = np.array([[0.0, 3.0], [4.0, 0.0], [100.0, 0.0]])
    rms, largest = distance(position, np.zeros((3, 2)), np.array([True, True, False]), 2.0)
    assert rms == pytest.approx(5 / math.sqrt(2) / 2)
    assert largest == 2.0


def test_references_are_kept(tmp_path, monkeypatch):
    """The second time it comes from the file; a torn file is made again; the step size does not matter to it."""
    scene = load_scene("lab-curtain").replace({"grid.rows": 4, "grid.columns": 4})
    folder = tmp_path / "references"
    made = cache.cached_reference(scene, 0.1, folder)
    (file,) = folder.iterdir()
    monkeypatch.setattr(cache, "converged", lambda *a, **k: pytest.fail("made again"))
    again = cache.cached_reference(scene.replace({"method.dt": 0.001}), 0.1, folder)
    assert np.array_equal(again.position, made.position)
    assert again.estimate == made.estimate < 5e-9
    monkeypatch.undo()
    file.write_bytes(file.read_bytes()[:100])
    assert np.array_equal(cache.cached_reference(scene, 0.1, folder).position, made.position)
    assert [f.name for f in folder.iterdir()] == [file.name]


@pytest.mark.parametrize("time", [7.3, 20.0, 1e3])
def test_a_run_that_is_too_long_names_a_time_that_is_not(monkeypatch, time):
    """Rounded to two digits, but never up."""
    scene = load_scene("lab-curtain")
    monkeypatch.setattr(judge, "converged", lambda *_, **__: pytest.fail("affordable"))

    def judged(seconds: float) -> str:
        count = scene.grid.particle_count
        state = State(np.zeros((count, 2)), np.zeros((count, 2)), np.ones(count), seconds, 100)
        return str(judge.judge_run(scene, state)[1])

    short = re.search(r"a run of at most ([\d.e+-]+) s", judged(time))
    with pytest.raises(pytest.fail.Exception, match="affordable"):
        judged(float(short[1]))


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    """S1 in float32 with three integrators at two step sizes, run twice: (first, second, store's measures)."""
    folder = tmp_path_factory.mktemp("accuracy")
    with pytest.MonkeyPatch.context() as patch, Store(folder / "results.sqlite") as store:
        patch.setattr(accuracy_cases, "INTEGRATORS", ("lab", "rk4", "taylor"))
        patch.setattr(accuracy_cases, "QUICK_XPBD", ())
        patch.setattr(accuracy_cases, "STEP_SIZES", (0.02, 0.015, 0.01))
        how = {"quick": True, "backends": ["cpu"], "precisions": ["float32"], "scenes": ["S1"], "progress": False}
        runs = [run_accuracy(store, **how) for _ in range(2)]
        return *runs, measures(store)


def test_points_of_a_run(small_run):
    """docs/method/cases.md C over the free masses (1.6 % more than over all): lab 0.30 at any dt and first order against half
    the acceleration; RK4 2.4e-4; taylor at 0.02 s diverges, which is kept with its reason and a time."""
    first, _, stored = small_run
    assert (first.measured, first.stored, len(first.points)) == (6, 0, 6)
    at = {(p.integrator, p.dt): p for p in first.points}
    free = math.sqrt(1024 / 992)  # RMS over the free masses instead of all
    assert at["lab", 0.02].error == pytest.approx(0.2919 * free, rel=0.02)
    assert at["lab", 0.02].half / at["lab", 0.01].half == pytest.approx(2, abs=0.05)
    assert at["rk4", 0.02].error == pytest.approx(2.40e-4 * free, rel=0.05)
    assert at["rk4", 0.02].half is None
    broken = at["taylor", 0.02]
    assert broken.diverged
    assert "diverged at step" in broken.note
    assert all(p.seconds > 0 for p in first.points)
    errors = [one for one in by_configuration(stored) if ERROR in one]
    assert len(errors) == 6 and all(one[LARGEST].value >= one[ERROR].value for one in errors)
    assert all(p.resolved for p in first.points)
    assert at["rk4", 0.01] in pareto_front(first.points)
    assert broken not in pareto_front(first.points)
    assert "6 runs, of which 1 diverged" in str(first)
    assert "fastest way to an error" in str(first)
    assert all(p.growth < 1 and not p.refused for p in first.points)  # S1 contracts
    assert all(p.copied > p.seconds for p in first.points if not p.diverged)
    assert all(p.mean_off <= p.error for p in first.points if not p.diverged)
    assert sum(one[MOMENTUM_OFF].value is not None for one in errors if MOMENTUM_OFF in one) == 5


def test_the_wide_grid():
    """Beside what has no need of another size: exact math and other sizes, of S1 and of what holds at these step sizes."""
    wide = accuracy.cases(["S1", "S2"], ["cpu"], wide=True)
    quick = accuracy.cases(["S1", "S2"], ["cpu"], precisions=["float32", "float64"])
    held = {str(case.description) for case in quick}
    finer = [case for case in wide if case.scene.method.dt in accuracy_cases.STEP_SIZES[1::2]]
    integrated = [case for case in quick if case.scene.method.solver == "mass-spring"]
    assert {case.scene.method.dt for case in integrated} == set(accuracy_cases.STEP_SIZES[::2])
    assert {case.precision for case in finer} == {"float32", "float64"}
    wide = [case for case in wide if case not in finer]
    more = [case for case in wide if str(case.description) not in held and case.scene.method.solver == "mass-spring"]
    assert {c.label for c in quick} == {"S1", "S2"}
    assert {(c.label, c.math) for c in more} == {("S1", "exact"), ("S1-16", "fast"), ("S1-64", "fast")}
    assert {c.scene.method.integrator for c in more} == set(accuracy_cases.WIDE)
    assert {c.scene.grid.rows for c in more if c.label == "S1-64"} == {64}
    assert len({str(c.description) for c in wide}) == len(wide)


def test_the_quick_grid():
    """Every integrator in float64, with its order; float32 of those that sentences compare in it; a
    position-based method on one scene: no more kernels than the sentences need. All of it is part of the whole."""
    quick, wide = (accuracy.cases(["S1", "S2"], ["cpu"], wide=wide) for wide in (False, True))
    assert {str(case.description) for case in quick} < {str(case.description) for case in wide}
    explicit = [case for case in quick if case.scene.method.solver == "mass-spring"]
    for label in ("S1", "S2"):
        mine = {(case.scene.method.integrator, case.precision) for case in explicit if case.label == label}
        assert mine == {(name, "float64") for name in accuracy_cases.INTEGRATORS} | {
            ("lab", "float32"), ("velocity-verlet", "float32"), ("rk4", "float32"),
        }  # fmt: skip
    assert {(c.label, c.precision) for c in quick if c not in explicit} == {("S1", "float64")}


def test_nothing_is_measured_twice(small_run):
    first, second, _ = small_run
    assert (second.measured, second.stored, second.run) == (0, 6, "")
    assert second.points == first.points


def test_what_the_store_gains(small_run):
    """Beside error and cost: energy, its distance to the reference's, the worst strain, the reference's own error."""
    *_, stored = small_run
    names = {m.name for m in stored if m.description["scene"]["method"]["integrator"] == "rk4"}
    assert {"accuracy_energy", "accuracy_energy_off", "accuracy_strain", "reference_estimate"} <= names
    estimates = [m.value for m in stored if m.name == "reference_estimate"]
    assert max(estimates) < 5e-9


# ---------------------------------------------------------------------- S4, a cloth in wind


@pytest.fixture(scope="module")
def cloth_run(tmp_path_factory):
    """S4 at 6 x 6 masses to 0.24 s with three integrators at two step sizes: (summary, what it prints, of its points and of
    the store's what figures show, measures)."""
    folder = tmp_path_factory.mktemp("cloth")
    small = load_scene("cloth-wind").replace({"cloth.rows": 6, "cloth.columns": 6})
    with pytest.MonkeyPatch.context() as patch, Store(folder / "results.sqlite") as store:
        patch.setitem(accuracy_points.CLOTHS, "S4", str(write_scene(folder / "small.toml", small)))
        patch.setattr(accuracy_cases, "INTEGRATORS", ("lab", "velocity-verlet", "rk4"))
        patch.setattr(accuracy_cases, "OF_CLOTHS", ())
        patch.setattr(accuracy_cases, "QUICK_XPBD", ())
        patch.setitem(accuracy_points.CLOTH_ENDS, "S4", 0.24)
        patch.setattr(accuracy_cases, "CLOTH_STEP_SIZES", (0.004, 0.003, 0.002))
        patch.setattr("softlab.plots.core.accuracy_points.CLOTH_SCENES", {"S4": small.as_dict()})
        how = {"quick": True, "backends": ["cpu"], "precisions": ["float64"], "scenes": ["S4"], "progress": False}
        summary = run_accuracy(store, **how)
        shown = (
            {(p.scene, p.integrator, p.dt, p.error, p.copied) for p in drawn}
            for drawn in (summary.points, points(load(store).featured[0]))
        )
        copied = {(p.integrator, p.dt): p.copied for p in summary.points}
        return summary, str(summary), copied, tuple(shown), measures(store)


def test_a_cloth_is_judged_at_its_own_time_and_steps(cloth_run):
    """Order 4 of rk4 (16 within 30 %, near its limit); velocity Verlet between 1 and 2, since wind is first order in it; the
    hand-out's step as far off at either step size. The growth stands beside every error, and is printed."""
    summary, printed, copied, _, stored = cloth_run
    at = {(p.integrator, p.dt): p for p in summary.points}
    assert len(at) == 6 and all(p.resolved and not p.diverged for p in at.values())
    assert 11 < at["rk4", 0.004].error / at["rk4", 0.002].error < 21
    assert 1.5 < at["velocity-verlet", 0.004].error / at["velocity-verlet", 0.002].error < 4.5
    assert at["lab", 0.004].error == pytest.approx(at["lab", 0.002].error, rel=0.1)
    assert at["lab", 0.004].half is None
    assert all(p.growth and p.growth < 1e3 for p in at.values())
    assert "S4 (" in printed and ") at 0.24 s: 6 runs" in printed and "a disturbance of 1e-9 " in printed
    one = at["rk4", 0.002]
    assert copied["rk4", 0.002] == pytest.approx(one.seconds + one.copy_seconds / 0.24)
    assert {m.description["scene"]["cloth"]["rows"] for m in stored} == {6}


def test_figures_know_the_cloth_by_its_scene(cloth_run):
    _, _, _, (judged, drawn), _ = cloth_run
    assert drawn == {("S4", *point[1:]) for point in judged} and len(drawn) == 6


def test_the_cloth_belongs_to_the_full_mode(monkeypatch):
    """Not of the quick one; and its step sizes lie under the limits, but for explicit-euler's and taylor's."""
    asked: dict[bool, set[str]] = {}
    for quick in (True, False):
        monkeypatch.setattr(accuracy, "cases", lambda labels, *_, quick=quick: asked.update({quick: set(labels)}) or [])
        with Store(":memory:") as store:
            run_accuracy(store, quick=quick, backends=["cpu"], progress=False)
    assert asked == {True: {"S1", "S2"}, False: {"S1", "S2", "S4", "S5", "S6", "S6-still"}}
    scene = load_scene("cloth-wind")
    for name in ("lab", "semi-implicit-euler", "velocity-verlet", "rk4"):
        assert max(accuracy_cases.CLOTH_STEP_SIZES) < stability_limit(scene.replace({"method.integrator": name}))


# ---------------------------------------------------------------------- S5, a cloth on a ball


def test_a_reference_of_contacts(tmp_path, monkeypatch):
    """S5 at 6 x 6, as wide as the ball's cap, to 0.3 s, just after the touch: the reference's own estimate is of first order
    in its steps, it agrees with bench/reference at the same steps to rounding, and the second time comes from the file."""
    from softlab.bench.experiments.accuracy import references
    from softlab.bench.reference import mass_spring

    scene = load_scene("cloth-drop").replace({"cloth.rows": 6, "cloth.columns": 6, "cloth.origin": [-0.1, 0.52, -0.1]})
    monkeypatch.setattr(references, "FINER", 8)
    made = references.contact_converged(scene, 0.1, tmp_path)
    touching = np.linalg.norm(made.position, axis=1) < 0.51 + 1e-9
    assert touching.any() and not touching.all()
    limit = stability_limit(scene.replace({"method.integrator": "semi-implicit-euler"}))
    steps = 2 * math.ceil(8 * 0.1 / limit)
    numpy, _ = mass_spring.simulate(scene.replace({"method.dt": 0.1 / steps}), steps, integrator="semi-implicit-euler")
    assert np.abs(made.position - numpy).max() < 1e-12
    again = references.contact_converged(scene, 0.1, tmp_path)
    assert np.array_equal(again.position, made.position) and again.estimate == made.estimate
    assert len(list(tmp_path.iterdir())) == 1
    monkeypatch.setattr(references, "FINER", 32)
    finer = references.contact_converged(scene, 0.1, None)
    assert 2 < made.estimate / finer.estimate < 8
