"""Axes say what is drawn: every figure's words against a table, and curves, read off by the numbers beside the ticks, against
the laws by which the made-up measurements were made (tests/tools/synthetic_store.py), in the unit that the axis names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from read_figures import LABELS, labels, line, number, shown
from synthetic_store import (
    GPU_RECORD,
    SIZES,
    STEPS,
    WATTS,
    Maker,
    cpu_seconds,
    gpu_seconds,
    gpu_store,
    kernel_seconds,
)  # fmt: skip

from softlab.bench.experiments.findings import experiment as findings
from softlab.bench.store.database import Store
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.draw import FIGURES, TITLES
from softlab.plots.figures.energies import EnergyRecord, energy_drawing

ELSEWHERE = {  # figure -> the file whose test holds its labels to the table
    "findings-determinism": "test_findings_costs.py",
    "regimes": "test_regimes.py",
    "convergence": "test_convergence.py",
    "ablation": "test_ablate.py",
    "projections": "test_projections.py",
    "throughput": "test_throughput.py",
    **dict.fromkeys(["tetrahedra", "tetrahedra-decides", "tetrahedra-total"], "test_tetrahedra_experiment.py"),
    "tetrahedra-mesh": "test_tetrahedra_meshes.py",
    **dict.fromkeys(["hard-states", "hard-verdicts"], "test_hard.py"),
    "hard-bodies": "test_hard_bodies.py",
    **dict.fromkeys(["bar-solvers", "bar-clusters"], "test_bar_told.py"),
    "bar-costs": "test_bar_costs.py",
    **dict.fromkeys(["fluids-truth", "fluids-phases", "fluids-rest"], "test_fluid_figures.py"),
    "gpus": "test_gpu_figure.py",
}
LARGE = (*SIZES, 1024, 2048, 4096)
GPU_SQUARES = np.array(sorted([n * n for n in LARGE] + [100 * 100]), float)  # of the sweep
RUNGS = np.array([n * n for n in LARGE], float)  # of forced kernels
STEPS_MS = 1000 * np.sort(STEPS)
GRAPH, STAGES = (
    np.array([kernel_seconds(GPU_RECORD, "gpu", name, int(n), "float32") for n in RUNGS])
    for name in ("graph", "stages")
)
LIMITS = [
    stability_limit(load_scene("lab-curtain").replace({"grid.rows": 8, "grid.columns": 8, "method.integrator": "lab", **at}))
    for at in ({"springs.stiffness": 1.0}, {"springs.stiffness": 10.0})
]  # fmt: skip


@cache
def measured() -> Results:
    return load(gpu_store())


@cache
def drawn(name: str) -> Any:
    with settings():
        drawing = FIGURES[name](measured())
    assert not isinstance(drawing, str), drawing
    return drawing.figure


def gpu(precision: str = "float32") -> np.ndarray:
    return np.array([gpu_seconds(GPU_RECORD, int(n), precision) for n in GPU_SQUARES])


def cpu(threads: int) -> np.ndarray:
    return np.array([cpu_seconds(GPU_RECORD, threads, int(n), "float32") for n in GPU_SQUARES])


def fastest_cpu() -> np.ndarray:
    return np.min([cpu(threads) for threads in (16, 32, 64)], axis=0)


# figure, panel, curve -> x and y as read off the axes
CURVES: list[tuple[str, int, str, Sequence[float], Callable[[], Any]]] = [
    ("time-per-step", 0, "GPU", GPU_SQUARES, gpu),
    ("time-per-step", 0, "4x threads", GPU_SQUARES, lambda: cpu(64)),
    ("thread-scaling", 0, "2x threads", GPU_SQUARES, lambda: cpu(16) / cpu(32)),
    ("crossover", 0, "float32", GPU_SQUARES, lambda: fastest_cpu() / gpu()),
    ("graphics", 0, "GPU, with graphics", GPU_SQUARES, lambda: gpu() + 2e-4 + 4e-9 * GPU_SQUARES),
    ("lab-step", 0, "semi-implicit-euler", STEPS_MS, lambda: 1e-2 * STEPS_MS / 10),
    ("lab-step", 1, "rk4", STEPS_MS, lambda: 2e-5 * (STEPS_MS / 10) ** 4),
    ("kernels", 1, "stages", RUNGS, lambda: STAGES),
    ("roofline", 1, "graph", RUNGS, lambda: 100 * 32 * RUNGS / 4e12 / GRAPH),
    ("joules", 0, "graph", RUNGS, lambda: 1e6 * WATTS * GRAPH / RUNGS),
    ("peers", 1, "CUDA C++ in a graph", [n * n for n in SIZES], lambda: [2] * len(SIZES)),
    ("peers-sheets", 1, "CUDA C++ in a graph", [n * n for n in SIZES], lambda: [2] * len(SIZES)),
    ("findings-float32", 1, "lab, float32", sorted(findings.OFFSETS),
     lambda: [1e-5 * (1 + offset / 100) for offset in sorted(findings.OFFSETS)]),
]  # fmt: skip


@pytest.mark.parametrize("curve", CURVES, ids=[f"{name} {label}" for name, _, label, *_ in CURVES])
def test_curves_are_what_the_axes_say(curve: Any) -> None:
    """To 2 %: ticks at 0.156 ms say 0.16; what the curves are made of is exact."""
    name, panel, label, x, y = curve
    found_x, found_y = line(drawn(name).axes[panel], label)
    order = np.argsort(found_x)
    np.testing.assert_allclose(found_x[order], x, rtol=0.02)
    np.testing.assert_allclose(found_y[order], y(), rtol=0.02)


def test_every_figure_has_a_title_and_labels_that_a_test_looks_at() -> None:
    assert set(FIGURES) == set(LABELS) == set(TITLES)
    for name, file in ELSEWHERE.items():
        assert f'LABELS["{name}"]' in next(Path(__file__).parents[1].rglob(file)).read_text(encoding="utf-8"), name


@pytest.mark.parametrize("name", sorted(set(LABELS) - set(ELSEWHERE)))
def test_axes_have_their_labels(name: str) -> None:
    assert labels(drawn(name)) == LABELS[name]


def test_speed_against_error_is_read_off_its_axes() -> None:
    """Points of rk4 on the GPU in float64: its error, and 4 evaluations of 2 us a step."""
    ax = drawn("work-precision").axes[1]
    points = {
        (float(shown(ax.xaxis, x[0])), float(shown(ax.yaxis, y[0])))
        for one in ax.lines if len(x := one.get_xdata()) == 1 for y in [one.get_ydata()]
    }  # fmt: skip
    for dt in STEPS:
        error, seconds = 2e-5 * (dt / 0.01) ** 4, 4 * 2e-6 / dt
        assert any(x == pytest.approx(error) and y == pytest.approx(seconds) for x, y in points), dt


def test_the_map_of_stability_is_read_off_its_axes() -> None:
    """The analytic limit in seconds, beside stiffnesses of 1 and 10 N/m."""
    ax = drawn("stability-stiffness").axes[list(INTEGRATORS).index("lab")]
    limit, edge = ax.lines
    np.testing.assert_allclose(shown(ax.xaxis, limit.get_xdata()), LIMITS)
    rows = dict(zip(ax.get_yticks(), (number(tick.get_text()) for tick in ax.get_yticklabels()), strict=True))
    assert [rows[place] for place in limit.get_ydata()] == [1, 10]
    assert edge.get_xdata()[0] > limit.get_xdata()[0]  # springs without rest length hold to more


def test_time_ticks_say_seconds() -> None:
    """12.5 ms: one timing whose axis is read without the figure's own law."""
    store = Store(":memory:")
    how = {"backend": "cpu", "threads": 2, "layer": "omp", "wait_policy": "passive"}
    Maker(store, GPU_RECORD | {"cores": 2}, "one").timing((16, 16), 0.0125, **how)
    with settings():
        ax = FIGURES["time-per-step"](load(store)).figure.axes[0]  # type: ignore[union-attr]
    x, y = line(ax, "1x threads")
    assert (x, y) == (pytest.approx([256]), pytest.approx([0.0125]))


def test_energies_are_joules_over_seconds() -> None:
    time = np.array([0.0, 0.5, 1.0, 2.0])
    record = EnergyRecord(load_scene("lab-grid"), time, 3 * time, time**2, -2 * time, 5 + time, 5 + 0 * time)
    with settings():
        figure = energy_drawing(record).figure
    assert labels(figure) == [("time / s", "energy / J")]
    for name, values in (("total", record.total), ("kinetic", record.kinetic), ("in the springs", record.spring)):
        x, y = line(figure.axes[0], name)
        np.testing.assert_allclose(x, time)
        np.testing.assert_allclose(y, values)


@pytest.mark.parametrize("width", [3.3, 6.3])
def test_the_strip_of_a_figure_is_no_wider_than_the_figure(width: float) -> None:
    """Sentences about machines and commits consist of digits and capitals in good part."""
    from textwrap import wrap

    import matplotlib.pyplot as plt

    from softlab.plots.core.style import FOOTER_SIZE, LETTER, settings

    sentence = (
        "Committed measurements, NVIDIA H200: 26564 of its 26572 numbers are older than this code (1e405d5bab8c, "
    )
    with settings():
        figure = plt.figure(figsize=(width, 3))
        for line in wrap(8 * sentence, int(72 * width / (LETTER * FOOTER_SIZE))):
            box = figure.text(0.995, 1.0, line, fontsize=FOOTER_SIZE, ha="right", va="bottom").get_window_extent()
            assert box.x0 >= 0, line
        plt.close(figure)
