"""What looking for divergence and determinism cost: that the same work is compared, counted right, kept, drawn and told.
No test depends on a time."""

from __future__ import annotations

from functools import cache
from itertools import count

import numpy as np
import pytest
from read_figures import LABELS, labels
from typer.testing import CliRunner

from softlab.bench.experiments.checks import LIMITS, displaced
from softlab.bench.experiments.findings import costs as findings_costs
from softlab.bench.experiments.findings import determinism as findings_determinism
from softlab.bench.experiments.findings.costs import CHECK_FRACTION, CHECKS, INTERVAL, Costs, check_groups
from softlab.bench.experiments.findings.determinism import (
    DETERMINISM,
    DIFFERENT,
    DISTANCE,
    GATHER,
    OTHERS,
    determinism,
    different_runs,
    open_variant,
)
from softlab.bench.measure import experiment
from softlab.bench.measure.costs_timing import LEAST, MOST, RATIO, STAGE, Effort, Record, in_turn
from softlab.bench.measure.machine import enter_machine
from softlab.bench.measure.timing import Sample, Subject
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.costs import CLAIMS
from softlab.model.base.errors import SceneError, SoftlabError
from softlab.model.core.simulation import State
from softlab.model.core.stability import divergence
from softlab.model.core.stability.divergence import check_interval
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.findings import determinism as determinism_figure
from softlab.plots.findings.points import check_costs, costs

STEPS = 20
TINY = Effort(2, 1e-4, 1e-3)


@pytest.fixture(scope="module", autouse=True)
def short_intervals():
    """256 steps between two looks at a small grid: a sample with looks is at least so long."""
    patch = pytest.MonkeyPatch()
    patch.setattr(divergence, "MIN_INTERVAL", 64)
    patch.setattr(divergence, "MAX_INTERVAL", {"cpu": 256, "gpu": 256})
    yield
    patch.undo()


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Both findings at one small size, run twice: (store, first, second)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "source_hash", cache(experiment.source_hash))  # sources may be edited meanwhile
        patch.setattr(findings_costs, "QUICK", TINY)
        patch.setattr(findings_costs, "CHECK_SIZES", {"cpu": (8, 600)})  # the second is too wide for `quick`
        patch.setattr(findings_determinism, "SIZES", {"cpu": (8, 600)})
        patch.setattr(findings_costs, "PRECISIONS", ("float32",))
        patch.setattr(findings_determinism, "PRECISIONS", ("float32",))
        with Store(tmp_path_factory.mktemp("costs") / "results.sqlite") as store:
            runs = [Costs()(store, quick=True, backends=["cpu"], progress=False) for _ in range(2)]
            yield (store, *runs)


@pytest.fixture(scope="module")
def results(measured):
    return load(measured[0])


def test_nothing_is_measured_twice(measured):
    """Four groups: checks at one size, the steady cost, runs by length at the small sheet, the sums of determinism."""
    _, first, second = measured
    assert (first.measured, first.stored) == (4, 0)
    assert (second.measured, second.stored, second.run) == (0, 4, "")


def test_a_sample_with_looks_is_whole_intervals(measured):
    """Else a look would be counted for steps that it does not belong to; both ways do the same steps."""
    store = measured[0]
    interval = check_interval(64, "cpu")
    steps = store.query(
        "SELECT steps, description LIKE '%\"looks\":true%' FROM sample JOIN configuration ON hash = configuration "
        "WHERE stage = ? AND description LIKE '%\"looks\"%'",
        (STAGE,),
    )
    assert {looking for _, looking in steps} == {0, 1}
    assert all(number > 0 and number % interval == 0 for number, _ in steps)
    (found,) = [m for m in measures(store, INTERVAL) if m.description["finding"] == CHECKS]
    assert found.value == interval


def test_a_sample_has_as_many_looks_as_intervals(monkeypatch):
    """With looks one every interval, without none inside the timed steps."""
    seen: list[tuple[int, int, int]] = []  # interval, steps, looks
    original = findings_costs._Checking.run

    def run(subject, steps):
        begin = len(calls)
        seconds = original(subject, steps)
        seen.append((subject.interval, steps, len(calls) - begin))
        return seconds

    (group,) = [g for g in check_groups("cpu", TINY) if g.name == f"{CHECKS} 8 x 8 float32 cpu"]
    calls: list[int] = []
    from softlab.cpu_backend.mass_spring.grid.solver import MassSpring

    look = MassSpring._first_diverged
    monkeypatch.setattr(MassSpring, "_first_diverged", lambda self: calls.append(1) or look(self))
    monkeypatch.setattr(findings_costs._Checking, "run", run)
    with Store(":memory:") as store:
        found = group.measure(Record(store, store.start_run(enter_machine(store), "test"), group.sources))
    assert {interval for interval, _, _ in seen} == {findings_costs.NEVER, check_interval(64, "cpu")}
    assert all(looked == steps // interval for interval, steps, looked in seen)
    assert max(looked for _, _, looked in seen) >= 1
    assert CHECK_FRACTION in found[1] and CHECK_FRACTION not in found[0]


def test_ratios_are_of_neighbouring_samples(monkeypatch):
    """Made-up times 1, 2, 1, 3, 1, 8 s: ratios 2, 3 and 8."""
    times = iter((1.0, 2.0, 1.0, 3.0, 1.0, 8.0))
    monkeypatch.setattr(Subject, "sample", lambda self, _: Sample(next(times), 1, None))
    store, places = Store(":memory:"), count()
    record = Record(store, store.start_run(enter_machine(store), "test"), "sources")
    subjects = [Subject(None, {"backend": "cpu", "place": next(places)}) for _ in range(2)]
    base, other = in_turn(record, subjects, 3)
    assert [base[name][0] for name in (LEAST, RATIO, MOST)] == [1, 1, 1]
    assert [other[name][0] for name in (LEAST, RATIO, MOST)] == [2, 3, 8]


@pytest.mark.parametrize("shape", [(8, 8), (9, 7), (1, 5), (5, 1), (2, 2)])
@pytest.mark.parametrize("precision", LIMITS)
@pytest.mark.parametrize("how", OTHERS["cpu"])
def test_each_way_does_the_same_step(how, precision, shape):
    """To rounding, from a start at which every spring pulls; pins stay where they are; any threads give the same bits."""
    changes = {"grid.rows": shape[0], "grid.columns": shape[1], "grid.pinned": "top-corners"}
    scene = load_scene("lab-grid").replace(changes)
    ends = []
    for way in (GATHER, how):
        with open_variant(scene, "cpu", precision, way) as simulation:
            start = displaced(simulation)
            simulation.load(start)
            simulation.advance(STEPS - 3)
            simulation.advance(3)
            ends.append(simulation.state())
            assert different_runs(simulation, start, 3, STEPS) == 0
    assert np.abs(ends[0].position - ends[1].position).max() < LIMITS[precision]
    assert np.abs(ends[0].velocity - ends[1].velocity).max() < LIMITS[precision] / scene.method.dt
    pinned = np.flatnonzero(ends[1].inverse_mass == 0)
    assert np.array_equal(ends[1].position[pinned], ends[0].position[pinned])


def test_runs_of_other_bits_are_counted():
    """A run that adds a last bit now and then: three of six after the first."""

    class Shaky:
        def __init__(self):
            self.runs, self.value = -1, 0.0

        def load(self, start):
            self.runs, self.value = self.runs + 1, 1.0

        def advance(self, steps):
            self.value = np.nextafter(1.0, 2.0) if self.runs % 2 else 1.0

        def state(self):
            return State(np.array([[self.value, 0.0]]), np.zeros((1, 2)), np.ones(1), 0.0, 0)

    assert different_runs(Shaky(), None, 7, 1) == 3


def test_a_wrong_answer_gets_no_ratio(monkeypatch):
    monkeypatch.setattr(findings_determinism, "SIZES", {"cpu": (8,)})
    monkeypatch.setattr(findings_determinism, "PRECISIONS", ("float64",))
    original = findings_determinism.open_variant

    def open_wrong(scene, backend, precision, how):
        if how == "twice":
            scene = scene.replace({"springs.stiffness": 2 * scene.springs.stiffness})
        return original(scene, backend, precision, how)

    monkeypatch.setattr(findings_determinism, "open_variant", open_wrong)
    (group,) = determinism("cpu", TINY)
    with Store(":memory:") as store:
        found = group.measure(Record(store, store.start_run(enter_machine(store), "test"), group.sources))
    by_way = dict(zip((way["sums"] for way in group.descriptions), found, strict=True))
    assert by_way["twice"][RATIO] == (None, "", "wrong answer")
    assert by_way["twice"][DISTANCE][0] > LIMITS["float64"]
    assert by_way["colours"][RATIO][0] > 0
    assert by_way[GATHER][DIFFERENT][0] == 0


def test_the_rows_are_those_of_the_store(results):
    source = results.sources[0]
    assert [c.variant for c in costs(source, DETERMINISM)] == sorted(OTHERS["cpu"])
    assert all(c.particles == 64 and c.least <= c.ratio <= c.most for c in costs(source, DETERMINISM))
    (look,) = check_costs(source, "cpu")
    assert look.interval == check_interval(64, "cpu")
    assert check_costs(source, "gpu") == []


@pytest.mark.parametrize("name", list(CLAIMS))
def test_every_claim_is_a_sentence(results, name):
    for those in (results, Results(())):
        claim = CLAIMS[name](those)
        assert claim.sentence.endswith(".")
        assert "nan" not in claim.sentence.lower() and "None" not in claim.sentence
    assert not claim.supported
    assert "not measured" in claim.sentence


@pytest.mark.parametrize(
    ("figure", "wanted"),
    [(determinism_figure, LABELS["findings-determinism"])],
)
def test_every_figure_is_drawn_or_says_why_not(results, figure, wanted):
    with settings():
        drawing = figure.draw(results)
        assert isinstance(drawing, Drawing)
        assert labels(drawing.figure) == wanted
        assert drawing.caption
    assert isinstance(figure.draw(Results(())), str)


def made_up(*rows):
    """A store of an H200 with made-up measures: (finding, field, value of the field, precision, {name: value})."""
    store = Store(":memory:")
    store.add_machine("m", "AMD EPYC, 16 cores; NVIDIA H200", {"gpu": "NVIDIA H200", "gpu_count": 1, "cores": 16})
    run = store.start_run("m", "test")
    for finding, field, way, precision, numbers in rows:
        scene = load_scene("lab-grid").replace({"grid.rows": 64, "grid.columns": 64})
        description = findings_costs.described(scene, "gpu", finding, precision=precision, **{field: way})
        for name, value in numbers.items():
            store.add_measure(run, description, "sources", name, value, "", "of 9 pairs")
    return load(store)


def ratios(ratio, **more):
    return {LEAST: 0.9 * ratio, MOST: 1.1 * ratio, RATIO: ratio} | more


def test_what_the_claims_say_of_a_gpu():
    """Made-up numbers: a scatter at half the speed whose bits differ in 7 of 9 runs; looks at 0.4 % and at 2 %."""
    told = CLAIMS["determinism-cost"](
        made_up(
            (DETERMINISM, "sums", "atomics", "float32", ratios(2.0, **{DIFFERENT: 7})),
            (DETERMINISM, "sums", "colours", "float32", ratios(1.05, **{DIFFERENT: 0})),
        )
    )
    assert told.supported and told.numbers == {"atomics": 2.0, "different": 7, "gpu colours": 1.05}
    assert "7 of 9 repeated runs gave other bits" in told.sentence
    assert "within measurement noise" in told.sentence
    for share, cheap in ((0.004, True), (0.02, False)):
        look = ratios(1.0, **{CHECK_FRACTION: share, INTERVAL: 1024})
        told = CLAIMS["looks-cost"](made_up((CHECKS, "looks", True, "float32", look)))
        assert told.supported is cheap
        assert ("not under" in told.sentence) is not cheap


@pytest.mark.parametrize("arguments", ["stability --integrator leapfrog", "accuracy --precision float16",
                                       "accuracy --integrator leapfrog"])  # fmt: skip
def test_unknown_names_are_refused(arguments, tmp_path):
    """The field, the value and what is allowed, before anything is measured."""
    from softlab import cli

    store = tmp_path / "results.sqlite"
    done = CliRunner().invoke(cli.app, [*arguments.split(), "--store", str(store)])
    _, option, value = arguments.split()
    assert isinstance(done.exception, SceneError) and isinstance(done.exception, SoftlabError)
    assert done.exception.field == option and done.exception.value == value
    assert "must be one of" in str(done.exception)


def test_a_part_of_the_map_is_a_part_of_the_whole():
    """What is run apart meets in the store: the same descriptions, none of another name."""
    from softlab.bench.experiments.accuracy import experiment as accuracy
    from softlab.bench.experiments.stability import experiment as stability

    def keys(cases):
        return [str(case.description) for case in cases]

    whole = keys(stability.cases(stability.QUICK, ["cpu"]))
    part = stability.cases(stability.QUICK, ["cpu"], ["rk4"])
    assert {case.scene.method.integrator for case in part} == {"rk4"}
    assert set(keys(part)) < set(whole)
    whole = keys(accuracy.cases(["S1"], ["cpu"], True))
    part = accuracy.cases(["S1"], ["cpu"], True, ["lab"], ["float64"])
    assert {(case.scene.method.integrator, case.precision, case.math) for case in part} == {("lab", "float64", "fast")}
    assert set(keys(part)) < set(whole)
