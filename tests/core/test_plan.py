"""`softlab plan`: the stages of a step, what each moves, computes and takes, and what each backend makes of them."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.app.plan.report import PlanReport, flatten, plan_report
from softlab.app.plan.table import overhead_lines, tile_description
from softlab.gpu_backend.core.tiling import Tile
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.plan import Executor, Node, Plan, Stage
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import load_scene

SIZES = [(8, 8), (32, 32), (100, 100), (1000, 1000), (2048, 2048), (5, 100000)]


def grid(rows: int, columns: int, **changes: Any) -> Any:
    return load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns, **changes})


@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "rk4"])
def test_shares_make_a_whole_and_leaves_come_in_order(integrator: str) -> None:
    report = plan_report(grid(8, 8, **{"method.integrator": integrator}), "float64")
    found = report.as_dict()
    leaves = [row for row in found["stages"] if not row["branch"]]
    assert [row["name"] for row in leaves] == [stage.name for stage in report.plan.root.stages()]
    assert sum(row["bytes_share"] for row in leaves) == pytest.approx(1)
    assert sum(row["operations_share"] for row in leaves) == pytest.approx(1)
    assert found["bytes"] == sum(stage.bytes(8) for stage in report.plan.root.stages())
    assert set(found["backends"]) == {"cpu", "gpu"}


def test_a_branch_that_runs_several_times_lists_its_leaves_once() -> None:
    a, b, c = (Stage(name, 1, 1, 1) for name in "abc")
    rows, order = flatten(Node("step", (a, Node("substeps", (b, c), 3))))
    assert [(row.name, row.depth, row.runs) for row in rows] == [
        ("step", 0, 1), ("a", 1, 1), ("substeps", 1, 1), ("b", 2, 3), ("c", 2, 3),
    ]  # fmt: skip
    assert [rows[line].name for line in order] == ["a", "b", "c", "b", "c", "b", "c"]


def test_a_fused_pass_does_each_stage_of_the_scene() -> None:
    """One pass for one-force integrators and velocity Verlet, whose two forces are one; four for Runge-Kutta."""
    for integrator, passes in (("lab", 1), ("velocity-verlet", 1), ("rk4", 4)):
        scene = grid(8, 8, **{"method.integrator": integrator})
        (cpu,) = plan_report(scene, backends=("cpu",)).backends
        assert len(cpu.passes) == passes
        done = [name for one in cpu.passes for name in one.stages]
        assert set(done) == {stage.name for stage in mass_spring_plan(scene).root.stages()}
        assert done.count("spring forces") == passes
    (lab,) = plan_report(grid(8, 8), backends=("cpu",)).backends
    assert lab.passes[0].bytes == 32  # position and velocity, two axes, four bytes, read and written
    assert lab.passes[0].operations == mass_spring_plan(grid(8, 8)).operations


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", ["lab", "rk4"])
def test_the_cpu_kernel_told_is_the_one_opened(integrator: str, precision: str) -> None:
    scene = grid(6, 7, **{"method.integrator": integrator})
    (told,) = plan_report(scene, precision, backends=("cpu",)).backends
    with open_simulation(scene, precision=precision, threads=1) as simulation:
        assert told.kernel == simulation.kernel and told.device == simulation.device


@pytest.mark.parametrize("rows,columns", SIZES)
@pytest.mark.parametrize("integrator", ["lab", "rk4"])
def test_the_gpu_kernel_told_is_the_one_opened(
    rows: int, columns: int, integrator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a GPU the choice is that of the GPU the table was measured on, by the same code as on that GPU."""
    pytest.importorskip("numba.cuda", reason="needs numba-cuda")
    from softlab.gpu_backend.core import device
    from softlab.gpu_backend.mass_spring.grid import choice, tile_launch
    from softlab.gpu_backend.mass_spring.grid import solver as mass_spring

    if device.gpu_available()[0]:
        pytest.skip("here the choice is this GPU's")
    scene = grid(rows, columns, **{"method.integrator": integrator})
    (told,) = plan_report(scene, backends=("gpu",)).backends
    for module in (choice, tile_launch):
        monkeypatch.setattr(module, "device_limits", lambda: choice.MEASURED_LIMITS)
    opened: Any = SimpleNamespace(
        body=SimpleNamespace(rows=rows, columns=columns), scene=scene, real=np.float32, _is_rk4=integrator == "rk4",
        plan=mass_spring_plan(scene), options=SimpleNamespace(kernel=None),
    )  # fmt: skip
    mass_spring.MassSpring._choose_kernel(opened)
    assert (told.kernel, told.tile) == (opened.kernel, opened.tile and opened.tile.name)


def test_a_tiles_name_is_told_in_words() -> None:
    tile = Tile(32, 8, 4, 10)
    assert tile_description(tile.name) == (
        f"{tile.name}: a block of 32 columns of 8 threads, 4 masses each; blocks exchange masses every 10 steps"
    )
    assert tile_description(Tile(16, 16, 1).name).endswith("16 threads, 1 mass each")


def measured(report: PlanReport, backend: str) -> list[float]:
    return [row.seconds[backend] for row in report.rows if row.stage]


def test_every_stage_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    import softlab.app.plan.measure

    monkeypatch.setattr(softlab.app.plan.measure, "SECONDS", 0.2)
    report = plan_report(grid(16, 16, **{"external.magnitude": 0.1}), backends=("cpu",), measure=True)
    times = measured(report, "cpu")
    assert all(value > 0 for value in times)
    assert report.seconds("cpu") == pytest.approx(sum(times))
    (cpu,) = report.backends
    assert cpu.empty is not None and cpu.empty > 0
    assert cpu.step is not None and cpu.step > 0 and report.as_dict()["backends"]["cpu"]["step_seconds"] == cpu.step
    shares = [row["seconds_share"]["cpu"] for row in report.as_dict()["stages"] if not row["branch"]]
    assert sum(shares) == pytest.approx(1)


@pytest.mark.parametrize("empty, lines", [(0.4, 0), (0.6, 1)])
def test_shares_of_overhead_are_told(empty: float, lines: int) -> None:
    """Where a stage that does nothing takes more than half of the longest one, here 1 s a run."""
    report = plan_report(grid(8, 8), backends=("cpu",))
    for row in report.rows:
        if row.stage:
            row.seconds["cpu"] = row.runs * (1.0 if row.name == "damping" else 0.1)
    report = replace(report, backends=tuple(replace(one, empty=empty) for one in report.backends))
    assert len(overhead_lines(report)) == lines


def test_a_stage_that_does_more_takes_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not only the call is timed: on 250 000 masses four roots a mass take longer than adding gravity to it."""
    import softlab.app.plan.measure

    monkeypatch.setattr(softlab.app.plan.measure, "SECONDS", 0.3)
    report = plan_report(grid(500, 500), backends=("cpu",), measure=True)
    seconds = {row.name: row.seconds["cpu"] for row in report.rows if row.stage}
    assert seconds["spring forces"] > 1.5 * seconds["gravity"]


def test_a_backend_that_is_missing_is_said() -> None:
    from softlab.gpu_backend.core.device import gpu_available

    if gpu_available()[0]:
        pytest.skip("there is a GPU")
    (gpu,) = plan_report(grid(6, 6), backends=("gpu",)).backends
    assert "none on this machine" in gpu.device and not gpu.unmeasured
    with pytest.raises(BackendUnavailable):
        plan_report(grid(6, 6), backends=("gpu",), measure=True)


def test_a_cloth_is_told_in_three_dimensions() -> None:
    found = plan_report(load_scene("cloth-wind")).as_dict()
    assert found["dimensions"] == 3
    assert {"spring forces", "wind"} <= {row["name"] for row in found["stages"]}


def test_the_command_prints_one_object_or_a_table(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from softlab import cli

    def told(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["softlab", "plan", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code
        return capsys.readouterr().out

    found = json.loads(told("lab-grid", "--json", "--backend", "cpu", "--set", "method.integrator=rk4"))
    assert found["scene"] == "lab-grid" and set(found["backends"]) == {"cpu"}
    text = told("lab-grid", "--set", "external.magnitude=0.1")
    for word in ("external force", "limit dt", "kernel", "operations"):
        assert word in text


def test_an_infinite_limit_is_null() -> None:
    """JSON knows no infinity: a scene without springs and damping holds at any step size."""
    scene = load_scene("lab-grid").replace({"damping.coefficient": 0.0})
    report = plan_report(scene, backends=())
    report = PlanReport(scene, "float32", float("inf"), report.plan, report.rows, (), {})
    assert json.loads(json.dumps(report.as_dict(), allow_nan=False))["limit"] is None


def test_a_stage_is_told_its_step_substep_and_iteration() -> None:
    """Two substeps of three iterations: each stage as often as it runs, in the order of `stages`; 2 of 5 steps of 2 substeps
    come before."""
    iteration = Node("iteration", (Stage("project", 1, 1, 1),), 3)
    substep = Node("substep", (Stage("predict", 1, 1, 1, 0.5), iteration, Stage("update velocity", 1, 1, 1)), 2)
    plan = Plan(Node("step", (substep,)), 4)
    told = [(stage.name, at.step, at.substep, at.iteration, at.number) for stage, at in plan.moments(2)]
    once = [("predict", 0), *(("project", k) for k in range(3)), ("update velocity", 0)]
    assert told == [(name, 2, n, k, 4 + n) for n in range(2) for name, k in once]
    assert [name for name, *_ in told] == [stage.name for stage in plan.root.stages()]
    assert [at.argument for _, at in plan.moments(0)][:2] == [0.5, 0.0]
    assert [at.fresh for stage, at in plan.moments(0) if stage.name == "project"] == [True, False, False] * 2


def test_a_stage_that_nothing_runs_is_named() -> None:
    plan = mass_spring_plan(load_scene("lab-grid"))
    with pytest.raises(LookupError, match="stages of the plan that nothing runs: gravity, integrate"):
        Executor(plan, {name: lambda moment: None for name in ("spring forces", "damping", "pins")})
    assert Executor(plan, {}, lambda step, steps: None).fused is not None
