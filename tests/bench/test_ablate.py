"""`softlab ablate`: what is left out follows from the scene, changes are those of closed forms, verdicts the rule's."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from read_figures import LABELS, labels

import softlab
from bench.experiments.accuracy.references import held_converged
from bench.experiments.advise import ablate as module
from bench.experiments.advise import ablation
from bench.experiments.advise.ablate import ablate
from bench.experiments.advise.ablation import COARSER, FINER, FULL, INTEGRATOR, PART, Ablation, ablations
from bench.experiments.advise.ablation_results import GAINS, NEEDED, NOT_NEEDED, UNTOLD, Ablated, AblationRow
from bench.measure import samples, timing
from bench.measure.growth import MAX_GROWTH
from bench.measure.timing import Sample
from bench.reference import cache
from bench.reference.philox import random_directions
from bench.store.database import Store
from labbook.claims.ablation import CLAIMS, typeset
from model.core.errors import SceneError
from model.core.families import stability_limit
from model.core.integrators import INTEGRATORS
from model.scene.scene import Scene, load_scene
from plots.core.read import load
from plots.core.style import Drawing, settings
from plots.figures import ablation as figure

QUIET = {"backends": ["cpu"], "progress": False}


def curtain(changes=None) -> Scene:
    """S1 at 6 x 6."""
    return load_scene("lab-curtain").replace({"grid.rows": 6, "grid.columns": 6} | (changes or {}))


def falling(**parts) -> Scene:
    """Four masses of 10 g without springs that fall against a damper: x'' = -g - c/m x', 3 1/s."""
    tables = {"damping": {"coefficient": 0.03}, "gravity": {"acceleration": 9.81}} | parts
    return Scene({"title": "Four", "grid": {"rows": 2, "columns": 2}, "method": {"dt": 0.01}} | tables)


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path / "results.sqlite") as opened:
        yield opened


@pytest.fixture
def clockwork(monkeypatch):
    """A machine on which a step costs 10 us and each part, bit and force of it more, so that savings are known."""

    def interleaved(subjects, repeats, _):
        for turn in range(max(repeats)):
            for subject in subjects:
                yield subject, Sample(100 * step_seconds(subject.simulation) * (1 + 0.01 * turn), 100, None)

    monkeypatch.setattr(samples, "interleaved", interleaved)
    monkeypatch.setattr(timing, "warm_up", lambda subject: (0.0, 0.0))
    monkeypatch.setattr(timing, "choose_steps", lambda subject, *_: 100)


def step_seconds(simulation) -> float:
    forces = INTEGRATORS[simulation.scene.method.integrator].forces
    wide = simulation.options.precision == "float64"
    return 1e-6 * (10 + forces * len(simulation.plan.parts) + 2 * wide)


# ---------------------------------------------------------------------- what can be left out


def names(scene: Scene, kind: str) -> list[str]:
    return [one.name for one in ablations(scene) if one.kind == kind]


def test_the_parts_that_do_something_can_be_dropped():
    """Forces and constraints of the scene, by its own names; not the masses, the start, the method, nor what is off."""
    assert names(curtain(), PART) == ["without springs", "without damping", "without gravity"]
    off = {"gravity.enabled": False, "damping.coefficient": 0.0, "external.magnitude": 0.0}
    assert names(curtain(off), PART) == ["without springs"]
    named = Scene({"net": {"kind": "grid", "rows": 2, "columns": 2}, "pull": {"kind": "gravity"}, "springs": {}})
    assert names(named, PART) == ["without pull", "without springs"]
    for one in ablations(named):
        if one.kind == PART:
            assert one.of(named).as_dict().keys() == named.as_dict().keys() - {one.spares}


def test_a_new_part_needs_nothing_here(monkeypatch):
    """Whatever other kinds a scene may get, all of them that a plan has a stage for are offered."""
    planned = []

    class Plan(list):
        pass

    def plan(scene):
        planned.append(scene)
        return Plan(sorted(scene.parts))

    monkeypatch.setattr(ablation, "scene_plan", plan)
    scene = curtain({"external.magnitude": 0.0})
    assert "without external" in names(scene, PART)
    assert len(planned) == 2 * len(names(scene, PART))


def test_what_makes_a_cloth_can_be_dropped():
    wanted = ["structural", "shear", "bending", "damping", "gravity", "wind"]
    assert names(load_scene("cloth-wind"), PART) == [f"without {name}" for name in wanted]
    assert {"without sphere", "without floor"} <= set(names(load_scene("cloth-sphere"), PART))


def test_cheaper_integrators_need_fewer_forces():
    assert names(curtain(), INTEGRATOR) == []
    cheaper = names(curtain({"method.integrator": "rk4"}), INTEGRATOR)
    assert cheaper == [name for name, one in INTEGRATORS.items() if one.forces < 4]
    assert len(cheaper) == 5


def test_arithmetic_and_step_sizes():
    scene = curtain()
    found = {one.name: one for one in ablations(scene)}
    assert (FULL.precision, FULL.math) == ("float64", "exact")
    assert (found["float32"].precision, found["float32"].math) == ("float32", "exact")
    assert (found["fast math"].precision, found["fast math"].math) == ("float64", "fast")
    assert found["dt 0.02 s"].of(scene).method.dt == 2 * scene.method.dt
    assert found["dt 0.005 s"].of(scene).method.dt == scene.method.dt / 2
    assert names(curtain({"external.magnitude": 0.1}), COARSER) == []
    assert FULL.of(scene).canonical() == scene.canonical()


def test_a_part_that_another_stands_on_is_not_optional(monkeypatch):
    def refuse(self, scene):
        raise SceneError("springs", None, "needed by another part")

    monkeypatch.setattr(Ablation, "of", refuse)
    assert names(curtain(), PART) == []


# ---------------------------------------------------------------------- the rule


def row(name="full scene", kind="full", error=1e-3, change=0.0, growth=1.0, estimate=1e-9, seconds=1.0) -> AblationRow:
    return AblationRow(name, kind, name, "", error, change, estimate, growth, 0.1, 0.2, seconds, None)


def table(full: AblationRow, *rows: AblationRow) -> Ablated:
    return Ablated("A scene", 0.01, "velocity-verlet", "cpu", 1.5, full, rows)


@pytest.mark.parametrize(
    ("full", "less", "verdict"),
    [
        (row(), row(kind=PART, error=1.9e-3, change=0.9e-3), NOT_NEEDED),
        (row(), row(kind=PART, error=2e-3, change=1.1e-3), NEEDED),
        (row(error=1e-9, estimate=1e-8), row(kind=PART, change=9e-8), NOT_NEEDED),  # under what the reference resolves
        (row(error=1e-9, estimate=1e-8), row(kind=PART, change=11e-8), NEEDED),
        (row(error=1e-16, estimate=0.0), row(kind=COARSER, change=1e-15), NOT_NEEDED),  # rounding
        (row(error=1e-16, estimate=0.0), row(kind=FINER, error=1e-17, change=1e-16), NOT_NEEDED),
        (row(error=math.inf, growth=2 * MAX_GROWTH), row(kind=PART, change=1e-9), UNTOLD),
        (row(error=math.inf, growth=math.nan), row(kind=PART, change=1e-9), UNTOLD),
        (row(error=math.inf, growth=2 * MAX_GROWTH), row(kind=PART, change=math.inf, error=math.inf), NEEDED),
        (row(), row(kind=FINER, error=2.5e-4, change=7.5e-4), GAINS),
        (row(), row(kind=FINER, error=1e-3, change=1e-5), NOT_NEEDED),  # an error that no longer falls
    ],
)
def test_the_verdict(full, less, verdict):
    assert table(full, less).verdict(less) == verdict


def test_the_sentence_is_made_from_the_data():
    rows = [
        replace(row("without wind", PART, change=5e-4, seconds=0.5), spares="wind"),
        replace(row("without gravity", PART, change=2.0), spares="gravity"),
        replace(row("without springs", PART, change=3.0), spares="springs"),
        replace(row("float32", "arithmetic", change=3e-6, seconds=0.98), spares="float64"),
        replace(row("euler", INTEGRATOR, change=1.0), spares="rk4"),
        replace(row("dt 0.02 s", COARSER, change=math.inf, error=math.inf, seconds=None), spares="dt 0.01 s"),
        replace(row("dt 0.005 s", FINER, error=2.5e-4, seconds=2.0), spares="dt 0.01 s"),
    ]
    assert table(row(), *rows).sentence() == (
        "A scene at dt 0.01 s with velocity-verlet, on the CPU, by itself 1.0e-03 spacings off at 1.5 s: it needs springs "
        "and gravity, not wind (without it changes 5.0e-04, 2 times as fast); rk4 is needed (euler changes 1.0e+00); "
        "float32 is enough (changes 3.0e-06, saves nothing); dt 0.02 s is too long (diverges); dt 0.005 s would make the "
        "error 4 times smaller for 2 times the time."
    )
    doubtful = table(replace(row(), suspect="load"), *rows).sentence()  # no saving is told from times that may be wrong
    assert "times as fast" not in doubtful
    assert "times the time" not in doubtful
    assert "not wind (without it changes 5.0e-04)" in doubtful
    chaotic = table(row(growth=1e6, error=math.inf), *rows).sentence()
    assert "cannot be told at 1.5 s" in chaotic
    assert chaotic.endswith("it diverges dt 0.02 s.")


# ---------------------------------------------------------------------- measured


def test_dropped_parts_change_what_closed_forms_say(store, clockwork):
    """A mass that falls against a damper of rate r = 3 1/s: y = -g/r (t - (1 - exp(-r t))/r). Without gravity it stays;
    without the damper it falls g t^2 / 2. Between these and the runs lie the errors of velocity Verlet, which stand in
    the table (none without a damper), and of the reference."""
    end, r, g = 0.4, 3.0, 9.81
    fallen = g / r * (end - (1 - math.exp(-r * end)) / r)
    summary = ablate(store, falling(), time=end, **QUIET)
    (found,) = summary.tables
    rows = {one.name: one for one in found.rows}
    own = found.full.error
    assert 0 < own < 1e-3
    assert abs(rows["without gravity"].change - fallen) <= own * (1 + 1e-9)
    assert rows["without gravity"].error == pytest.approx(fallen, abs=cache.TOLERANCE)
    assert rows["without damping"].error == pytest.approx(g * end**2 / 2 - fallen, abs=cache.TOLERANCE)
    assert {found.verdict(rows[name]) for name in ("without gravity", "without damping")} == {NEEDED}
    assert found.verdict(rows["float32"]) == NOT_NEEDED
    # second order: the step halved, a quarter of the error remains, and 3/4 of it are the change; doubled, 3 times it;
    # to O(r dt), which is 6 %
    halved, doubled = rows["dt 0.005 s"], rows["dt 0.02 s"]
    assert halved.error == pytest.approx(own / 4, rel=0.06)
    assert halved.change == pytest.approx(0.75 * own, rel=0.06)
    assert doubled.change == pytest.approx(3 * own, rel=0.06)
    assert (found.verdict(halved), found.verdict(doubled)) == (GAINS, NEEDED)
    # the clock: 10 us a step, 2 for float64, 1 a part
    assert found.saving(rows["float32"]) == pytest.approx(14 / 12)
    assert found.saving(rows["without gravity"]) == pytest.approx(14 / 13)
    assert found.saving(doubled) == pytest.approx(2)
    assert found.saving(halved) == pytest.approx(0.5)
    seconds = [one.seconds for one in found.rows]
    assert seconds == sorted(seconds)
    assert (summary.measured, summary.held) == (7, 0)


def test_asked_again_nothing_is_run(store, clockwork, monkeypatch):
    """The store holds it; another time of judgement, or changed code, is another measurement."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    first = ablate(store, falling(), time=0.2, **QUIET)
    held = store.query("SELECT count(*) FROM sample")[0][0]
    assert held == 3 * module.REPEATS
    with monkeypatch.context() as patched:
        patched.setattr(module._Work, "measure", lambda *_: pytest.fail("run again"))
        again = ablate(store, falling(), time=0.2, **QUIET)
        assert again.tables == first.tables
        assert (again.measured, again.held, again.run) == (0, 3, "")
        with pytest.raises(pytest.fail.Exception):
            ablate(store, falling(), time=0.3, **QUIET)
        patched.setattr(module, "VERSION", module.VERSION + 1)
        with pytest.raises(pytest.fail.Exception):
            ablate(store, falling(), time=0.2, **QUIET)


def test_interrupted_it_resumes(store, clockwork, monkeypatch):
    """Ctrl-C among the samples: what was had is kept, no table is made of halves, and the next call completes it."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    whole = samples.interleaved

    def cut(subjects, repeats, watch):
        for turn, sample in enumerate(whole(subjects, repeats, watch)):
            if turn == 4:
                raise KeyboardInterrupt
            yield sample

    monkeypatch.setattr(samples, "interleaved", cut)
    stopped = ablate(store, falling(), time=0.2, **QUIET)
    assert stopped.interrupted
    assert store.query("SELECT count(*) FROM sample")[0][0] == 4
    assert all(found.full.seconds is None for found in stopped.tables)
    monkeypatch.setattr(samples, "interleaved", whole)
    (found,) = ablate(store, falling(), time=0.2, **QUIET).tables
    assert found.full.seconds is not None
    assert len(found.rows) == 2


def test_over_the_limit_a_doubled_step_breaks(store, clockwork, monkeypatch):
    """At 0.9 of the limit twice the step is 1.8 times it: linear springs at 1.8 x grow by more than 10 a step, so that
    within 100 steps they are beyond 1e6 times the scene's size, and the row says where."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._step_sizes,))
    scene = curtain({"springs.rest_length": 0.0})
    scene = scene.replace({"method.dt": 0.9 * stability_limit(scene)})
    (found,) = ablate(store, scene, time=200 * scene.method.dt, **QUIET).tables
    broken, halved = (next(one for one in found.rows if one.kind == kind) for kind in (COARSER, FINER))
    assert broken.broke
    assert "step" in broken.why
    assert (broken.seconds, found.saving(broken), found.verdict(broken)) == (None, None, NEEDED)
    assert found.rows[-1] is broken
    assert not halved.broke
    assert "is too long (diverges)" in found.sentence()


def test_of_chaos_nothing_is_told(store, clockwork, monkeypatch, capsys):
    """10 x 10, two corners, undamped, 4 s (docs/method.md, fact 5): errors are refused, statistics are there instead."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    scene = load_scene("lab-grid").replace({"grid.rows": 10, "grid.columns": 10, "damping.coefficient": 0.0})
    (found,) = ablate(store, scene, time=4.0, **QUIET).tables
    assert found.full.growth > MAX_GROWTH
    assert {found.verdict(one) for one in found.rows} == {UNTOLD}
    assert all(math.isinf(one.error) for one in (found.full, *found.rows))
    assert all(math.isfinite(one.energy_off) and math.isfinite(one.mean_off) for one in found.rows)
    assert "cannot be told at 4 s" in found.sentence()


# ---------------------------------------------------------------------- drawn and told


def test_the_figure_and_the_sentences_of_the_book(store, clockwork, monkeypatch):
    """A mark for each thing left out at its change, the line at the floor, and claims that count the verdicts."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._parts, ablation._arithmetic))
    (found,) = ablate(store, falling(), time=0.4, **QUIET).tables
    results = load(store)
    with settings():
        drawing = figure.draw(results)
        assert isinstance(drawing, Drawing)
        assert labels(drawing.figure) == LABELS["ablation"]
        (ax,) = drawing.figure.axes
        floor, *marks = (line.get_xdata() for line in ax.get_lines())
        assert list(floor) == [found.floor] * 2
        assert [float(x[0]) for x in marks] == [max(figure.LEAST, one.change) for one in found.rows]
        assert [label.get_text() for label in ax.get_yticklabels()] == [one.name for one in found.rows]
    idle, needs = CLAIMS["ablation-idle"](results), CLAIMS["ablation-needs"](results)
    assert idle.numbers == {"rows": 4, "spare": 2}
    assert typeset(found.sentence()) in needs.sentence
    assert idle.supported
    assert needs.supported


def test_nothing_measured_nothing_drawn(store):
    results = load(store)
    assert isinstance(figure.draw(results), str)
    assert not any(claim(results).supported for claim in CLAIMS.values())


# ---------------------------------------------------------------------- a random force


def test_the_reference_of_a_random_force_is_the_closed_form():
    """Free masses under a force that is constant over each step: v += a dt, x += v dt + a dt^2 / 2, which RK4 solves
    exactly; 40 steps of rounding at 1 m are under 1e-13 m."""
    scene = Scene(
        {"grid": {"rows": 2, "columns": 3}, "external": {"magnitude": 0.2, "seed": 7}, "method": {"dt": 0.02}}
    )
    found = held_converged(scene, 40, None)
    x, v = np.zeros((6, 2)), np.zeros((6, 2))
    for step in range(40):
        a = 0.2 / 0.01 * random_directions(7, step, 6)
        x, v = x + v * 0.02 + a * 0.02**2 / 2, v + a * 0.02
    rest = np.array([(j, -i) for i in range(2) for j in range(3)], float)
    assert np.abs(found.position - rest - x).max() < 1e-13
    assert np.abs(found.velocity - v).max() < 1e-13
    assert np.abs(x).max() > 0.1


def test_without_a_random_force_the_reference_is_the_usual_one(tmp_path):
    scene = curtain()
    made = held_converged(scene, 30, tmp_path)
    usual = cache.kept(scene, 0.3, None)
    assert made.estimate < cache.TOLERANCE
    assert np.abs(made.position - usual.position).max() < 2 * cache.TOLERANCE
    again = held_converged(scene, 30, tmp_path)
    assert np.array_equal(again.position, made.position)
    assert len(list(tmp_path.iterdir())) == 1


def test_dropping_a_random_force(store, clockwork, monkeypatch):
    """The change is the whole motion, since nothing else moves the masses; rk4 has no error of its own under a force
    that is constant over a step; the draws of both sides are the same."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._parts,))
    scene = Scene({
        "grid": {"rows": 2, "columns": 2}, "external": {"magnitude": 0.2}, "method": {"integrator": "rk4", "dt": 0.01},
    })  # fmt: skip
    summary = ablate(store, scene, time=0.2, **QUIET)
    (found,) = summary.tables
    (without,) = found.rows
    moved = held_converged(scene, 20, None).position - np.array([(0, 0), (1, 0), (0, -1), (1, -1)], float)
    assert without.name == "without external"
    assert without.error == pytest.approx(np.sqrt(np.mean(np.sum(moved**2, axis=1))), rel=1e-12)
    assert found.full.error < 1e-13
    assert found.verdict(without) == NEEDED
    assert any("random force" in note for note in summary.notes)


# ---------------------------------------------------------------------- what has no answer, and the command


@pytest.mark.parametrize(
    ("changes", "time", "field"),
    [
        ({}, 0.0, "--time"),
        ({}, math.nan, "--time"),
        ({}, math.inf, "--time"),
        ({}, 0.009, "--time"),  # less than two steps
        ({"method.dt": 1e-9}, 1.5, "--time"),
        ({"springs.stiffness": 1e9, "method.dt": 1e-6}, 1.5, "--time"),
        ({"method.dt": 1.0}, 10.0, "method.dt"),
        ({"method.integrator": "explicit-euler", "damping.coefficient": 0.0}, 1.0, "method.dt"),
        ({"grid.pinned": [[i, j] for i in range(6) for j in range(6)]}, 1.0, "grid.pinned"),
        ({"manufactured.amplitude": 0.1}, 1.0, "manufactured"),
    ],
)
def test_what_has_no_answer_is_refused_with_a_remedy(store, changes, time, field):
    with pytest.raises(SceneError) as refused:
        ablate(store, curtain(changes), time=time, **QUIET)
    assert refused.value.field == field


def test_a_time_between_steps_is_rounded_and_told(store, clockwork, monkeypatch):
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    summary = ablate(store, falling(), time=0.213, **QUIET)
    assert summary.tables[0].end == pytest.approx(0.22)
    assert any("judged at 0.22 s, not 0.213" in note for note in summary.notes)


def command(words: str, monkeypatch, tmp_path) -> int:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["softlab", "ablate", *words.split()])
    with pytest.raises(SystemExit) as ended:
        softlab.main()
    return ended.value.code or 0


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        ("lab-curtain --time -1", 2, "--time = -1.0"),
        ("lab-curtain --backend tpu", 2, "must be one of cpu, gpu"),
        ("lab-curtin", 2, "did you mean lab-curtain?"),
        ("lab-curtain --set method.dt=0.5", 2, "over the stability limit"),
    ],
)
def test_the_command_refuses_in_one_line(words, status, told, capsys, monkeypatch, tmp_path):
    assert command(words, monkeypatch, tmp_path) == status
    error = capsys.readouterr().err
    assert told in error
    assert len([line for line in error.splitlines() if not line.startswith("ablate: ")]) == 1


def test_the_command_prints_a_table_and_its_sentence(capsys, monkeypatch, tmp_path, clockwork):
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    (tmp_path / "four.toml").write_text(
        'title = "Four"\n[grid]\nrows = 2\ncolumns = 2\n[gravity]\n[method]\ndt = 0.01\n', encoding="utf-8"
    )
    assert command("four.toml --time 0.2 --backend cpu", monkeypatch, tmp_path) == 0
    printed = capsys.readouterr().out
    for expected in ("full scene", "float32", "  enough", "is enough", "3 measured, 0 held"):
        assert expected in printed
