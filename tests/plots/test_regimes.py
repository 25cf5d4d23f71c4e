"""The map of who reaches an error fastest, read off its cells and its curve."""

from __future__ import annotations

import pytest
from read_figures import LABELS, labels, line
from synthetic_store import cpu_store

from softlab.plots.core.accuracy_points import Point
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.figures import regimes


def run(scene: str, integrator: str, dt: float, backend: str, error: float, seconds: float | None) -> Point:
    return Point(scene, integrator, dt, "float32", backend, error, None, seconds, seconds, seconds, True)


RUNS = [
    # 256 masses: the CPU is fastest to a coarse error, the GPU twice as soon to a fine one
    run("S1-16", "semi-implicit-euler", 0.02, "cpu", 0.05, 1.0), run("S1-16", "semi-implicit-euler", 0.02, "gpu", 0.05, 4.0),
    run("S1-16", "rk4", 0.01, "cpu", 0.002, 6.0), run("S1-16", "rk4", 0.01, "gpu", 0.002, 3.0),
    # 1024: as soon as each other; nobody but the GPU timed what is under 0.01
    run("S1", "semi-implicit-euler", 0.02, "cpu", 0.05, 2.0), run("S1", "semi-implicit-euler", 0.02, "gpu", 0.05, 2.1),
    run("S1", "rk4", 0.01, "cpu", 0.002, None), run("S1", "rk4", 0.01, "gpu", 0.002, 8.0),
    run("S1", "rk4", 0.02, "cpu", 0.009, 40.0),
]  # fmt: skip


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawing:
    monkeypatch.setattr(regimes, "points", lambda source, scene: [p for p in RUNS if p.scene == scene])
    with cpu_store() as store, settings():
        made = regimes.draw(load(store))
    assert isinstance(made, Drawing), made
    return made


def test_cells_say_who_is_fastest(drawn: Drawing) -> None:
    left, _ = drawn.figure.axes
    assert [label.get_text() for label in left.get_xticklabels()] == ["0.1", "0.01"]
    assert [label.get_text() for label in left.get_yticklabels()] == ["256", "1024"]
    told = {text.get_position(): text.get_text().split("\n") for text in left.texts}
    assert told[0, 0] == ["semi-implicit", "20 ms", "float32", "CPU (3x)"]
    assert told[1, 0] == ["rk4", "10 ms", "float32", "GPU (2x)"]
    assert told[0, 1][3] == "GPU = CPU"
    assert told[1, 1] == ["rk4", "10 ms", "float32", "GPU (5x)"]


def test_ratios_are_of_one_method_at_equal_error(drawn: Drawing) -> None:
    masses, ratios = line(drawn.figure.axes[1], "rk4")
    assert list(masses) == [256, 1024] and ratios == pytest.approx([2, 5], rel=0.02)
    assert labels(drawn.figure) == LABELS["regimes"]


def test_one_size_is_no_map() -> None:
    with cpu_store() as store:
        assert "several sizes" in str(regimes.draw(load(store)))
