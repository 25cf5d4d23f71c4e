"""`softlab ablate`: what is left out follows from the scene, changes are those of closed forms, verdicts the rule's."""

import math
import sys

import numpy as np
import pytest
from read_figures import LABELS, labels

from softlab import cli
from softlab.bench.experiments.accuracy.references import stepped_force_converged
from softlab.bench.experiments.advise import ablate as module
from softlab.bench.experiments.advise import ablation
from softlab.bench.experiments.advise.ablate import ablate
from softlab.bench.experiments.advise.ablation import COARSER, FINER
from softlab.bench.experiments.advise.ablation_results import GAINS, NEEDED, NOT_NEEDED, UNTOLD
from softlab.bench.experiments.growth import MAX_GROWTH
from softlab.bench.measure import samples, timing
from softlab.bench.measure.timing import Sample
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.labbook.claims.ablation import CLAIMS
from softlab.model.base.errors import SceneError
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.figures import ablation as figure

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
    assert (summary.measured, summary.stored) == (7, 0)


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
        assert (again.measured, again.stored, again.run) == (0, 3, "")
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
    """10 x 10, two corners, undamped, 4 s (docs/method/cases.md, fact 5): errors are refused, statistics stand instead."""
    monkeypatch.setattr(ablation, "ENTRIES", (ablation._arithmetic,))
    scene = load_scene("lab-grid").replace({"grid.rows": 10, "grid.columns": 10, "damping.coefficient": 0.0})
    (found,) = ablate(store, scene, time=4.0, **QUIET).tables
    assert found.full.growth > MAX_GROWTH
    assert {found.verdict(one) for one in found.rows} == {UNTOLD}
    assert all(math.isinf(one.error) for one in (found.full, *found.rows))
    assert all(math.isfinite(one.energy_off) and math.isfinite(one.mean_off) for one in found.rows)
    assert "unknown what it needs at 4 s" in found.sentence()


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
    idle = CLAIMS["ablation-idle"](results)
    spare = [row for row in found.rows if found.verdict(row) == NOT_NEEDED]
    most = max(found.full.seconds / row.seconds for row in spare)
    assert idle.supported and idle.numbers == {"rows": 4, "spare": 2, "most": pytest.approx(most)}
    assert all(row.name in idle.sentence for row in spare)


def test_nothing_measured_nothing_drawn(store):
    results = load(store)
    assert isinstance(figure.draw(results), str)
    assert not any(claim(results).supported for claim in CLAIMS.values())


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
    moved = stepped_force_converged(scene, 20, None).position - np.array([(0, 0), (1, 0), (0, -1), (1, -1)], float)
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
        cli.main()
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
    for expected in ("full scene", "float32", "  enough", "is enough", "3 measured, 0 already in the store"):
        assert expected in printed
