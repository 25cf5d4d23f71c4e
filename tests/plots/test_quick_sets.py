"""A user's quick set beside fuller committed ones: sentences that need more are of the fuller set, by its machine's name, or
fall together with what rests on them."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from synthetic_store import CPU_RECORD, GPU_RECORD, Maker, cpu_store, gpu_store

from softlab.bench.experiments.accuracy.methods import XPBD
from softlab.bench.experiments.bar_costs import Cost
from softlab.bench.experiments.tetrahedral.bars import Bar
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure
from softlab.bench.store.transfer import export
from softlab.bench.stress.results import HardRow
from softlab.labbook import build
from softlab.labbook.answer import winner_tables
from softlab.labbook.build import FOLDER, marked_claim
from softlab.labbook.claims import bar_costs, tetrahedra
from softlab.labbook.claims.claim import Claim
from softlab.labbook.claims.hard import compare_backends
from softlab.labbook.tables import machine_lines
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results, Source, judgements
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, new_figure, settings
from softlab.plots.figures import bar_costs as bar_costs_figure
from softlab.plots.figures import convergence
from softlab.plots.figures.convergence import Converging


@cache
def measured() -> Source:
    """What one machine measured, made up."""
    return load(cpu_store()).sources[0]


def source(own: bool, key: str, cases: int, backend: str = "cpu", finding: str | None = None) -> Source:
    """A machine that judged so many cases."""
    machine = replace(measured().machine, key=key)
    description = {"backend": backend} | ({"finding": finding} if finding else {})
    one = measured().measures[0]
    measures: list[Measure] = [
        replace(one, description=description, name="x", configuration=f"{finding} {n}") for n in range(cases)
    ]
    return Source(machine, own, (), tuple(measures), ())


def chosen(*sources: Source) -> list[str]:
    return [found.machine.key for found in judgements(Results(sources), lambda measure: measure.name == "x")[1]]


def test_a_quick_set_does_not_take_the_place_of_a_full_one() -> None:
    full, other = source(False, "full", 100), source(False, "gpu", 100, "gpu")
    assert chosen(source(True, "quick", 50), full) == ["full"]
    assert chosen(source(True, "mine", 95), full) == ["mine"], "a full one of another version of the lab does"
    assert chosen(source(True, "mine", 95), full, other) == ["mine", "gpu"]


def test_each_experiment_by_itself() -> None:
    """What only the quick one holds is told from it."""
    mine = replace(
        source(True, "mine", 50, finding="strip"),
        measures=(
            *source(True, "", 50, finding="strip").measures,
            *source(True, "", 20, finding="tetrahedra").measures,
        ),
    )
    found, sources = judgements(
        Results((mine, source(False, "full", 100, finding="strip"))), lambda measure: measure.name == "x"
    )
    assert [one.machine.key for one in sources] == ["mine", "full"]
    counts = {kind: sum(m.description["finding"] == kind for m in found) for kind in ("strip", "tetrahedra")}
    assert counts == {"strip": 100, "tetrahedra": 20}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A user's machine that timed one grid, and the committed measurements of another."""
    folder = tmp_path_factory.mktemp("exports")
    export(gpu_store(), folder / "gpu.csv")
    store = Store(":memory:")
    how = {"backend": "cpu", "threads": 2, "layer": "omp", "wait_policy": "passive"}
    Maker(store, CPU_RECORD, "c").timing((16, 16), 1e-5, **how)
    return load(store, [folder / "gpu.csv"])


def test_what_the_user_did_not_measure_is_told_of_the_committed_by_name(both: Results) -> None:
    made = marked_claim(both, "threads-small")
    assert made.numbers and "Made-up CPU, 16 cores (committed)" in made.sentence
    assert not marked_claim(Results(both.featured), "threads-small").numbers


def test_what_the_user_measured_stays_even_where_the_committed_say_more(
    both: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compared(results: Results) -> Claim:
        own = any(one.by_user for one in results.sources)
        return Claim("Here there is no difference." if own else "There is one.", {"ratio": 1.0}, not own)

    monkeypatch.setitem(build.CLAIMS, "compared", compared)
    assert marked_claim(both, "compared").sentence == "Here there is no difference."


def test_what_rests_on_a_claim_falls_with_it(tmp_path: Path) -> None:
    """`when`, `see`, `shows` and a group without tables print nothing."""
    typst = pytest.importorskip("typst")
    (tmp_path / "template.typ").write_text((FOLDER / "template.typ").read_text(encoding="utf-8"), encoding="utf-8")
    missing = {"file": None, "title": "T", "caption": "", "reason": "nothing was timed"}
    (tmp_path / "data.json").write_text(
        json.dumps({"figures": {"f": missing}, "facts": {}, "claims": {}, "measured": ["there"], "tables": {"t": []}})
    )
    (tmp_path / "page.typ").write_text(
        '#import "template.typ": *\n#metadata((when("there")[a], when("gone")[b], see("f"), shows("f")[b], sheets("t"),'
        'sentence("nothing was timed"))) <made>'
    )
    (made,) = json.loads(typst.query(str(tmp_path / "page.typ"), "<made>", field="value", root=str(tmp_path)))
    assert made[0] == {"func": "text", "text": "a"} and made[1:5] == [None] * 4 and made[5] == "Nothing was timed"


def twins() -> Results:
    """Two machines of one name."""
    store = Store(":memory:")
    for number, memory in enumerate((8, 16)):
        maker = Maker(
            store, GPU_RECORD | {"memory_gib": memory, "limits_suspect": "load" * number or None}, f"g{number}"
        )
        maker.timing((16, 16), 1e-5, threads=16, layer="omp", wait_policy="passive", backend="cpu")
    return load(store)


def test_machines_of_one_name_are_told_apart() -> None:
    results = twins()
    assert len({one.processor for one in results.sources}) == 2
    assert {one.gpu for one in results.sources} == {"Made-up GPU"}
    assert len({line.partition(" (")[0] for line in machine_lines(results)}) == 2
    assert len({one.processor for one in load(cpu_store()).sources} & {"Made-up CPU, 2 cores"}) == 1, "one needs none"


def test_a_limit_that_others_disturbed_is_marked() -> None:
    assert sorted("while other programs ran" in line for line in machine_lines(twins())) == [False, True]


def test_rows_of_several_machines_are_marked_by_numbers(tmp_path: Path) -> None:
    """S1 of one committed machine, its other size of another; the reader's machine has a table of its own."""
    other, mine = Store(":memory:"), Store(":memory:")
    changes = {"grid.rows": 16, "grid.columns": 16, "method.integrator": "rk4", "method.dt": 0.01}
    Maker(other, GPU_RECORD, "g").point_of(load_scene("lab-curtain").replace(changes), 1e-5, 1e-3, backend="gpu")
    Maker(mine, CPU_RECORD, "c").point("lab-curtain", "rk4", 0.01, 1e-5, 1e-3, None, "float64", "cpu")
    export(other, tmp_path / "gpu.csv")
    export(mine, tmp_path / "cpu.csv")
    (table,) = winner_tables(load(None, [tmp_path / "gpu.csv", tmp_path / "cpu.csv"]))
    marks = {row[6] for row in table["rows"] if row[6] != "\N{EN DASH}"}
    assert marks == {"GPU (1), float64", "CPU (2), float64"} and "(1) GPU Made-up GPU" in table["title"]
    first, second = winner_tables(load(mine, [tmp_path / "gpu.csv"]))
    for table, processor in ((first, "CPU, float64"), (second, "GPU, float64")):
        assert {row[6] for row in table["rows"]} - {"\N{EN DASH}"} == {processor}


# ---------------------------------------------------------------------- what is held, and no more


def of_cpu(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, found: Any) -> Results:
    """Results of one machine on whose CPU a module finds that."""
    monkeypatch.setattr(module, name, lambda source, backend=None: found if backend != "gpu" else [])
    return load(cpu_store())


def test_a_method_whose_answer_is_not_known_is_not_called_far_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    near = Cost("cpu", "mass-spring", 4, 1e-6, False, 0.05, 0.01)
    far, unknown = replace(near, solver="xpbd", sag=0.5), replace(near, solver="tetrahedra, newton", sag=None)
    made = bar_costs.costs_of(of_cpu(monkeypatch, bar_costs, "on", [near, far, unknown]))
    assert "; xpbd is not so near; of tetrahedra (newton) the time alone was measured" in made.sentence
    drawn = bar_costs_figure.judged(load(cpu_store()).sources[0], "cpu")
    monkeypatch.setattr(bar_costs_figure, "on", lambda *_: [near, far, unknown])
    assert drawn == [] and bar_costs_figure.judged(load(cpu_store()).sources[0], "cpu") == [near, far]


@pytest.mark.parametrize(("rows_error", "words"), [(0.005, "of its time"), (0.02, "where none does")])
def test_the_fastest_solver_is_told_beside_the_figure_that_shows_it(
    monkeypatch: pytest.MonkeyPatch, rows_error: float, words: str
) -> None:
    """Also where nothing position-based comes as near."""
    newton = Bar(400, 1e7, "newton", 1, 1, "cpu", "float64", 1e-3, 1e-6, 1e-3, -0.3, False)
    rows = replace(newton, solver="xpbd", substeps=128, seconds=1e-2, solver_error=rows_error, motion_error=rows_error)
    made = tetrahedra.decided(of_cpu(monkeypatch, tetrahedra, "_all", [newton, rows]))
    assert made.numbers and words in made.sentence and "10⁷" in made.sentence


@pytest.mark.parametrize(("counts", "drawn"), [((4,), False), ((4, 8), True)])
def test_a_figure_of_lines_needs_two_points_of_one(
    monkeypatch: pytest.MonkeyPatch, counts: tuple[int, ...], drawn: bool
) -> None:
    found = [
        Converging(name, "cpu", 256, count, 0.1 / count, 1e-3 * count, 1.0, 1.0, 1.0, False)
        for name in XPBD for count in counts
    ]  # fmt: skip
    results = of_cpu(monkeypatch, convergence, "converging", found)
    assert isinstance(convergence.draw(results), Drawing) == drawn


def test_lines_of_reference_are_seen_on_the_grids_own() -> None:
    """A line at a tick lies over the grid's."""
    with settings():
        _, (ax,) = new_figure(1, 2.0)
        line = ax.axhline(1, zorder=1)
        assert ax.yaxis.get_zorder() < line.get_zorder() and ax.xaxis.get_zorder() < line.get_zorder()


def test_what_is_said_of_a_committed_gpu_says_so(tmp_path: Path) -> None:
    """The reader's CPU beside a committed machine with a GPU: the chapter on hard cases names both in one sentence."""
    rows = [HardRow("B4", "lab", backend, "float64", 0.01, "pass", "", ()) for backend in ("cpu", "gpu")]
    export(gpu_store(), tmp_path / "gpu.csv")
    sources = load(cpu_store(), [tmp_path / "gpu.csv"]).sources
    assert "of CPU and GPU (committed) are the same" in compare_backends(rows, sources).sentence
    assert "of CPU and GPU are the same" in compare_backends(rows, load(gpu_store()).sources).sentence
