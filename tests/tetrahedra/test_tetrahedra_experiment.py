"""Does E mean E? The bar of tetrahedra: its exact rest, what the store tells, the figure and the sentences made from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from read_figures import LABELS, labels
from synthetic_store import GPU_RECORD

from softlab.bench.experiments import tetrahedra
from softlab.bench.experiments.tetrahedra import (
    ELEMENTS,
    MESH_ERROR,
    MODULI,
    MOTION_ERROR,
    SAG,
    SOLVER_ERROR,
    groups,
    settings,
)
from softlab.bench.experiments.tetrahedral import cantilever as cantilever_module
from softlab.bench.experiments.tetrahedral.bars import Bar, bars, of_one_version
from softlab.bench.experiments.tetrahedral.cantilever import (
    BLOCKS,
    bending_frequency,
    cantilever,
    continuum_sag,
    exact_drop,
    exact_rest,
    lacking,
    sag,
)
from softlab.bench.experiments.tetrahedral.decides import Tetrahedra, decisions, targets
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.measure.experiment import described
from softlab.bench.measure.machine import enter_machine
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.tetrahedra import CLAIMS
from softlab.model.base.disk_cache import cache_folder
from softlab.model.base.errors import SceneError, UnstableTimeStep
from softlab.plots.core.read import load
from softlab.plots.core.style import settings as drawing_settings
from softlab.plots.figures import tetrahedra as figure
from softlab.plots.figures import tetrahedra_decides, tetrahedra_total
from softlab.plots.figures.tetrahedra_decides import frontier


def test_the_bar_is_what_it_is_called() -> None:
    """50 and 400 tetrahedra in one and two voxels across; 0.5108 Hz at 1 MPa (Timoshenko's, a little under Euler's)."""
    assert [len(cantilever(n, 1e6, "xpbd", 4, 1).tetrahedra_set.tetrahedra) for n in (1, 2)] == [50, 400]
    assert bending_frequency(1e6) == pytest.approx(0.5108345, rel=0.01)


def test_exact_rests_are_the_meshs() -> None:
    """The sag of a straight elastic bar is linear in the load: of the tip load of 0.01 N it is 2.7106e-4 m on this mesh where
    the continuum's is 4.0306e-4; of its own weight both keep the same share, to a tenth, and all moduli sag alike."""
    shares = [sag(cantilever(2, young, "xpbd", 4, 1), exact_rest(2)) / continuum_sag(young) for young in MODULI]
    assert shares[0] == pytest.approx(2.7106 / 4.0306, rel=0.1)
    np.testing.assert_allclose(shares, shares[0], rtol=1e-9)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """The shortest bar, really measured on this CPU with few substeps."""
    with Store(tmp_path_factory.mktemp("tetrahedra") / "results.sqlite") as opened:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(tetrahedra, "SOLVERS_OF_TETRAHEDRA", ("xpbd",))  # the others have tests of their own
            patch.setattr(tetrahedra, "FRAMES", 90)
            few = {name: some[:1] for name, some in tetrahedra.QUICK_SETTINGS.items()}
            patch.setattr(tetrahedra, "QUICK_SETTINGS", few)
            bar = {"across": [1], "young": [1e6], "precisions": ["float64"]}
            summary = Tetrahedra()(opened, quick=True, backends=["cpu"], progress=False, **bar)
        assert summary.measured == 1
        yield opened


def test_rows_and_references_outlast_an_interruption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in the first Newton steps of the exact rest: the vibrations and the steps are stored; then before the times."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cached = (cache_folder, exact_rest, exact_drop, cantilever_module._modes)
    for made in cached:
        made.cache_clear()
    assert lacking(1) == ["modes", "rest"]
    steps: list[np.ndarray] = []
    whole = cantilever_module.nonlinear_static

    def interrupted(*arguments: Any, watch: Any, **options: Any) -> np.ndarray:
        def stop(x: np.ndarray) -> None:
            watch(x)
            steps.append(x)
            if len(steps) == 2:
                raise KeyboardInterrupt

        return whole(*arguments, watch=stop, **options)

    said: list[str] = []
    for name in ("drop", "settle"):  # motions of the solver, which are not at issue
        monkeypatch.setattr(tetrahedra, name, lambda *_: 0.1)
    monkeypatch.setattr(tetrahedra, "prepare", lambda subject, *_: subject)
    with Store(tmp_path / "results.sqlite") as opened:
        (group,) = groups(opened, ["cpu"], True, ["float64"], [2], [1e6], ["xpbd"])
        group = replace(group, measure=partial(tetrahedra._bar, 1, 1e6, [cantilever(1, 1e6, "xpbd", 4, 1)],
                                               group.descriptions[:1], tetrahedra.QUICK))  # fmt: skip
        machine = enter_machine(opened)
        run = opened.start_run(machine, "test")
        monkeypatch.setattr(cantilever_module, "nonlinear_static", interrupted)
        with pytest.raises(KeyboardInterrupt):
            group.run(opened, run, said.append)
        assert lacking(1) == ["rest"]

        def noted(*arguments: Any, start: np.ndarray, **options: Any) -> np.ndarray:
            steps.append(start)
            return whole(*arguments, start=start, **options)

        monkeypatch.setattr(cantilever_module, "nonlinear_static", noted)
        monkeypatch.setattr(tetrahedra, "in_turn", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            group.run(opened, run, said.append)
        np.testing.assert_array_equal(steps[2], steps[1])  # goes on where it was
        assert lacking(1) == []
        assert any("exact rest" in text for text in said) and any("vibrations" in text for text in said)
        stored = {measure.name for measure in measures(opened)}
        assert {tetrahedra.MOTION_ERROR, tetrahedra.SOLVER_ERROR, tetrahedra.MESH_ERROR} <= stored
        assert not group.is_stored(opened, machine)
    for made in cached:
        made.cache_clear()


def test_both_errors_are_told_apart(store: Store) -> None:
    found = {bar.solver: bar for bar in bars(measures(store))}
    assert found.keys() == {"xpbd", BLOCKS}
    usual = found["xpbd"]
    assert (usual.elements, usual.young, usual.substeps, usual.iterations) == (50, 1e6, 4, 1)
    assert usual.seconds > 0 and usual.solver_error > 0.5  # far from rest: four substeps
    assert usual.mesh_error == pytest.approx(1.4276 / 4.0306 - 1, rel=0.1)  # section E1's, as above


def test_quick_is_a_part_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    across = replace(Tetrahedra.options["across"], values=(1, 2, 4))
    monkeypatch.setattr(Tetrahedra, "options", Tetrahedra.options | {"across": across})

    def cases(quick: bool) -> set[str]:
        with Store(":memory:") as empty:
            found = Tetrahedra().items(empty, ["cpu"], quick, **Tetrahedra().picked({}, quick))
        return {str(one["scene"]) for group in found for one in group.descriptions}

    assert cases(True) < cases(False)
    assert set(settings(True)) < set(settings(False))


def _made_up(path: Any, mesh: float = -1 / 3) -> Store:
    """A machine with a GPU on which a substep of position-based rows takes 1 ms and leaves 16 / substeps^2; other solvers
    leave 0.001 in 2 ms; the mesh is a third too stiff, or off by `mesh`."""
    store = Store(path)
    store.add_machine("gpu", "Made-up machine; Made-up GPU", GPU_RECORD)
    run = store.start_run("gpu", "softlab tetrahedra", None)
    for young in MODULI:
        for solver, substeps, iterations in settings(False):
            scene = cantilever(2, young, solver, substeps, iterations)
            description = described(scene, "gpu", tetrahedra.TETRAHEDRA, precision="float64")
            error, seconds = (16 / substeps**2, 1e-3 * substeps * iterations) if solver == "xpbd" else (1e-3, 1.0)
            numbers = {
                SAG: error,
                SOLVER_ERROR: error,
                MOTION_ERROR: -error,
                MESH_ERROR: mesh,
                ELEMENTS: 400.0,
                SECONDS: seconds,
            }
            for name, value in numbers.items():
                store.add_measure(run, description, "s", name, value, "", "of 9 pairs")
    return store


def test_what_is_claimed_and_drawn(tmp_path: Any) -> None:
    with _made_up(tmp_path / "gpu.sqlite") as made:
        results = load(made)
    elsewhere = ("tetrahedra-cuts", "tetrahedra-stepping", "tetrahedra-total")  # test_tetrahedra_meshes.py, and below
    found = {name: claim(results) for name, claim in CLAIMS.items() if name not in elsewhere}
    assert all(claim.supported for claim in found.values())
    assert found["tetrahedra-usual"].numbers["1e+06"] == pytest.approx(2.0)
    assert found["tetrahedra-mesh"].numbers["400"] == pytest.approx(-1 / 3)
    assert found["tetrahedra-creeping"].numbers["1e+06"] == pytest.approx(-1e-3)
    assert found["tetrahedra-budget"].numbers["gpu 1e+07 xpbd"] == pytest.approx(0.03)  # 18 substeps; there are 30
    assert found["tetrahedra-decided"].numbers["gpu in motion"] == pytest.approx(1.0)  # rows; others take a second
    with drawing_settings():
        drawing, decides = figure.draw(results), tetrahedra_decides.draw(results)
    assert not isinstance(drawing, str) and drawing.sources
    assert labels(drawing.figure) == LABELS["tetrahedra"]
    assert not isinstance(decides, str) and decides.sources
    assert labels(decides.figure) == LABELS["tetrahedra-decides"]


def test_total_errors_do_not_cancel(tmp_path: Any) -> None:
    """On a mesh that is a tenth too stiff 16 / substeps^2 is within 15 % from 17 substeps on (5 % of 0.9); there are 30, at
    30 ms. A solver that is softer by as much as the mesh is stiffer is no nearer to the continuum."""
    with _made_up(tmp_path / "gpu.sqlite", -0.1) as made:
        results = load(made)
    (source,) = results.sources
    soft = next(b for b in bars(source.measures) if b.solver == "xpbd")
    assert replace(soft, mesh_error=-0.5, solver_error=1.0).total_error == pytest.approx(1.0)
    claim = CLAIMS["tetrahedra-total"](results)
    assert claim.supported and "xpbd with 400 tetrahedra in 30.0" in claim.sentence
    assert claim.numbers["gpu 1e+07"] == pytest.approx(0.03)
    with drawing_settings():
        drawing = tetrahedra_total.draw(results)
    assert not isinstance(drawing, str) and labels(drawing.figure)[:1] == LABELS["tetrahedra-total"]
    assert "the sum of their magnitudes" in drawing.text


def test_times_of_two_versions_do_not_compare(tmp_path: Any) -> None:
    with _made_up(tmp_path / "gpu.sqlite", -0.1) as made:
        found = bars(load(made).sources[0].measures)
    other = [replace(bar, version="another") for bar in found[:3]]
    assert of_one_version([*found, *other]) == found and of_one_version([]) == []


def _bar(solver: str, substeps: int, seconds: float, rest: float, motion: float) -> Bar:
    return Bar(400, 1e7, solver, substeps, 1, "cpu", "float64", seconds, rest, motion, -1 / 3, False)


def test_the_fastest_is_near_and_moves() -> None:
    """Descent that stands still where it was let go is no answer at rest; a rest that is not known is none either."""
    found = [
        _bar("vbd", 1, 1e-4, 0.0, -0.98),
        _bar("newton", 1, 1e-3, 1e-6, -0.14),
        _bar("newton", 20, 8e-3, 1e-6, -0.009),
        _bar("xpbd", 128, 1e-2, 0.048, 0.039),
        _bar("xpbd", 325, 2e-2, 0.007, 0.004),
        _bar("xpbd", 512, 4e-2, nan, 0.001),
    ]
    rest, motion = decisions(found)
    assert rest.best and rest.rows and motion.best and motion.rows
    assert (rest.best.solver, rest.best.substeps, rest.rows.substeps) == ("newton", 1, 325)
    assert (motion.best.substeps, motion.rows.substeps) == (20, 325)
    assert rest.time_ratio == pytest.approx(0.05) and motion.time_ratio == pytest.approx(0.4)
    met, missed = targets(found)
    assert met.endswith("is reached") and missed.endswith("is missed") and "1e7 Pa" in met
    assert [b.substeps for b in frontier(found)] == [1, 1, 20, 325, 512]
    assert all(told.endswith("to compare it with") for told in targets(found[1:4])) and len(targets(found[1:4])) == 2
    assert targets(found[3:4]) == [] and decisions(found[:1])[0].best is None


def test_what_takes_too_long_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a setting whose motion would take too long nothing is timed; the group is done all the same."""
    monkeypatch.setattr(tetrahedra, "LONGEST", 1e-9)
    monkeypatch.setattr(tetrahedra, "QUICK_SETTINGS", dict.fromkeys(tetrahedra.SETTINGS, ()) | {"xpbd": ((4, 1),)})
    with Store(":memory:") as opened:
        bar = {"across": [1], "young": [1e7], "precisions": ["float64"]}
        for held in (0, 1):
            summary = Tetrahedra()(opened, quick=True, backends=["cpu"], progress=False, **bar)
            assert (summary.measured, summary.stored) == (1 - held, held)
        reasons = {m.name: m.reason or "" for m in measures(opened)}
        assert "would take" in reasons[MOTION_ERROR] and "would take" in reasons[SOLVER_ERROR]
        assert bars(measures(opened)) == []


def test_a_brake_that_a_step_does_not_hold_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice, and then it is told."""
    scene, asked = cantilever(1, 1e7, "vbd", 1, 30), []

    def opened(less: Any, *_: Any, **__: Any) -> Any:
        asked.append(less.damping.coefficient / scene.damping.coefficient)  # type: ignore[union-attr]
        if len(asked) not in (2,):
            raise UnstableTimeStep(1 / 60, 0.01, "vbd")
        return "opened"

    monkeypatch.setattr(tetrahedra, "open_simulation", opened)
    assert tetrahedra.open_braked(scene, "cpu", "float64") == "opened" and asked == [1.0, 0.5]  # type: ignore[comparison-overlap]
    with pytest.raises(UnstableTimeStep):
        tetrahedra.open_braked(scene, "cpu", "float64")
    assert asked[2:] == [1.0, 0.5, 0.25]


def test_fine_meshes_are_measured_where_the_laws_promise() -> None:
    """Rows in substeps that grow with the square root of E and with the fineness, as h^2 E / (rho a^2) says."""
    few, more, finer = (
        [
            n
            for solver, n, sweeps in set(settings(False, across, young)) - set(settings(True))
            if (solver, sweeps) == ("xpbd", 1)
        ]
        for across, young in ((4, 1e6), (4, 1e7), (8, 1e6))
    )
    assert max(more) == pytest.approx(10**0.5 * max(few), rel=0.02)
    assert max(finer) == pytest.approx(2 * max(few), rel=0.02)
    assert ("newton", 1, 1) in settings(False, 8, 1e7)


def test_nothing_is_claimed_of_nothing(tmp_path: Any) -> None:
    with Store(tmp_path / "empty.sqlite") as empty:
        results = load(empty)
    for claim in CLAIMS.values():
        assert not claim(results).supported
    assert isinstance(figure.draw(results), str) and isinstance(tetrahedra_decides.draw(results), str)


def test_what_there_is_not_is_told(tmp_path: Any) -> None:
    with Store(tmp_path / "none.sqlite") as opened, pytest.raises(SceneError, match="backend"):
        Tetrahedra()(opened, backends=["tpu"])
