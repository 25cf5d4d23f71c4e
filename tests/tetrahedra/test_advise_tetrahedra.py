"""`softlab advise` of tetrahedral bodies: what its laws promise is held by runs, its words say where numbers are from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from softlab import cli
from softlab.app.driver import open_simulation
from softlab.bench.experiments import tetrahedra as experiment
from softlab.bench.experiments.advise.answer import measure_advice
from softlab.bench.experiments.advise.tetrahedra import _beside, advise_tetrahedra, bodies, budgets_by_law
from softlab.bench.experiments.advise.tetrahedra_advice import Budget, TetrahedraAdvice
from softlab.bench.experiments.advise.tetrahedra_laws import MOST, Stiff, fewest, gravity_lost, least_substep
from softlab.bench.experiments.tetrahedra import drop, settle
from softlab.bench.experiments.tetrahedral.bars import bars
from softlab.bench.experiments.tetrahedral.cantilever import BLOCKS, SECOND, cantilever, exact_drop, exact_rest, sag
from softlab.bench.measure.experiment import described
from softlab.bench.reference.finite_elements import modes
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene, load_scene

JUDGE = 1e-3  # of the way: what the bar's judge in motion, linear vibrations, is itself off by


def bar(young: float = 1e6) -> Scene:
    """400 tetrahedra, two voxels across."""
    return cantilever(2, young, "xpbd", 20, 1)


def advised(scene: Scene, error: float) -> dict[tuple[str, int], Budget]:
    """(solver with its order, sweeps or 0) -> the budget, of all that reach the error."""
    found = [one for one in budgets_by_law(scene, bodies(scene)[0], error) if isinstance(one, Budget)]
    return {(one.name, one.iterations if one.solver == "xpbd" else 0): one for one in found}


@pytest.mark.parametrize("young", [1e5, 1e6, 1e7])
@pytest.mark.parametrize("solver", [("xpbd", 2), ("newton", 0), ("xpbd", 1), ("vbd", 0), (SECOND, 0)])
def test_what_is_advised_meets_its_error(solver: tuple[str, int], young: float) -> None:
    """1 % at 400 tetrahedra, run: at rest and half a vibration after it was let go."""
    budget = advised(bar(young), 0.01)[solver]
    scene = bar(young).replace(budget.changes)
    with open_simulation(scene, precision="float64") as braked:
        found = settle(braked, 2, young) / sag(scene, exact_rest(2)) - 1
    with open_simulation(experiment.let_go(scene), precision="float64") as free:
        moved = drop(free, 2, young) / exact_drop(2, young)[1] - 1
    assert abs(found) <= 0.01
    assert abs(moved) <= 0.01 + JUDGE
    least = (budget.name, budget.substeps) == (SECOND, 1)  # fewer there are none
    assert least or max(abs(found), abs(moved)) > 0.001  # and is no waste


def test_two_sweeps_are_a_bargain() -> None:
    """Of the same stiffness error rows of two sweeps ask for far fewer sweeps, the more so the smaller it is."""
    for error, least in ((0.01, 1.5), (0.001, 2.0)):
        found = advised(bar(), error)
        assert found["xpbd", 1].substeps > least * 2 * found["xpbd", 2].substeps


@pytest.mark.parametrize("young", [1e5, 1e7])
def test_frequencies_are_the_meshs(young: float) -> None:
    """The first bending vibration of the clamped bar, and of a free one its first that is no rigid motion."""
    (held,), basis = bodies(bar(young))
    assert held.frequency / (2 * np.pi) == pytest.approx(
        0.6188 * (young / 1e6) ** 0.5, rel=1e-3
    )  # as on this mesh elsewhere
    assert "own meshes" in basis
    assert (held.edge, held.coarse) == (pytest.approx(0.05), False)
    free = bar(young).replace({"beam.pinned": []})
    found = free.tetrahedra_set
    want = modes(found.position, found.tetrahedra, young, 0.3, 1000.0, np.zeros(found.particle_count, bool), 7)[6]
    assert bodies(free)[0][0].frequency == pytest.approx(2 * np.pi * want, rel=1e-6)


def test_the_laws_are_laws() -> None:
    """Half the substep, a quarter of the first law's excess and a sixteenth of the second's; a damper of the body's own adds
    to it; more sweeps are asked of stiffer bodies; what rounding takes falls with the square."""
    body = Stiff(1e6, 0.3, 1000.0, 0.05, 0.0, 3.9, False)
    assert body.excess(1e-3, 1) == pytest.approx(4 * body.excess(5e-4, 1))
    assert body.excess(1e-3, 2) == pytest.approx(16 * body.excess(5e-4, 2))
    damped = Stiff(1e6, 0.3, 1000.0, 0.05, 1e-3, 3.9, False)
    assert damped.excess(1e-3, 1) == pytest.approx(2 * body.excess(1e-3, 1))
    stiffer = Stiff(1e7, 0.3, 1000.0, 0.05, 0.0, 3.9, False)
    assert stiffer.sweeps_of_descent(1e-3, 0.01) > body.sweeps_of_descent(1e-3, 0.01) >= 1
    assert gravity_lost(1.0, 9.81, 1e-3) == pytest.approx(2.0**-24 / 9.81e-6)
    assert gravity_lost(1.0, 9.81, least_substep(1.0, 9.81, 0.01)) == pytest.approx(0.01)
    assert gravity_lost(1.0, 0.0, 1e-3) == 0


@pytest.mark.parametrize("wanted", [1, 2, 3, 7, 1000, MOST])
def test_the_fewest_are_found(wanted: int) -> None:
    assert fewest(lambda n: n >= wanted) == wanted


def test_none_are_found() -> None:
    assert fewest(lambda n: n > MOST) is None


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store(tmp_path / "results.sqlite") as opened:
        yield opened


def test_an_answer_in_words(store: Store) -> None:
    """A coarse bar, really timed: fastest first, what a scene lacks, and the basis of every number."""
    scene = cantilever(1, 1e5, "xpbd", 20, 1)
    found = advise_tetrahedra(store, scene, 0.1, backends=["cpu"], precisions=["float64"])
    assert found.best is not None
    assert [one.seconds for one in found.choices] == sorted(one.seconds for one in found.choices)
    assert {one.solver for one in found.choices} == {"xpbd", "newton", "vbd"}
    text = str(found)
    told = ("fastest", "second", "timed here", "basis", "excess of rows", "implicit Euler's damping")
    for part in (
        *told,
        "error of the mesh is not included",
        "no bar was measured on this machine",
        "--precision float64",
    ):
        assert part in text
    configured = found.configured()
    assert (configured.method.solver, configured.method.substeps) == (found.best.solver, found.best.substeps)
    assert "by its error law" in found.heading()


def test_float32_is_not_advised_where_it_loses_gravity(store: Store) -> None:
    """The bar's gravity is weak, and 128 substeps of it were measured to sag a third too little in float32."""
    found = advise_tetrahedra(store, bar(), 0.01, backends=["cpu"])
    left_out = dict(found.beaten)
    assert any(
        name.startswith("xpbd") and name.endswith("float32") and "of gravity" in left_out[name] for name in left_out
    )
    assert all(one.precision == "float64" for one in found.choices if one.solver == "xpbd")


def test_what_the_laws_do_not_know_is_left_out() -> None:
    """Six tetrahedra to a voxel; several sweeps of neo-Hookean rows; too stiff a body."""
    six = bar().replace({"beam.tetrahedra": 6})
    assert advised(six, 0.01).keys() == {("newton", 0), (SECOND, 0), ("vbd", 0)}
    neo = bar().replace({"beam.material": "neo-hookean"})
    assert ("xpbd", 2) not in advised(neo, 0.01) and ("xpbd", 1) in advised(neo, 0.01)
    steel = bar().replace({"beam.young_modulus": 1e14})
    assert advised(steel, 0.01) == {}


@pytest.mark.parametrize(("precision", "told"), [
    ("float64", ("1 bar measured here", "64 x 1 at 1e+06 Pa: 1.85%")), ("float32", ("in float32", "--precision float64")),
])  # fmt: skip
def test_measured_bars_are_told_beside_the_law(store: Store, precision: str, told: tuple[str, ...]) -> None:
    """Those of the store, of this machine; in float32 they were measured all the same, and hold nothing."""
    from softlab.bench.measure.machine import enter_machine

    machine = enter_machine(store)
    run = store.start_run(machine, "made up", None)
    scene = cantilever(2, 1e6, "xpbd", 64, 1)
    description = described(scene, "cpu", experiment.TETRAHEDRA, precision=precision)
    values = {
        experiment.SOLVER_ERROR: 0.0185, experiment.MOTION_ERROR: 0.016, experiment.MESH_ERROR: -0.33,
        experiment.ELEMENTS: 400.0, experiment.SECONDS: 0.01,
    }  # fmt: skip
    for name, value in values.items():
        store.add_measure(run, description, "s", name, value, "", "of 9 pairs")
    assert bars(measures(store))[0].solver != BLOCKS
    notes = " ".join(_beside(store, machine))
    assert all(part in notes for part in told) and "no bar was measured" not in notes


@pytest.mark.parametrize(("options", "field"), [
    ({"error": 0.5}, "--error"), ({"error": 1e-6}, "--error"), ({"error": 0.01, "time": 1.0}, "--time"),
])  # fmt: skip
def test_what_has_no_answer_is_refused(store: Store, options: dict[str, float], field: str) -> None:
    with pytest.raises(SceneError) as refused:
        measure_advice(store, bar(), how={}, **options)  # type: ignore[arg-type]
    assert refused.value.field == field


def test_the_command_writes_what_it_advises(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[TetrahedraAdvice] = []

    def made_up(store: Store, scene: Scene, error: float, **how: object) -> TetrahedraAdvice:
        budget = Budget("newton", 7, 1, 0.0, error, "made up", seconds=1e-3)
        found.append(TetrahedraAdvice(scene, error, 0.5, (budget,), (), (), 1.0))
        return found[0]

    monkeypatch.setattr("softlab.bench.experiments.advise.answer.advise_tetrahedra", made_up)
    target = tmp_path / "fast.toml"
    monkeypatch.setattr("sys.argv", ["softlab", "advise", "fem-cantilever", "--error", "0.02", "--write", str(target),
                                     "--store", str(tmp_path / "s.sqlite")])  # fmt: skip
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code in (0, None)
    assert load_scene(target).method.substeps == 7
    assert found[0].error == 0.02


@pytest.mark.parametrize(("name", "body", "exact"), [("fem-cantilever", 0, 0.0981), ("fem-steel-and-jelly", 2, 0.0098)])
def test_stiff_bars_of_the_catalogue_are_stiff(name: str, body: int, exact: float) -> None:
    """They never hang by more than a swing about their rest may take them: twice, and some for rows that were cut short. (A
    damper of the bodies' own, of 0.01 s and more, once let them hang by their length.) Exact: finite elements, [m]."""
    scene = load_scene(name)
    found = scene.tetrahedra_set
    first = found.first_particle[body]
    last = (*found.first_particle[1:], found.particle_count)[body]
    rest = found.position[first:last]
    end = rest[:, 0] > rest[:, 0].max() - 1e-6
    with open_simulation(scene) as simulation:
        for _ in range(6):
            simulation.advance(20)
            moved = simulation.state().position[first:last] - rest
            assert -moved[end, 1].mean() < 2.2 * exact
