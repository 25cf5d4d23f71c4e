"""How fast fluids are: the cases, and what the store tells of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console

from softlab.bench.experiments import fluids
from softlab.bench.experiments.fluids import (
    FREE_PHASES,
    LARGE,
    PHASES,
    POOLS,
    Fluids,
    moved_bytes,
    operations,
    phase_name,
    pool,
)
from softlab.bench.measure import experiment
from softlab.bench.measure.case_timing import make_case
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.fluid.plan import fluid_plan
from softlab.model.scene.scene import load_scene


@pytest.mark.parametrize("count", [1000, 8000])
def test_pools_hold_what_they_are_called(count: int) -> None:
    scene = pool(count)
    assert fluids.count_of(scene) == count and Fluids().work(scene) == 6 * count
    assert all(nx * ny * nz == count and ny <= 20 for count, (nx, ny, nz) in (POOLS | LARGE).items())


def test_every_stage_of_the_plan_is_told() -> None:
    scene = pool(1000)
    assert list(dict.fromkeys(stage.name for stage in fluid_plan(scene).root.stages())) == list(PHASES)
    free = pool(1000, "divergence-free")
    assert list(dict.fromkeys(stage.name for stage in fluid_plan(free).root.stages())) == list(FREE_PHASES)
    assert Fluids().work(free) == 2 * Fluids().work(scene)
    assert all(moved_bytes(phase, 24.0) > 0 and operations(scene, phase) > 0 for phase in PHASES)
    assert all(moved_bytes(phase, 24.0) > 0 and operations(free, phase) > 0 for phase in FREE_PHASES)
    assert moved_bytes("density", 10.0) - moved_bytes("density", 0.0) == 40


def test_quick_is_a_part_of_the_whole() -> None:
    counts = {fluids.count_of(case.scene) for group in Fluids().groups(["cpu"], True, ("float32",)) for case in group}
    assert counts == set(fluids.QUICK) < set(POOLS) and not set(LARGE) & set(POOLS)


def test_what_is_stored_comes_back(tmp_path: Path) -> None:
    case = Fluids().groups(["cpu"], True, ("float32",))[0][0]
    with Store(tmp_path / "store.sqlite") as store:
        store.add_machine("here", "here", {})
        run = store.start_run("here", "softlab fluids")
        alone = {phase_name(phase): (1e-3 * n, "s", "alone") for n, phase in enumerate(PHASES, 1)}
        experiment.store_measures(store, run, case.description, case.sources, alone)
        numbers = Fluids().numbers(case.scene, 0.01, "fused")
        experiment.store_measures(store, run, case.description, case.sources, numbers)
        (point,) = Fluids().rows(measures(store, machine="here"))
        assert point.particles == 1000 and point.rate == pytest.approx(6e5) and point.kernel == "fused"
        assert point.phases == {phase: pytest.approx(1e-3 * n) for n, phase in enumerate(PHASES, 1)}
        assert point.scheme == "macklin"
        cup = make_case(load_scene(fluids.POUR), "cpu", "float32", "a cup that pours")
        told = {
            f"{fluids.IN_CUP}_2.0_s": (0.25, "", ""),
            f"{fluids.IN_BASIN}_2.0_s": (0.7, "", ""),
            fluids.LEVEL: (1.01, "", ""),
        }
        experiment.store_measures(
            store, run, cup.description, cup.sources, told | Fluids().numbers(cup.scene, 0.04, "fused")
        )
        console = Console(width=140, record=True)
        Fluids().show(console, store, "here")
        text = console.export_text()
        assert all(phase in text for phase in PHASES)
        assert all(word in text for word in ("0.2500", "0.7000", "0.0500", "1.0100"))
