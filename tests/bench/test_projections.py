"""Projections a second: the cases, what the store tells of them, the figures and the sentences made from it."""

from __future__ import annotations

import io

import pytest
from read_figures import LABELS, labels
from rich.console import Console
from synthetic_store import GPU_RECORD

from softlab.bench.experiments.projections import NEIGHBOURS, PUBLISHED, Projections, case_of, sheet
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.declared import claims_of
from softlab.model.base.errors import SceneError
from softlab.model.position_based.plan import constraint_count
from softlab.model.scene.scene import load_scene
from softlab.plots.core.declared import draw
from softlab.plots.core.read import load
from softlab.plots.core.style import settings


def test_the_published_sizes_are_the_published_ones():
    """XPBD 2016 tells of 24 000 constraints, Small Steps of 150 000 particles and 896 000 springs."""
    told = {name: load_scene(name).replace(changes) for name, changes in PUBLISHED}
    assert constraint_count(told["cloth-xpbd"]) == 23_938
    small_steps = told["cloth-small-steps"]
    assert (small_steps.grid.particle_count, constraint_count(small_steps)) == (149_769, 894_746)
    assert told["cloth-flamenco"].method.ordering == "averaged-jacobi"


@pytest.mark.parametrize("neighbours", NEIGHBOURS)
def test_a_sheet_is_the_same_cloth_in_any_size(neighbours):
    """As wide, as heavy, as damped a square metre; with the springs of so many neighbours."""
    small, large = (sheet(n, neighbours, "jacobi", 10, 2) for n in (16, 64))
    assert len(small.cloth_springs) == neighbours // 4
    for scene in (small, large):
        assert scene.grid.rows * scene.grid.spacing == pytest.approx(2.0)
        assert scene.grid.particle_count * scene.grid.mass == pytest.approx(64 * 64 * 0.0002)
        assert scene.damping.coefficient / scene.grid.mass == pytest.approx(0.1)
    assert (small.method.substeps, small.method.iterations, small.method.ordering) == (10, 2, "jacobi")


def test_a_case_counts_every_constraint_of_every_iteration():
    case = case_of(sheet(16, 4, "gauss-seidel", 10, 3), "cpu", "float32")
    assert Projections().work(case.scene) == 2 * 16 * 15 * 10 * 3


def test_quick_is_a_part_of_the_whole():
    whole = {
        case.scene.canonical() for group in Projections().groups(["cpu", "gpu"], False, ("float32",)) for case in group
    }
    quick = {
        case.scene.canonical() for group in Projections().groups(["cpu", "gpu"], True, ("float32",)) for case in group
    }
    assert quick < whole


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> Store:
    """A small sheet, really timed on this CPU; and what a GPU of another machine is said to have done."""
    with pytest.MonkeyPatch.context() as patch, Store(tmp_path_factory.mktemp("store") / "results.sqlite") as opened:
        patch.setattr("softlab.bench.experiments.projections.QUICK_NEIGHBOURS", (4,))
        patch.setattr("softlab.bench.experiments.projections.QUICK_BUDGETS", ((10, 2), (10, 1)))
        patch.setattr("softlab.bench.measure.case_timing.SAMPLE_SECONDS", 0.002)
        summary = Projections()(opened, quick=True, backends=["cpu"], sizes=[4], progress=False)
        assert (summary.measured, summary.stored, summary.skipped) == (4, 0, [])
        again = Projections()(opened, quick=True, backends=["cpu"], sizes=[4], progress=False)
        assert (again.measured, again.stored) == (0, 4)
        yield opened


def test_a_rate_is_projections_over_the_median_step(store):
    found = Projections().rows(measures(store))
    assert len(found) == 4 and {p.neighbours for p in found} == {4}
    for point in found:
        scene = sheet(4, point.neighbours, point.ordering, point.substeps, point.iterations)
        assert point.scene.canonical() == scene.canonical()
        assert point.rate * point.step == pytest.approx(constraint_count(scene) * 10 * point.iterations)
        assert point.kernel
    steps = measures(store, Projections.step)
    (median,) = {m.value for m in steps if m.configuration == steps[0].configuration}
    rows = store.query(
        "SELECT seconds / steps FROM sample WHERE stage = ? AND configuration = ?",
        (Projections.stage, steps[0].configuration),
    )
    assert median == sorted(row[0] for row in rows)[len(rows) // 2]


def test_the_terminal_tells_this_machines_alone(store):
    here = Projections().rows(measures(store))[0]
    console = Console(width=80, record=True, file=io.StringIO())
    Projections().show(console, store, here.machine)
    printed = console.export_text(clear=False)
    assert printed.count("4 x 4 ") == 4 and f"{1e3 * here.step:.3g}" in printed and "…" not in printed
    Projections().show(console, store, "another machine")
    assert console.export_text().count("4 x 4 ") == 4


def _gpu_store(path) -> Store:
    """A machine with a GPU on which a published step takes a millisecond."""
    store = Store(path)
    store.add_machine("gpu", "Made-up machine; Made-up GPU", GPU_RECORD)
    run = store.start_run("gpu", "softlab projections", None)
    scenes = [(sheet(n, 12, "gauss-seidel", 10, 10), 1e-7 * n * n) for n in (32, 64, 128)]
    scenes += [(load_scene(name).replace(changes), 1e-3) for name, changes in PUBLISHED]
    for scene, step in scenes:
        case = case_of(scene, "gpu", "float32")
        store.add_measure(run, case.description, "s", Projections.step, step, "s", None)
        store.add_measure(
            run, case.description, "s", Projections.rate, Projections().work(case.scene) / step, "1/s", None
        )
    return store


def test_others_times_are_set_beside_ours(tmp_path):
    with _gpu_store(tmp_path / "gpu.sqlite") as store:
        results = load(store)
    claims = {name: claim(results) for name, claim in claims_of(Projections()).items()}
    assert not claims["projection-orderings"].supported  # Jacobi was not timed
    with settings():
        rates = draw(Projections(), results)
    assert rates.sources and labels(rates.figure) == LABELS["projections"]


def test_nothing_is_claimed_of_nothing(store):
    """Four masses a side are not what rates are told of."""
    results = load(store)
    claims = {name: claim(results) for name, claim in claims_of(Projections()).items()}
    assert claims["projection-orderings"].supported
    rates = claims["projection-rates"]
    assert not rates.supported and rates.sentence.endswith(".")


@pytest.mark.parametrize(
    "how", [{"sizes": [1]}, {"sizes": [10**30]}, {"precisions": ("float16",)}, {"backends": ["tpu"]}]
)
def test_what_cannot_be_timed_is_refused(tmp_path, how):
    with Store(tmp_path / "r.sqlite") as store, pytest.raises(SceneError):
        Projections()(store, progress=False, **how)
