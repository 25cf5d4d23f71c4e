"""Figures: what is drawn, what is marked, what is left out with a reason; and energies over time.

The stores are made up (tests/tools/synthetic_store.py), so every expected number follows from a law written there.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from synthetic_store import CPU_RECORD, GPU_RECORD, STEPS, Maker, cpu_store, gpu_store

from softlab.bench.store.database import Store
from softlab.bench.store.transfer import export
from softlab.model.base.errors import InputError
from softlab.plots.core import bandwidth, pairs
from softlab.plots.core.accuracy_points import observed_order, order_points, points, reaching
from softlab.plots.core.colours import BLACK, GREY
from softlab.plots.core.data import Results, is_suspect, is_wrong
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.draw import FIGURES, TITLES, draw_figures, figures_folder
from softlab.plots.figures import crossover, time_per_step, work_precision
from softlab.plots.figures.scaling.threads import baseline

# What the made-up stores hold. The others are drawn by test_hard.py, test_findings.py, test_ablate.py, test_bar.py,
# test_throughput.py, test_fluid_figures.py, test_gpu_figure.py.
ELSEWHERE = (
    "hard-",
    "findings-",
    "ablation",
    "convergence",
    "projections",
    "bar-",
    "throughput",
    "regimes",
    "tetrahedra",
    "fluids-",
    "gpus",
)
MADE_UP = [name for name in FIGURES if not name.startswith(ELSEWHERE)]


@pytest.fixture(scope="module")
def cpu() -> Store:
    return cpu_store()


@pytest.fixture(scope="module")
def gpu() -> Store:
    return gpu_store()


@pytest.fixture(scope="module")
def gpu_csv(gpu: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(gpu, tmp_path_factory.mktemp("committed") / "gpu.csv")


def labels(drawing) -> set[str]:
    return {text.get_text() for legend in drawing.figure.legends for text in legend.get_texts()}


def one_timing(seconds: float = 1e-5, **options) -> Results:
    """The results of a store with one CPU configuration."""
    store = Store(":memory:")
    how = {"backend": "cpu", "threads": 2, "layer": "omp", "wait_policy": "passive"}
    Maker(store, CPU_RECORD, "one").timing((16, 16), seconds, **how, **options)
    return load(store)


# ---------------------------------------------------------------------- files


def test_figures_are_files_of_vectors_and_of_pixels(
    gpu: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What each figure shows is looked at in test_figure_axes.py: here, that what is drawn is what lies on disk."""
    names = ["time-per-step", "lab-step"]
    for name in set(FIGURES) - {*names, "ablation"}:
        monkeypatch.delitem(FIGURES, name)
    made = draw_figures(load(gpu), figures_folder(tmp_path / "figures"))
    paths = [path for figure in made for path in figure.paths]
    assert {path.name for path in paths} == {f"{name}.{suffix}" for name in names for suffix in ("svg", "png")}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        path.name for path in paths
    }  # no temporary file
    for name in names:
        vectors = (tmp_path / "figures" / f"{name}.svg").read_text(encoding="utf-8")
        assert TITLES[name] in vectors and vectors.count("<path") > 50 and "abc123def456" in vectors
        pixels = np.asarray(Image.open(tmp_path / "figures" / f"{name}.png").convert("RGB"))
        assert pixels.shape[1] == round(6.3 * 160) and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20


def test_equal_results_give_equal_bytes(cpu: Store, tmp_path: Path) -> None:
    with settings():
        from softlab.plots.core.files import save

        for name in ("a", "b"):
            (tmp_path / name).mkdir()
            save(time_per_step.draw(load(cpu)), tmp_path / name, "figure")
    for suffix in ("svg", "png"):
        assert (tmp_path / "a" / f"figure.{suffix}").read_bytes() == (tmp_path / "b" / f"figure.{suffix}").read_bytes()


def test_a_figure_that_the_data_do_not_hold_has_a_reason_and_leaves_no_old_file(
    cpu: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in set(FIGURES) - {"crossover", "time-per-step"}:
        monkeypatch.delitem(FIGURES, name)
    old = tmp_path / "crossover.svg"
    old.write_text("from an earlier run")
    found = {figure.name: figure for figure in draw_figures(load(cpu), tmp_path)}
    assert found["crossover"].paths == ()
    assert "GPU" in (found["crossover"].reason or "")
    assert not old.exists()
    assert len(found["time-per-step"].paths) == 2


def test_an_empty_store_gives_reasons_only(tmp_path: Path) -> None:
    found = draw_figures(load(Store(":memory:")), tmp_path)
    assert all(figure.reason and not figure.paths for figure in found)


def test_folders_and_stores_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made"):
        figures_folder(tmp_path / "file")
    with pytest.raises(InputError, match="cannot be made"):
        figures_folder(tmp_path / "missing" / "folder")
    with pytest.raises(InputError, match="no such store"):
        load(tmp_path / "none.sqlite")


# ---------------------------------------------------------------------- what is shown


@pytest.mark.parametrize("name", MADE_UP)
def test_captions_name_machine_and_commit(name: str, gpu: Store) -> None:
    with settings():
        drawing = FIGURES[name](load(gpu))
    assert not isinstance(drawing, str), drawing
    assert "Made-up GPU" in drawing.caption
    assert "abc123def456" in drawing.caption
    assert "  " not in drawing.caption


def test_curves_of_the_first_figure(gpu: Store) -> None:
    with settings():
        drawing = time_per_step.draw(load(gpu))
    assert labels(drawing) == {"1x threads", "2x threads", "4x threads", "GPU", "GPU, one thread per mass"}


def test_committed_curves_are_grey_and_labelled(cpu: Store, gpu_csv: Path) -> None:
    with settings():
        drawing = time_per_step.draw(load(cpu, [gpu_csv]))
    assert "committed: Made-up GPU" in labels(drawing)
    light = [line for line in drawing.figure.axes[0].lines if str(line.get_label()).startswith("committed")]
    assert light and all(line.get_color() == GREY for line in light)
    assert "Committed measurements: Made-up CPU, 16 cores; Made-up GPU" in drawing.caption


def test_without_own_measurements_the_committed_ones_are_the_figure(gpu_csv: Path) -> None:
    results = load(None, [gpu_csv])
    assert results.featured == results.sources and not results.background
    with settings():
        assert "GPU" in labels(time_per_step.draw(results))


def test_suspect_points_are_hollow() -> None:
    results = one_timing(suspect="load: other programs ran on the cores in use")
    assert is_suspect(results.featured[0].timings[0])
    with settings():
        drawing = time_per_step.draw(results)
    assert "suspect" in labels(drawing)
    assert any(line.get_markerfacecolor() == "white" for line in drawing.figure.axes[0].lines)


@pytest.mark.parametrize(
    "wrong",
    [{"error": math.inf}, {"suspect": "load: x; wrong answer: 3 spacings off"}, {"suspect": "state not finite: y"}],
)
def test_a_wrong_answer_is_a_cross_and_belongs_to_no_curve(wrong: dict) -> None:
    results = one_timing(**wrong)
    assert is_wrong(results.featured[0].timings[0])
    with settings():
        drawing = time_per_step.draw(results)
    assert "wrong answer" in labels(drawing)
    assert "1x threads" not in labels(drawing)
    crosses = [line for line in drawing.figure.axes[0].lines if line.get_marker() == "x" and len(line.get_xdata())]
    assert [line.get_color() for line in crosses] == [BLACK]


def test_a_wrong_answer_wins_nothing() -> None:
    """The fast wrong GPU does not overtake, and the fast wrong thread count is not the CPU's best."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g")
    for threads, seconds, error in ((16, 1e-3, 1e-5), (32, 1e-9, math.inf)):
        maker.timing((64, 64), seconds, backend="cpu", threads=threads, layer="omp", wait_policy="passive", error=error)
    maker.timing((64, 64), 1e-4, backend="gpu")
    maker.timing((128, 128), 1e-3, backend="cpu", threads=16, layer="omp", wait_policy="passive")
    maker.timing((128, 128), 1e-9, backend="gpu", error=math.inf)
    (pair,) = crossover.pairs(load(store).featured[0])
    assert pair.gpu.particles == 64 * 64
    assert pair.ratio == pytest.approx(10)


def test_times_of_a_simulated_gpu_are_not_drawn() -> None:
    store = Store(":memory:")
    Maker(store, CPU_RECORD, "c").timing((16, 16), 1.0, backend="gpu", suspect="CUDA simulator, no GPU")
    assert load(store).sources[0].timings == () if load(store).sources else True
    with settings():
        assert isinstance(time_per_step.draw(load(store)), str)


def test_curves_hold_one_scene_and_one_wait_policy() -> None:
    """A scene timed at one size, and a few times under another policy, would bend a curve that is about size."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    maker.sweep((16, 32), graphics=False)
    before = load(store).featured[0].timings
    maker.timing((16, 16), 9.0, backend="cpu", threads=2, layer="omp", wait_policy="active")
    source = load(store).featured[0]
    assert source.timings == before
    assert source.threading == ("omp", "passive")


# ---------------------------------------------------------------------- the numbers behind figures


def test_the_crossing_is_where_two_power_laws_meet() -> None:
    """CPU 1 ns a mass, GPU 1 us: they meet at 1000 masses, and log-log interpolation of power laws is exact."""
    store = Store(":memory:")
    maker = Maker(store, GPU_RECORD, "g", wobble=0.01)
    for n in (16, 64):
        maker.timing((n, n), 1e-9 * n * n, backend="cpu", threads=16, layer="omp", wait_policy="passive")
        maker.timing((n, n), 1e-6, backend="gpu")
    found = crossover.pairs(load(store).featured[0])
    assert crossover.crossing(found) == pytest.approx(1000, rel=1e-9)
    assert crossover.crossing(list(reversed(found))) is None


def test_fraction_of_the_copy_bandwidth(gpu: Store) -> None:
    """32 B a mass and step; the made-up GPU runs at 0.8 of its bandwidth after 2 us."""
    source = load(gpu).featured[0]
    last = source.select("gpu")[-1]
    seconds = 2e-6 + 32 * last.particles / (0.8 * 4e12)
    assert bandwidth.fraction(source, last) == pytest.approx(32 * last.particles / seconds / 4e12)


def test_shapes_are_held_against_squares_of_as_many_masses(cpu: Store) -> None:
    source = load(cpu).featured[0]
    ratios = {(t.rows, t.columns): t.median / square for t, square in pairs.shape_ratios(source, "cpu", "1x")}
    assert ratios[32, 128] == pytest.approx(1) and ratios[128, 32] == pytest.approx(1)  # 64 x 64 was timed
    assert ratios[100, 100] == pytest.approx(1, abs=0.1)  # between 64 x 64 and 128 x 128
    assert set(ratios) == {(32, 128), (128, 32), (100, 100)}


def test_pairs_of_precisions_and_baselines(cpu: Store) -> None:
    source = load(cpu).featured[0]
    assert baseline(source) == "1x"
    assert all(single.particles == double.particles for single, double in pairs.float64_pairs(source, "cpu", "1x"))


def test_accuracy_points(cpu: Store) -> None:
    source = load(cpu).featured[0]
    found = points(source, "S1")
    assert {p.scene for p in points(source)} == {"S1", "S2"}
    assert {p.dt for p in found} == set(STEPS)
    lab, rk4 = order_points(found, "lab"), order_points(found, "rk4")
    assert observed_order([(p.dt, p.error) for p in lab]) == pytest.approx(0, abs=1e-9)
    assert observed_order([(p.dt, p.half or 0.0) for p in lab]) == pytest.approx(1)
    assert observed_order([(p.dt, p.error) for p in rk4]) == pytest.approx(4)
    assert observed_order([(0.01, 1.0)]) is None
    able = reaching(found, 1e-3)
    assert able[0].integrator == "velocity-verlet" and able[0].dt == 0.01
    assert all(p.error <= 1e-3 for p in able)


def test_diverged_runs_stand_at_the_edge(cpu: Store) -> None:
    with settings():
        drawing = work_precision.draw(load(cpu))
    assert not isinstance(drawing, str)
    ax = drawing.figure.axes[0]
    assert any(text.get_text() == "diverged" for text in ax.texts)
    finite = [p.error for p in points(load(cpu).featured[0], "S1") if not p.diverged]
    assert max(x for line in ax.lines for x in np.atleast_1d(line.get_xdata())) == pytest.approx(3 * max(finite))


def test_no_figure_uses_global_state() -> None:
    for file in (Path(__file__).parents[2] / "plots").rglob("*.py"):
        assert not re.search(r"pyplot|^import matplotlib|^from matplotlib", file.read_text(), re.MULTILINE), file.name
