"""`softlab advise`: shown right by brute force under a made-up clock, clear where there is no answer, and safe to write."""

import math
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from brute_force import brute_force, grid_steps
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab import cli
from softlab.app.command.scene_file import write_scene
from softlab.bench.experiments.accuracy.references import (
    by_numpy,
    lab_converged,
    lab_growth,
    lab_seconds,
    numpy_seconds,
)
from softlab.bench.experiments.advise import experiment as advise_experiment
from softlab.bench.experiments.advise import search as advise_search
from softlab.bench.experiments.advise.advice import Advice, Choice
from softlab.bench.experiments.advise.bracket import TIGHT, next_steps
from softlab.bench.experiments.advise.experiment import advise
from softlab.bench.experiments.growth import MAX_GROWTH, cached_growth, measure_growth
from softlab.bench.measure import samples, timing
from softlab.bench.measure.timing import Sample
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.model.base.errors import SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

END = 0.3  # s
METHODS = ("lab", "rk4", "taylor")  # the variants that tests/bench/test_accuracy.py compiles, too
SINGLE = ("float32",)


def small(changes=None) -> Scene:
    """S1 at 8 x 8."""
    return load_scene("lab-curtain").replace({"grid.rows": 8, "grid.columns": 8} | (changes or {}))


@pytest.fixture
def clockwork(monkeypatch):
    """A machine on which a force costs 1 us, and 10 us more a step: times that follow from the method alone."""

    def interleaved(subjects, repeats, _):
        for _ in range(max(repeats)):
            for subject in subjects:
                method = subject.simulation.scene.method
                yield subject, Sample(100 * (1e-5 + 1e-6 * INTEGRATORS[method.integrator].forces), 100, None)

    monkeypatch.setattr(samples, "interleaved", interleaved)
    monkeypatch.setattr(timing, "warm_up", lambda subject: (0.0, 0.0))
    monkeypatch.setattr(timing, "choose_steps", lambda subject, *_: 100)


ASKED = {"backends": ["cpu"], "integrators": METHODS, "precisions": SINGLE, "progress": False}


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path / "results.sqlite") as opened:
        yield opened


@pytest.mark.parametrize("error", [0.2, 1e-2, 1e-3, 1e-4])
def test_no_cheaper_configuration_of_the_grid_reaches_the_error(store, clockwork, error):
    """S1 at 8 x 8: the whole grid, four step sizes an octave, judged; nothing in it reaches the error for less than the
    advised configuration's cost, but for the 3 % within which its step size was closed in on."""
    advice = advise(store, small(), error, time=END, **ASKED)
    assert advice.best is not None, advice.why
    assert advice.best.error <= error
    assert advice.best.dt <= advice.best.limit
    assert advice.best.steps * advice.best.dt == pytest.approx(END)
    check = brute_force(
        store, advice, backends=["cpu"], integrators=METHODS, precisions=SINGLE, per_octave=4, octaves=4
    )
    assert check.judged == sum(
        len(grid_steps(math.ceil(END / check_limit), 4, 4)) for check_limit in map(limit_of, METHODS)
    )
    assert check.reaching >= 4
    assert check.cheaper(TIGHT) == []


def limit_of(name: str) -> float:
    from softlab.model.core.families import stability_limit

    return stability_limit(small({"method.integrator": name}))


def test_an_answer_in_words_and_from_the_store(store, clockwork, monkeypatch):
    """Asked again, nothing is run: the store holds it. The step that solves another equation is left out by name."""
    advice = advise(store, small(), 1e-3, time=END, **ASKED)
    text = str(advice)
    assert "fastest    rk4" in text
    assert "% of the stability limit" in text
    assert "lab" in dict((name.split(",")[0], reason) for name, reason in advice.beaten)
    runs = store.query("SELECT count(*) FROM sample")[0][0]
    monkeypatch.setattr(advise_search.Search, "_run", lambda *_: pytest.fail("run again"))
    again = advise(store, small(), 1e-3, time=END, **ASKED)
    assert again.choices == advice.choices
    assert store.query("SELECT count(*) FROM sample")[0][0] == runs


def test_suspect_times_are_marked_and_their_reasons_told_once() -> None:
    best = Choice("rk4", 0.1, "float32", "cpu", "fast", "fused", 1, 10, 1e-3, 2.0, 2.0, 0.0, 1.0, "too few samples")
    told = str(Advice(small(), 0.01, 1.0, 1.0, (best, replace(best, integrator="lab"), replace(best, suspect=None))))
    assert told.count("too few samples") == 1 and told.count("? ms") == 2 and told.count("2e+03 ms") == 1


@pytest.mark.parametrize(("total", "step", "told"), [(1000, 1e-6, None), (1000, 20.0, "s are left")])
def test_what_a_first_step_compiles_is_no_steps_time(store, clockwork, monkeypatch, total, step, told):
    """A clock by which the first step takes 600 s longer, of a search of 1000 s: what begins is begun by what steps take, and
    what is left out for it is told by that."""
    now = [0.0]
    for module in (advise_search, advise_experiment):
        monkeypatch.setattr(module, "clock", SimpleNamespace(perf_counter=lambda: now[0]))
    open_case, first = advise_search.Case.open, [600.0]

    def opened(case):
        simulation = open_case(case)
        advance = simulation.advance

        def timed(steps):
            now[0] += (first.pop() if first else 0.0) + steps * step
            advance(steps)

        simulation.advance = timed
        return simulation

    monkeypatch.setattr(advise_search.Case, "open", opened)
    asked = ASKED | {"integrators": ("rk4",)}
    advice = advise(store, small(), 1e-4, time=END, total_seconds=total, **asked)
    assert (advice.best is not None) == (told is None)
    assert told is None or told in dict(advice.beaten)["rk4, float32, cpu"]


def test_an_error_that_nothing_reaches(store, clockwork):
    """In float32 rounding stops the error from falling: the answer says how near one can get."""
    advice = advise(store, small(), 1e-7, time=END, total_seconds=20, **ASKED)
    assert advice.best is None
    assert "no configuration reaches 1e-07 spacings: the closest is rk4" in (advice.why or "")
    assert "stops falling" in dict(advice.beaten)["rk4, float32, cpu"]
    with pytest.raises(ValueError, match="no configuration"):
        advice.configured()


def test_chaos_forbids_an_answer(store):
    """10 x 10, two corners, undamped: by 5 s a disturbance of 1e-9 has grown beyond 1e3 (docs/method/cases.md, fact 5); the
    answer names a time up to which there is one, and there the growth is indeed less."""
    scene = load_scene("lab-grid").replace({"grid.rows": 10, "grid.columns": 10, "damping.coefficient": 0.0})
    advice = advise(store, scene, 1e-3, time=5.0, **ASKED)
    assert advice.best is None
    assert advice.growth > MAX_GROWTH
    assert "chaotic" in (advice.why or "")
    suggested = float(str(advice.why).rpartition("--time ")[2])
    assert 0.5 < suggested < 4
    assert measure_growth(scene, suggested).factor < MAX_GROWTH


@pytest.mark.parametrize(
    ("changes", "error", "time", "field"),
    [
        ({"external.magnitude": 0.1}, 1e-3, 1.0, "external.magnitude"),
        ({"grid.pinned": [[i, j] for i in range(8) for j in range(8)]}, 1e-3, 1.0, "grid.pinned"),
        ({}, 0.0, 1.0, "--error"),
        ({}, float("nan"), 1.0, "--error"),
        ({}, 1e-12, 1.0, "--error"),
        ({}, 1e-3, -1.0, "--time"),
        ({}, 1e-3, float("inf"), "--time"),
        ({"springs.stiffness": 1e12}, 1e-3, 1.0, "--time"),
    ],
)
def test_what_has_no_answer_is_refused_with_a_remedy(store, changes, error, time, field):
    with pytest.raises(SceneError) as refused:
        advise(store, small(changes), error, time=time, **ASKED)
    assert refused.value.field == field


@settings(deadline=None, max_examples=300)
@given(
    st.floats(1e-6, 10), st.sampled_from([0, 1, 2, 4]), st.integers(1, 500), st.integers(0, 11), st.floats(1e-5, 1.0)
)
def test_next_steps_lie_where_they_must(error, order, steps, turn, target):
    """More after a miss, fewer (but not under the least) after a hit, in between with both."""
    if error > target:
        assert next_steps((steps, error), None, target, order, 1, turn) > steps
        assert next_steps((steps, math.inf), None, target, order, 1, turn) > steps
    elif steps > 1:
        assert 1 <= next_steps(None, (steps, error), target, order, 1, turn) < steps
    between = next_steps((steps, 2 * target), (steps + 10, target / 2), target, order, 1, turn)
    assert steps < between < steps + 10


def test_next_steps_close_in_by_the_order():
    """On an error that falls exactly by its order three runs suffice to within 3 %."""
    for order in (1, 2, 4):
        low, high, steps, runs = None, None, 10, 0
        while not (low and high and high[0] <= max(TIGHT * low[0], low[0] + 1)):
            error = (steps / 10) ** -order
            low, high = ((steps, error), high) if error > 1e-3 else (low, (steps, error))
            steps, runs = next_steps(low, high, 1e-3, order, 10, runs), runs + 1
        assert runs <= 5
        assert high[0] == pytest.approx(10 * 1e3 ** (1 / order), rel=TIGHT - 1)


def test_growth_is_kept(tmp_path):
    scene = small()
    made = cached_growth(scene, END, tmp_path / "references")
    again = cached_growth(scene.replace({"method.dt": 0.003}), END, tmp_path / "references")
    assert np.array_equal(made.factors, again.factors)
    assert made.factor < 1
    assert not made.chaotic
    assert made.safe_time() == pytest.approx(END)
    (file,) = (tmp_path / "references").iterdir()
    file.write_bytes(b"torn")
    assert np.array_equal(cached_growth(scene, END, tmp_path / "references").factors, made.factors)


def test_the_advised_scene_round_trips(store, clockwork, tmp_path):
    """What is written runs as it is: within its limit, with the method that was advised."""
    advice = advise(store, small(), 1e-3, time=END, **ASKED)
    read = load_scene(write_scene(tmp_path / "fast.toml", advice.configured(), advice.heading()))
    assert read.method.integrator == advice.best.integrator
    assert read.method.dt == advice.best.dt
    assert read.canonical() == advice.configured().canonical()


def test_own_reference_is_the_independent_one():
    """Where NumPy would take minutes the lab's own RK4 in exact float64 stands in: here both, 5e-9 spacings apart at most
    (each is that good), and the same growth of a disturbance."""
    scene = small()
    own, independent = lab_converged(scene, END), cache.cached_reference(scene, END, None)
    assert np.abs(own.position - independent.position).max() < cache.TOLERANCE
    assert own.estimate < cache.TOLERANCE
    assert lab_growth(scene, END).factors == pytest.approx(measure_growth(scene, END).factors, rel=1e-3)
    large = scene.replace({"grid.rows": 512, "grid.columns": 512})
    assert by_numpy(scene, END)
    assert not by_numpy(large, 1.5)
    assert lab_seconds(large, 1.5) < numpy_seconds(large, 1.5) / 5


# ---------------------------------------------------------------------- the command


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--error 0", "--error = 0.0"),
        ("--error 1e-3 --set external.magnitude=1.0", "a random force differs at every step size"),
        ("--error 1e-3 --write there.toml", "there.toml exists already"),
        ("--error 1e-3 --write there.txt", "must end in .toml"),
    ],
)
def test_the_command_refuses_in_one_line(words, told, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("mine")
    monkeypatch.setattr(sys, "argv", ["softlab", "advise", "lab-curtain", *words.split()])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert told in error
    told = [line for line in error.splitlines() if not line.startswith("advise: ")]  # how long it took last time
    assert len(told) == 1
    assert (tmp_path / "there.toml").read_text() == "mine"


def test_the_command_writes_what_it_advises(capsys, monkeypatch, tmp_path, clockwork):
    monkeypatch.chdir(tmp_path)
    line = "advise lab-curtain --set grid.rows=6 --set grid.columns=6 --error 0.2 --time 0.3 --precision float32"
    monkeypatch.setattr(sys, "argv", ["softlab", *line.split(), "--backend", "cpu", "--write", "fast.toml"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    printed = capsys.readouterr().out
    assert "fastest" in printed
    assert "softlab run fast.toml --time 0.3 --backend cpu --precision float32" in printed
    scene = load_scene("fast.toml")
    assert (scene.grid.rows, scene.method.dt) != (32, 0.01)
