"""The judge of the hard cases: what it makes of crashes, silent NaN and refusals; the store, the table, the figures.

The laws themselves are kept in test_physics_hard.py. Runs here are replaced by made-up outcomes.
"""

import io
import json

import numpy as np
import pytest
from read_figures import LABELS
from rich.console import Console

import softlab.bench.stress.experiment as hard
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, measures
from softlab.bench.stress.body_cases import BODY_CASES
from softlab.bench.stress.case import FORCES, HardCase
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.fluid_cases import FLUID_CASES
from softlab.bench.stress.numbers import far_away
from softlab.bench.stress.report import print_hard
from softlab.bench.stress.results import CODES, IN_FULL, disagreements, rounding_differences, rows_of
from softlab.bench.stress.shapes import as_text
from softlab.bench.stress.tetrahedral_cases import TETRAHEDRAL_CASES
from softlab.bench.stress.trial import Check, SilentNaN, Trial
from softlab.labbook.claims import hard as hard_claims
from softlab.labbook.claims.claim import Claim
from softlab.model.base.errors import Diverged, InputError, SceneError
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import State
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures.hard import draw_states, draw_verdicts

OF_FORCES = [case for case in CASES if set(FORCES) <= set(case.methods)]


def case_with(law, **fields) -> HardCase:
    return HardCase("B0", "made up", "hard/b4", law, **fields)


def raising(error: BaseException):
    def law(trial: Trial) -> list[Check]:
        raise error

    return law


# ---------------------------------------------------------------------- the collection


def test_every_row_of_the_collection_is_told_of():
    rows = {case.row for case in CASES}
    assert rows == {f"B{k}" for k in range(1, 25)} | {f"F{k}" for k in range(1, 11)} | {"A8", "A10", "S7"}
    assert len({case.name for case in CASES}) == len(CASES)


def test_every_case_is_of_the_family_of_its_scene():
    """Those of bodies and fluids say where their bounds come from."""
    assert {case.row for case in FLUID_CASES} == {f"F{k}" for k in range(1, 11)}
    assert {case.row for case in TETRAHEDRAL_CASES} == {"A8", "B21", "B22", "B23"}
    for case in CASES:
        scene, families = case.base(), (case.of_bodies, case.of_fluids, case.of_tetrahedra)
        assert families == (case in BODY_CASES, case in FLUID_CASES, case in TETRAHEDRAL_CASES), case.name
        assert families == (bool(scene.bodies), bool(scene.fluids), bool(scene.tetrahedra)), case.name
        assert bool(case.basis) == (case.of_bodies or case.of_fluids), case.name


def test_scenes_of_hard_cases_are_in_the_catalogue_under_a_name():
    assert load_scene("hard/b8").name == "hard/b8"
    with pytest.raises(InputError, match="did you mean hard/b8"):
        load_scene("hard/b88")


@pytest.mark.parametrize("case", OF_FORCES, ids=[case.name for case in OF_FORCES])
def test_step_sizes_hold_or_are_the_point(case):
    """An integrator that the scene's dt is too large for gets one under its limit, except where dt is the point."""
    for name in ("lab", "explicit-euler"):
        scene, note = hard.case_scene(case, name)
        if case.limited_step:
            assert scene.method.dt <= stability_limit(scene)
        assert bool(note) == (scene.method.dt != load_scene(case.scene).method.dt)


# ---------------------------------------------------------------------- verdicts


@pytest.mark.parametrize(
    ("error", "verdict", "words"),
    [
        (Diverged(3, 1, 0.01, 0.02), "fail", "step 3"),
        (SilentNaN("nothing was reported"), "fail", "nothing was reported"),
        (ZeroDivisionError("division by zero"), "fail", "crashed: ZeroDivisionError"),
        (SceneError("grid.rows", 0, "must be at least 1"), "fail", "grid.rows"),
    ],
)
def test_what_breaks_is_a_verdict(error, verdict, words):
    outcome = hard.judge_case(case_with(raising(error)), "lab")
    assert outcome.verdict == verdict and words in outcome.diagnosis


def test_a_refusal_is_right_only_where_it_is_expected():
    error = SceneError("grid.rows", 0, "must be at least 1")
    assert hard.judge_case(case_with(raising(error), expect="refused"), "lab").verdict == "refused"
    over = HardCase("B0", "made up", "hard/b14", far_away(1e3, False), limited_step=False)
    outcome = hard.judge_case(over, "explicit-euler")
    assert outcome.verdict == "refused" and "stability limit" in outcome.diagnosis


@pytest.mark.parametrize(("refusal", "verdict"), [("over the limit", "refused"), (None, "fail")])
def test_what_should_be_refused_and_is_let_in_fails(refusal, verdict, monkeypatch):
    monkeypatch.setattr(hard, "_refusal", lambda trial: refusal)
    outcome = hard.judge_case(case_with(lambda trial: [Check("x", 0.0, "m", "<", 1.0)], expect="refused"), "lab")
    assert (outcome.verdict, outcome.diagnosis) == (verdict, refusal or "was not refused")


def test_a_missed_bound_fails_and_a_known_one_says_why():
    def law(trial: Trial) -> list[Check]:
        return [Check("distance", 2.0, "m", "<", 1.0), Check("told", 7.0, "m"), Check("time", 9.0, "", "aim <=", 1.5)]

    outcome = hard.judge_case(case_with(law), "lab")
    assert outcome.verdict == "fail" and outcome.diagnosis == "distance 2 m, must be < 1 m"
    known = case_with(law, known={("lab", "any"): "by its method"})
    assert hard.judge_case(known, "lab").diagnosis == "by its method"
    assert hard.judge_case(known, "rk4").verdict == "fail"
    assert not Check("x", float("nan"), "", "<", 1.0).good


def test_a_broken_state_that_nobody_reported_is_found():
    class Silent:
        def state(self) -> State:
            return State(np.full((2, 2), np.nan), np.zeros((2, 2)), np.ones(2), 0.0, 0)

    with pytest.raises(SilentNaN, match="a bug of the lab"):
        Trial(load_scene("hard/b4")).checked_state(Silent())


# ---------------------------------------------------------------------- the store


@pytest.fixture
def judged(monkeypatch):
    """Made-up outcomes, counted: everything passes but B6 (fails), B8 (refused), and B14 under lab (known)."""
    calls: list[str] = []

    def judge(case, integrator, backend, precision, **_):
        calls.append(f"{case.name} {integrator} {precision}")
        scene = case.base().replace(case.changes)
        count = scene.fluid_set.particle_count if case.of_fluids else scene.grid.particle_count
        end = np.stack(np.divmod(np.arange(count), 7), 1)
        checks = [Check("residual force", 1e-12, "N", "<", 1e-9), Check("time", 2.0, "", "aim <=", 1.5)]
        if case.name == "B6":
            return hard.Outcome("fail", "it stands", [Check("height", float("inf"), "m", "<", 0.0)], end * 1.0)
        if case.expect == "refused":
            return hard.Outcome("refused", "over the limit", checks, None)
        known = case.known_failure(integrator, precision)
        if case.row == "B14":
            checks = [Check("distance from the run at the origin", 700.0 if known else 3.0, "ulp", "<", 10.0)]
        return hard.Outcome("known" if known else "pass", known or "", checks, end * 1.0)

    monkeypatch.setattr(hard, "judge_case", judge)
    return calls


def run(store: Store, **options):
    return hard.run_hard(store, backends=["cpu"], progress=False, pictures=False, **options)


def test_what_is_held_is_not_run_again(judged):
    with Store(":memory:") as store:
        first = run(store, cases=["b5", "B6"], quick=True, precisions=["float64"])
        assert first.measured == len(judged) == 8 and first.run
        again = run(store, cases=["B5"], quick=True, precisions=["float64"])
        assert (again.measured, again.stored, again.run) == (0, 6, "")
        assert [row.case for row in again.rows] == ["B5 line"] * 2 + ["B5 disturbed"] * 2 + ["B5 point"] * 2
        for name, value in (("cases", "B99"), ("integrators", "leapfrog"), ("precisions", "float16")):
            with pytest.raises(SceneError, match="must be one of"):
                run(store, **{name: [value]})


def test_interrupted_runs_lose_nothing(judged, monkeypatch):
    judge, done = hard.judge_case, []

    def stopping(*arguments, **options):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(1)
        return judge(*arguments, **options)

    with Store(":memory:") as store:
        monkeypatch.setattr(hard, "judge_case", stopping)
        stopped = run(store, cases=["B7"])
        assert stopped.interrupted and len(stopped.rows) == 3
        monkeypatch.setattr(hard, "judge_case", judge)
        assert run(store, cases=["B7"]).stored == 3


def other_backend(store: Store, case: str, verdict: str) -> None:
    """A verdict of another backend under the first integrator, float64, of the same machine."""
    scene, _ = hard.case_scene(next(c for c in CASES if c.name == case), "lab")
    description = configuration(scene, backend="gpu", precision="float64") | {"hard": case}
    (run_key,) = store.query("SELECT key FROM run LIMIT 1")[0]
    store.add_measure(run_key, description, "made up", "hard_verdict", CODES[verdict], "", "")


def test_backends_that_differ_are_told(judged):
    with Store(":memory:") as store:
        summary = run(store, quick=True)
        other_backend(store, "B4", "pass")
        other_backend(store, "B7 random", "fail")
        rows = rows_of(measures(store, machine=summary.machine))
        assert disagreements(rows) == ["B7 random, lab, float64: pass on the cpu, fail on the gpu"]
        assert not rounding_differences(rows)
        summary.rows = rows
        text = printed(summary)
        assert "backends differ, a bug of the lab: B7 random, lab" in text
        assert "FAIL, a bug of the lab: B6, lab, float64, cpu: it stands" in text
        assert "passed, but short of the target" in text and "not yet" not in text and "4 were refused" not in text


def test_a_failure_by_rounding_that_one_backend_alone_shows_is_no_bug(judged):
    with Store(":memory:") as store:
        summary = run(store, quick=True)
        other_backend(store, "B7 random", "known")
        rows = rows_of(measures(store, machine=summary.machine))
        assert not disagreements(rows)
        assert rounding_differences(rows) == ["B7 random, lab, float64: pass on the cpu, known on the gpu"]


def printed(summary) -> str:
    console = Console(file=io.StringIO(), width=200)
    print_hard(console, summary)
    return console.file.getvalue()


def test_shapes_are_thinned_and_rounded():
    position = np.stack(np.meshgrid(np.linspace(0, 9, 100), np.linspace(0, -99, 300)), axis=-1)
    shape = json.loads(as_text(position, 300, 100))
    assert np.shape(shape) == (33, 33, 2)
    assert shape[0][0] == [0, 0] and shape[-1][-1] == [9, -99]
    assert json.loads(as_text(np.zeros((1, 2)), 1, 1)) == [[[0, 0]]]
    tiny = json.loads(as_text(1e-40 * np.array([[0, 1], [2, 3.0]]), 2, 1))
    assert np.array(tiny).ravel() == pytest.approx([0, 1e-40, 2e-40, 3e-40], rel=0.01)


# ---------------------------------------------------------------------- figures and lab book


@pytest.fixture
def results(judged) -> Results:
    with Store(":memory:") as store:
        run(store, quick=True, precisions=["float64", "float32"])
        return load(store)


def test_figures_show_every_case(results):
    with settings():
        for draw, wanted in ((draw_states, LABELS["hard-states"]), (draw_verdicts, LABELS["hard-verdicts"])):
            drawing = draw(results)
            assert not isinstance(drawing, str)
            assert [ax for ax in drawing.figure.axes if ax.axison] == wanted
            text = " ".join(item.get_text() for ax in drawing.figure.axes for item in (ax.title, *ax.texts))
            for case in OF_FORCES:
                assert case.name in text or IN_FULL[case.name] in text or case.expect == "refused"
            assert drawing.sources and drawing.caption


def test_nothing_measured_is_said_and_not_drawn():
    nothing = load(None)
    assert draw_states(nothing) == draw_verdicts(nothing) == "the hard cases were not run"
    for name, claim in hard_claims.CLAIMS.items():
        made = claim(nothing)
        assert isinstance(made, Claim) and not made.supported and made.sentence.endswith("."), name


def test_claims_follow_the_verdicts(results):
    claims = {name: claim(results) for name, claim in hard_claims.CLAIMS.items()}
    assert (
        not claims["hard-verdicts"].supported
        and "bug of this lab: “turned upward, disturbed”." in claims["hard-verdicts"].sentence
    )
    assert claims["hard-verdicts"].numbers["runs"] == 4 * len(OF_FORCES)
    assert "CPU alone" in claims["hard-backends"].sentence
    assert claims["hard-far"].numbers == {"velocity-verlet": 3.0, "lab": 700.0}
    for claim in claims.values():
        assert claim.sentence[0].isupper() and "None" not in claim.sentence and "nan" not in claim.sentence
