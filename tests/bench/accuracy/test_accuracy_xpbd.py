"""Position-based methods among the accuracy runs: the published errors, the solver's own error, and its residuals."""

import math

import numpy as np
import pytest
from xpbd_scenes import PUBLISHED

from softlab.bench.experiments.accuracy import cases as accuracy_cases
from softlab.bench.experiments.accuracy import experiment as accuracy
from softlab.bench.experiments.accuracy import methods
from softlab.bench.experiments.accuracy.cases import cases, make_case
from softlab.bench.experiments.accuracy.experiment import run_accuracy
from softlab.bench.experiments.accuracy.judge import distance, judge_run
from softlab.bench.experiments.accuracy.points import SCENES, AccuracyPoint, labels_of, method_words, point
from softlab.bench.experiments.advise.ablate import ablate
from softlab.bench.experiments.advise.experiment import advise
from softlab.bench.reference import cache, xpbd
from softlab.bench.store.database import Store
from softlab.bench.store.method_name import name_of
from softlab.bench.store.results import configuration
from softlab.model.base.errors import SceneError
from softlab.model.core.build import build
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

GAUSS_SEIDEL, JACOBI, AVERAGED = methods.XPBD


def solved(scene: Scene, name: str, iterations: int, dt: float) -> Scene:
    return scene.replace(methods.changes(name, iterations) | {"method.dt": dt})


def small(label: str = "S1") -> Scene:
    """S1 or S2 at 6 x 6."""
    return load_scene(SCENES[label]).replace({"grid.rows": 6, "grid.columns": 6})


# ---------------------------------------------------------------------- the published table


@pytest.mark.parametrize(("label", "dt", "iterations", "error"), PUBLISHED)
def test_the_published_errors(references, label, dt, iterations, error):
    """docs/method/cases.md, C: metres, RMS over all masses, at 1.5 s. To half of the last digit, and a thousandth for the
    order of the colours, in which columns came first there."""
    scene = solved(load_scene(SCENES[label]), GAUSS_SEIDEL, iterations, dt)
    case = make_case(label, scene, "cpu", "float64", "exact")
    with case.open() as simulation:
        simulation.advance(case.steps)
        state = simulation.state()
    right = cache.cached_reference(methods.newton(scene), 1.5, references)
    everything = np.ones(scene.grid.particle_count, bool)
    found, _ = distance(state.position, right.position, everything, 1.0)
    digit = 10.0 ** (math.floor(math.log10(error)) - (1 if error == 9.9e-4 else 2))
    assert found == pytest.approx(error, abs=0.5 * digit + 1e-3 * error)


@pytest.fixture(scope="module")
def references(tmp_path_factory):
    return tmp_path_factory.mktemp("references")


# ---------------------------------------------------------------------- methods


def test_methods_by_name_and_back():
    """A method's name is the scene's own word for it; the integrators' canonical texts are as they were."""
    scene = small()
    for name in methods.METHODS:
        made = scene.replace(methods.changes(name, 4, 2))
        assert made.method.name == name
        assert name_of(made.as_dict()["method"]) == name
        effort = (4, 2) if methods.position_based(name) else (None, None)
        assert methods.efforts(made.as_dict()["method"]) == effort
        again = made.replace(methods.changes("rk4"))
        assert again.canonical() == scene.replace({"method.integrator": "rk4"}).canonical()


def test_what_newton_tells_the_motion_of():
    scene = solved(small(), JACOBI, 1, 0.01)
    assert methods.newton(scene).method.solver == "mass-spring"
    assert methods.newton(small()).canonical() == small().canonical()
    rigid = ({"springs.compliance": 0.0}, {"attachments.anchors": 1}, {"method.solver": "pbd"})
    for changes in rigid:
        with pytest.raises(SceneError, match="no converged reference"):
            methods.newton(scene.replace(changes))
    with pytest.raises(SceneError, match="no converged reference"):
        methods.newton(load_scene("hard/b2"))


def ended(scene: Scene, position: np.ndarray | None = None, steps: int = 10) -> State:
    """A state of the scene after so many steps: at its start, unless told where."""
    body = build(scene)
    at = body.position if position is None else position
    return State(at, np.zeros_like(at), body.inverse_mass, steps * scene.method.dt, steps)


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        ("lab-curtain", {"springs.compliance": 0.0}, "compliance 0"),
        ("lab-curtain", {"attachments.anchors": 1}, "long-range attachments"),
        ("lab-curtain", {"method.solver": "pbd"}, "its step size and iterations"),
        ("cloth-self", {}, "contact with itself"),
        ("jelly-grid", {}, "another material"),
    ],
)
def test_a_run_tells_no_error_where_the_reference_is_another_problem(name, changes, told):
    """By the same words as `advise` and `ablate`."""
    scene = load_scene(name)
    scene = solved(scene, GAUSS_SEIDEL, 1, 0.01).replace(changes) if changes else scene
    error, reason = judge_run(scene, ended(scene), None)
    assert error is None and told in reason and reason == methods.why_unknown(scene)


def test_a_run_with_a_load_is_judged_by_a_reference_that_knows_it():
    """A chain whose end weighs a tenth swings by converged XPBD; halving the substep halves the error, and without the load
    in the reference it would stay."""
    light = {"kind": "load", "at": [3, 0], "mass": 0.001}
    scene = Scene(
        {
            "grid": {"rows": 4, "columns": 1, "pinned": "top"}, "springs": {"stiffness": 10.0}, "gravity": {},
            "light": light, "method": {"solver": "xpbd", "dt": 0.02},
        }
    )  # fmt: skip
    errors = []
    for substeps in (20, 40):
        moved = xpbd.simulate(scene, 10, substeps=substeps, iterations=20, masses=np.array([0.01, 0.01, 0.01, 0.001]))[
            0
        ]
        error, reason = judge_run(scene, ended(scene, moved), None)
        assert reason is None
        errors.append(error)
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.2) and errors[1] < 0.01


@pytest.mark.parametrize(
    "name,instead",
    [
        ("rigid-stack", "softlab bar .* softlab throughput"),
        ("jelly-grid", r"scene\.replace.*method\.solver.*mass-spring"),
        ("cloth-mesh", "cloth. is such a sheet"),
        ("cloth-self", "softlab run"),
    ],
)
def test_who_asks_for_an_error_that_nobody_knows_is_told_what_to_ask_instead(tmp_path, name, instead):
    """By `advise` and `ablate` before anything is measured, bodies before what else may be wrong with them."""
    words = f"no converged reference.*{instead}"
    with Store(tmp_path / "results.sqlite") as store:
        for asked in (lambda: advise(store, load_scene(name), 1e-2), lambda: ablate(store, load_scene(name))):
            with pytest.raises(SceneError, match=words):
                asked()


def test_scenes_of_accuracy_have_two_names():
    assert labels_of(["s6-still", "lab-curtain", "S1"]) == ["S6-still", "S1"] and labels_of([]) == []
    for name in ("jelly-drop", "S3", ""):
        with pytest.raises(
            SceneError, match=r"S1 \(lab-curtain\).* softlab advise .* softlab bar .* softlab throughput"
        ):
            labels_of([name])


def test_the_grid_of_cases():
    """Full: all orderings, step sizes and iterations; quick: Gauss-Seidel with few; named: all of theirs; nothing twice."""
    wide, quick = cases(["S1", "S2"], ["cpu"], True), cases(["S1"], ["cpu"], False)
    named = cases(["S2"], ["cpu"], False, [JACOBI], ["float64"])
    ways = {(c.scene.method.name, c.scene.method.iterations) for c in wide if c.scene.method.position_based}
    assert ways == {(name, n) for name in methods.XPBD for n in accuracy_cases.ITERATIONS}
    assert {c.scene.method.name for c in quick} == {*INTEGRATORS, GAUSS_SEIDEL}
    assert {c.scene.method.iterations for c in quick} == {1, 4}
    assert len(named) == len(accuracy_cases.XPBD_STEP_SIZES[::2]) * len(accuracy_cases.ITERATIONS)
    assert len({str(c.description) for c in wide}) == len(wide)
    assert {str(c.description) for c in (*quick, *named)} <= {str(c.description) for c in wide}
    assert str(named[0]) == "S2 xpbd jacobi x 1 dt 0.01 float64 fast cpu"


def test_words_of_a_method():
    assert method_words("rk4", None) == "rk4"
    assert method_words(JACOBI, 1) == "xpbd jacobi, 1 iteration"
    assert method_words(AVERAGED, 4) == "xpbd averaged-jacobi (to another stiffness), 4 iterations"


def test_older_stores_stay_readable():
    """A description without the solver's fields, as stores had them, and one with: the same point but for its iterations."""
    from softlab.bench.store.results import Measure

    def read(scene: Scene) -> AccuracyPoint:
        description = configuration(scene, backend="cpu", threads=2)
        measure = Measure("m", "c", "s", "r", description, "accuracy_error", 0.5, "spacing", "told")
        found = point("S1", description, {"accuracy_error": measure}, None)
        assert found is not None
        return found

    assert (read(small()).integrator, read(small()).iterations) == ("velocity-verlet", None)
    old = configuration(small(), backend="cpu")
    del old["scene"]["method"]["solver"]
    assert name_of(old["scene"]["method"]) == "velocity-verlet"
    mine = read(solved(small(), JACOBI, 4, 0.01))
    assert (mine.integrator, mine.iterations, mine.substeps) == (JACOBI, 4, 1)
    assert mine.name == "xpbd jacobi, 4 iterations, dt 0.01 s, float32, cpu"


def test_a_name_picks_all_orderings(monkeypatch):
    """`--integrator xpbd`: the three; an unknown one is refused with the list."""
    asked = []
    monkeypatch.setattr(accuracy, "cases", lambda *how: asked.append(how[3]) or [])
    with Store(":memory:") as store:
        run_accuracy(store, integrators=["xpbd"], backends=["cpu"], progress=False)
        assert asked == [list(methods.XPBD)]
        with pytest.raises(SceneError, match="xpbd jacobi"):
            run_accuracy(store, integrators=["xpbd random"], backends=["cpu"], progress=False)
