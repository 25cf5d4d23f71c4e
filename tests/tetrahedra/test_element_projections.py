"""Tetrahedra projected a second: the cases, what they must take, what the store tells of them."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from softlab.bench.experiments.element_projections import (
    BARS,
    FREE,
    LARGE,
    MATERIALS,
    SWEPT,
    ElementProjections,
    bar,
    count_of,
    moved_bytes,
    operations,
)
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.errors import SceneError


@pytest.mark.parametrize("count", [400, 3200])
@pytest.mark.parametrize("sweep", ["voxels", "tetrahedra"])
def test_a_bar_has_as_many_tetrahedra_as_it_says(count: int, sweep: str) -> None:
    scene = bar(count, sweep, "neo-hookean")
    assert count_of(scene) == count == len(scene.tetrahedra_set.tetrahedra)
    assert ElementProjections().work(scene) == count * scene.method.substeps
    assert set(scene.tetrahedra_set.run) == {5 if sweep == "voxels" else 1}


def test_larger_bars_are_counted_without_being_cut() -> None:
    """266 000 are swept a hundred times a frame, as small ones are."""
    for count in BARS | SWEPT | LARGE:
        scene = bar(count, "voxels", "neo-hookean")
        assert count_of(scene) == count
        assert count not in SWEPT or (scene.method.substeps, scene.method.iterations) == (100, 1)


def test_small_steps_bar_is_among_them() -> None:
    """12 800 tetrahedra, 100 substeps of a frame of 1/60 s."""
    scene = bar(12800, "voxels", "fixed-corotated")
    assert (scene.method.substeps, scene.method.iterations) == (100, 1)


def test_what_a_tetrahedron_must_take() -> None:
    """36 bytes of values, without a damper's; 4 of a corner's index and 32 of the corner, read and written, of which a voxel
    of five has eight, not twenty."""
    assert moved_bytes("tetrahedra", "float32") == 36 + 4 * (4 + 32)
    assert moved_bytes("voxels", "float32") == pytest.approx(36 + 8 * (4 + 32) / 5)
    assert moved_bytes("voxels", "float64") == pytest.approx(72 + 8 * (4 + 64) / 5)
    assert 100 < operations("neo-hookean", "float32") < operations("fixed-corotated", "float32") < 2000


def test_quick_is_a_part_of_the_whole() -> None:
    every, quick = (
        {
            case.scene.canonical()
            for group in ElementProjections().groups(["cpu"], quick, ("float32",))
            for case in group
        }
        for quick in (False, True)
    )
    assert quick < every and len(every) == len(BARS | SWEPT) * len(MATERIALS) * 2 + len(FREE) * 2
    most = ElementProjections().groups(["gpu"], False, ("float32",))[-1]
    assert {case.scene.tetrahedra["bar"].sweep for case in most} == {"voxels"}


def test_rates_are_kept_and_told(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softlab.bench.experiments.element_projections.QUICK_BARS", (400,))
    monkeypatch.setattr("softlab.bench.experiments.element_projections.SMALL_STEPS", 1)
    monkeypatch.setattr("softlab.bench.measure.case_timing.SAMPLE_SECONDS", 0.002)
    with Store(tmp_path / "results.sqlite") as store:  # type: ignore[operator]
        summary = ElementProjections()(store, quick=True, backends=["cpu"], progress=False)
        assert (summary.measured, summary.skipped) == (2, [])
        assert ElementProjections()(store, quick=True, backends=["cpu"], progress=False).stored == 2
        found = ElementProjections().rows(measures(store))
        assert [(p.tetrahedra, p.sweep) for p in found] == [(400, "tetrahedra"), (400, "voxels")]
        assert all(p.rate * p.step == pytest.approx(400) for p in found)
        console = Console(width=120, record=True, file=io.StringIO())
        ElementProjections().show(console, store, summary.machine)
    text = console.export_text()
    assert text.count("neo-hookean") >= 2 and "limits in float32" in text and "%" in text


def test_sheets_have_sizes_and_bars_do_not(tmp_path: object) -> None:
    from softlab.bench.declared_commands import command_function
    from softlab.bench.experiments.registry import experiments

    projections = command_function(experiments("projections"))
    given = {"quick": True, "size": [8], "tetrahedra": True, "backend": None, "precision": None, "store": tmp_path}
    with pytest.raises(SceneError, match="--size = 8: does not apply to --tetrahedra"):
        projections(**given)
