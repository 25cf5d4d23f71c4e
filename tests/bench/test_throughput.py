"""How fast bodies are: the cases, what the store tells of them, the figure and the sentences made from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from read_figures import LABELS, labels
from synthetic_store import GPU_RECORD
from typer.testing import CliRunner

from softlab.bench.experiments import throughput
from softlab.bench.experiments.throughput import (
    Throughput,
    bodies,
    cube,
    heap,
    jelly,
    kind_of,
)
from softlab.bench.measure.case_timing import make_case
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.declared import claims_of
from softlab.model.base.errors import SceneError
from softlab.plots.core.declared import draw
from softlab.plots.core.read import load
from softlab.plots.core.style import settings


def test_the_scenes_are_what_they_are_called() -> None:
    """The issue's fifty bodies of 280 particles, ten thousand of them a heap of 2.8 million."""
    for scene, kind in (
        (bodies(50, False), "soft"),
        (bodies(50, True), "rigid"),
        (heap(50), "heap"),
        (jelly(64, 2), "grid"),
        (cube(8, 2), "lattice"),
    ):
        assert kind_of(scene) == kind
        if scene.bodies and kind != "lattice":
            assert len(scene.body_set.copies) == 50 and 13_900 < scene.body_set.particle_count < 14_200
    assert bodies(50, True).body_set.clusters.count == 50
    nx, ny, nz = throughput.BLOCKS[10000]
    assert nx * ny * nz == 10000
    assert heap(50).method.dt == pytest.approx(1 / 60) and heap(50).method.substeps == 2
    assert jelly(64, 2).method.region == 2 and jelly(64, 2).grid.particle_count == 4096
    assert (
        cube(8, 2).body_set.particle_count == 512
        and throughput.region_of(cube(8, 2)) == 2
        and not throughput.region_of(heap(50))
    )


def test_quick_is_a_part_of_the_whole_and_a_cpu_gets_no_ten_thousand() -> None:
    def cases(quick: bool) -> set[str]:
        return {c.scene.canonical() for g in Throughput().groups(["cpu"], quick, ("float32",)) for c in g}

    whole, quick = cases(False), cases(True)
    assert quick < whole and len(quick) == 9 and heap(50).canonical() in quick
    assert {len(g) for g in Throughput().groups(["cpu"], True, ("float32", "float64"), ["heap"])} == {2}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A small grid, really timed on this CPU."""
    with (
        pytest.MonkeyPatch.context() as patch,
        Store(tmp_path_factory.mktemp("throughput") / "results.sqlite") as opened,
    ):
        patch.setattr(throughput, "QUICK_GRIDS", (12,))
        summary = Throughput()(opened, quick=True, backends=["cpu"], kinds=["grid"], progress=False)
        assert (summary.measured, summary.skipped) == (3, [])
        yield opened


def test_a_rate_is_particles_over_the_median_substep(store: Store) -> None:
    found = Throughput().rows(measures(store))
    assert [p.region for p in found] == [1, 2, 4] and {p.particles for p in found} == {144}
    for point in found:
        assert point.rate * point.step == pytest.approx(144) and point.kernel and point.bodies == 0


def _made_up(path: Any) -> Store:
    """A machine with a GPU on which a free body's particle takes 1 ns, one in a heap 4, one of a grid 0.1 times its width,
    one of a cube 1 and a hundredth of it."""
    store = Store(path)
    store.add_machine("gpu", "Made-up machine; Made-up GPU", GPU_RECORD)
    run = store.start_run("gpu", "softlab throughput", None)
    scenes = [(bodies(50, False), 1e-9), (bodies(50, True), 1e-9), (heap(50), 8e-9)]
    scenes += [(jelly(64, region), 1e-10 * region) for region in throughput.REGIONS]
    scenes += [(cube(6, region), 1e-9 + 1e-11 * region) for region in throughput.REGIONS]
    for scene, each in scenes:
        case = make_case(scene, "gpu", "float32", "")
        numbers = Throughput().numbers(scene, each * scene.grid.particle_count, "graph")
        for name, (value, unit, reason) in numbers.items():
            store.add_measure(run, case.description, "s", name, value, unit, reason)
    return store


def test_what_is_claimed_and_drawn(tmp_path: Any) -> None:
    with _made_up(tmp_path / "gpu.sqlite") as made:
        (point,) = [p for p in Throughput().rows(measures(made)) if p.kind == "heap"]
        assert (point.bodies, point.kernel) == (50, "graph")
        results = load(made)
    found = {name: claim(results) for name, claim in claims_of(Throughput()).items()}
    assert all(claim.supported for claim in found.values())
    assert found["throughput-heaps"].numbers["gpu 50"] == pytest.approx(1 / (8e-9 * point.particles))
    assert found["throughput-contacts"].numbers["gpu 50"] == pytest.approx(4.0)
    with settings():
        drawing = draw(Throughput(), results)
    assert not isinstance(drawing, str) and drawing.sources
    assert labels(drawing.figure) == LABELS["throughput"]


def test_nothing_is_claimed_of_nothing(tmp_path: Any) -> None:
    with Store(tmp_path / "empty.sqlite") as empty:
        results = load(empty)
    for claim in claims_of(Throughput()).values():
        assert not claim(results).supported
    assert isinstance(draw(Throughput(), results), str)


def test_the_command_times_what_was_asked_for_once(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from softlab import cli

    monkeypatch.setattr(throughput, "QUICK_GRIDS", (12,))
    path = tmp_path / "results.sqlite"
    words = f"throughput --quick --backend cpu --kind grid --kind grid --precision float32 --store {path}".split()
    for said in ("3 timed, 0 already in the store", "0 timed, 3 already in the store"):
        done = CliRunner().invoke(cli.app, words)
        assert done.exit_code == 0 and said in done.output, done.output
    with Store(path, readonly=True) as opened:
        assert {(p.precision, p.particles, p.kind) for p in Throughput().rows(measures(opened))} == {
            ("float32", 144, "grid")
        }


def test_what_there_is_not_is_told(tmp_path: Any) -> None:
    with Store(tmp_path / "none.sqlite") as opened:
        with pytest.raises(SceneError, match="--kind"):
            Throughput()(opened, kinds=["gas"])
        with pytest.raises(SceneError, match=r"^precision = "):
            Throughput()(opened, precisions=["float16"])
