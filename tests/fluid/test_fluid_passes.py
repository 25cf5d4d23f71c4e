"""The passes of a fluid's substep: both backends run those that are declared, in that order."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
from flow_scenes import FLOWS
from fluid_scenes import SCENES
from solid_scenes import DevicePlaces, fluid_scene, samples_of

from softlab.app.driver import open_simulation
from softlab.bench.keys.record import fake_gpu, recorded
from softlab.cpu_backend.fluid.passes import fused_passes, phases_of
from softlab.gpu_backend.core import device
from softlab.model.core.simulation import Options
from softlab.model.fluid import passes
from softlab.model.fluid.passes import Iterations, Pass, chosen, runs_of
from softlab.model.fluid.plan import fluid_parts, fluid_plan, substep_of
from softlab.model.scene.scene import Scene

SORT = ["span", "hash_particles", "chunks", "totals", "fill", "arrange"]
COUNTED = ["due", "rank", "totals", "emit", "arrive"]
LAUNCHED = {  # kernels of passes, and of those that one kernel does
    (passes.EMIT,): COUNTED, (passes.PREDICT,): ["begin"], (passes.SORT,): SORT, (passes.FIND,): ["find", "factors"],
    (passes.FIND, passes.DENSITY): ["prepare"], (passes.DENSITY,): ["density"], (passes.CORRECT,): ["correct"],
    (passes.CORRECT, passes.UPDATE): ["settle"], (passes.CORRECT, passes.UPDATE, passes.LIMIT): ["settle"],
    (passes.SHAPE,): ["shape"], (passes.LIMIT,): ["smooth"], (passes.GATHER,): ["bound"], (passes.SURVEY,): ["survey"],
    (passes.RELAX,): ["relax"], (passes.PUSH_APART,): ["push"], (passes.TAKE_UP,): ["take_up"],
    (passes.ACCELERATE,): ["accelerate"], (passes.FORESEE,): ["foresee"], (passes.MOVE,): ["move"],
}  # fmt: skip
ALL = SCENES | FLOWS


def launched_of(scene: Scene) -> dict[tuple[str, ...], list[str]]:
    """The kernels of each pass of a scene."""
    parts, names = fluid_parts(scene), dict(LAUNCHED)
    if scene.flows:
        names[(passes.SORT,)] = ["span", "take", *SORT[2:], "rest"]
    if scene.domain:
        names[(passes.GATHER,)] = ["gather", "bound"]
    if parts & passes.SMOOTHING:
        names[(passes.ACCELERATE,)] = ["smooth", "accelerate"]
    return names


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A GPU that launches nothing; the launches so far."""
    pytest.importorskip("cuda.bindings.runtime")
    if os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("0", ""):
        pytest.skip("the simulator has no dispatcher whose launches could be recorded")
    monkeypatch.setattr(device, "_probe", lambda: ("", "no GPU"))  # whose answer is kept
    with fake_gpu(), recorded() as calls:
        yield calls


def names_of(calls: list[Any]) -> list[str]:
    """The kernels' names, without their content."""
    return [call.kernel.py_func.__name__.rpartition("_")[0] for call in calls]


@pytest.mark.parametrize("name", ALL)
def test_a_gpu_launches_the_declared_passes(name: str, no_gpu: list[Any]) -> None:
    """Each once, in their order, alone or by the fused kernel that is declared to replace them; and so many launches are
    foreseen."""
    from softlab.gpu_backend.fluid.passes import fused_passes as fused_on_gpu

    scene = ALL[name]()
    with open_simulation(scene, "gpu", math="exact", kernel="launch") as simulation:
        parts, launched = simulation.plan.parts, launched_of(scene)
        runs = runs_of(substep_of(parts), scene.method.iterations, fused_on_gpu(parts))
        start = len(no_gpu)
        simulation._launch(simulation._current, 1)
        assert (
            names_of(no_gpu[start:])
            == [kernel for run in runs for kernel in launched[run.passes]] * scene.method.substeps
        )
        assert simulation._launches == len(no_gpu) - start
        assert all(any(run.passes == fused for run in runs) for fused in fused_on_gpu(parts)), (
            "a kernel replaces nothing"
        )


def test_a_fluid_among_solids_launches_the_declared_passes(no_gpu: list[Any]) -> None:
    """In the three parts that a world drives."""
    from softlab.gpu_backend.fluid.among_solids import FluidAmongSolids

    scene = fluid_scene()
    samples, solid, _ = samples_of(scene)
    options = Options(precision="float32", math="exact", kernel="launch")
    with FluidAmongSolids(scene, options, samples, DevicePlaces(solid.astype(np.float32))) as fluid:
        start = len(no_gpu)
        fluid._substep(0, 0)
        names = names_of(no_gpu[start:])
        assert fluid._launches == len(names) * scene.method.substeps
    begin = ["begin", "sample", "bound", *SORT, "find", "gather", "factors"]
    each = ["follow", "density", "correct", "push"]
    assert names == [*begin, *each * scene.method.iterations, "update", "shape", "smooth"]


@pytest.mark.parametrize("name", ALL)
def test_the_plan_and_the_cpu_have_the_declared_passes(name: str) -> None:
    """In the plan each as often as it runs; on the CPU each has phases, and every fused phase replaces some passes."""
    scene = ALL[name]()
    parts, method = fluid_parts(scene), scene.method
    plain = runs_of(substep_of(parts), method.iterations)
    assert [(stage.name, at.iteration) for stage, at in fluid_plan(scene).moments(0) if at.substep == 0] == [
        (run.passes[0], run.iteration) for run in plain
    ]
    runs, phases = runs_of(substep_of(parts), method.iterations, fused_passes(parts)), phases_of(parts)
    assert [one for run in runs for one in run.passes] == [run.passes[0] for run in plain]
    assert all(phases[run.passes] for run in (*runs, *plain))
    assert all(any(run.passes == fused for run in runs) for fused in fused_passes(parts)), "a phase replaces nothing"


def test_runs_of_passes_are_replaced_where_they_follow_one_another() -> None:
    a, b, c, d = (Pass(name) for name in "abcd")
    substep = a, Iterations((b, c), 2.0), d
    names = [
        ("".join(run.passes), run.iteration, run.argument) for run in runs_of(substep, 2, (("a", "b"), ("c", "d")))
    ]
    assert names == [("ab", 0, 0.0), ("c", 0, 2.0), ("b", 1, 2.0), ("cd", 1, 2.0)]
    assert ["".join(run.passes) for run in runs_of(substep, 2, (("c",), ("c", "b")))] == ["a", "b", "cb", "c", "d"]
    needed, left_out = Pass("e", needs=frozenset("x")), Pass("f", without=frozenset("y"))
    assert chosen((needed, left_out), frozenset("y")) == () and chosen((needed, left_out), frozenset("x")) == (
        needed,
        left_out,
    )
