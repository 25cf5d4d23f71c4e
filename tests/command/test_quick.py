"""`--quick` of hard, projections, throughput and bar: each keeps what it is for, and needs few kernels, which take the time.

A kernel is told apart by what its machine code depends on; nothing is compiled or measured here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from softlab.bench.experiments import bar, projections, throughput
from softlab.bench.experiments.bar_strip import FREQUENCY, SAG, SHARED, method_of, strip
from softlab.bench.experiments.body_laws import DROP, SPIN, law_scene
from softlab.bench.store.database import Store
from softlab.bench.stress import experiment as hard
from softlab.bench.stress.cases import CASES
from softlab.model.core.families import scene_plan
from softlab.model.fluid.plan import fluid_plan
from softlab.model.scene.scene import Scene

MACHINE = "a machine"


def kernel_of(scene: Scene, live: Iterable[str] = ()) -> tuple[Any, ...]:
    """What the machine code of a scene's kernel depends on, but for precision and math."""
    method, plan = scene.method, scene_plan(scene, frozenset(live))
    return method.solver, method.name, method.iterations > 1, plan.dimensions, plan.parts, method.region


def known_machine(monkeypatch: pytest.MonkeyPatch) -> Store:
    store = Store(":memory:")
    store.add_machine(MACHINE, "label", {})
    monkeypatch.setattr("softlab.bench.measure.experiment.enter_machine", lambda store: MACHINE)
    return store


def test_hard_has_every_case_of_forces_in_one_precision_and_eight_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(hard, "_judge", lambda store, summary, work, *_: asked.append(work))
    with known_machine(monkeypatch) as store:
        hard.run_hard(store, quick=True, backends=["cpu"], pictures=False, progress=False)
        quick = list(asked)
        asked.clear()
        hard.run_hard(store, quick=True, precisions=["float32"], cases=["B24"], backends=["cpu"], pictures=False)
    assert {work.precision for work in asked} == {"float32"}, "what is asked for by name is done"
    assert {work.precision for work in quick} == {"float64"} and {work.method for work in quick} == set(hard.QUICK)
    *sheets, fluid = hard.QUICK
    both = {case.name for case in CASES if set(sheets) <= set(case.methods)}
    wet = {case.name for case in CASES if fluid in case.methods and case.quick}
    assert {work.case.name for work in quick} == both | wet and len(quick) == 2 * len(both) + len(wet)
    assert {fluid_plan(work.case.base(), frozenset(hard.LIVE)).parts for work in quick if work.case.of_fluids} == {
        frozenset({"gravity", "walls", "plane", "box", "swept"})
    }, "fluids share one kernel"
    scenes = [work for work in quick if work.case.name != "B24 empty" and not work.case.of_fluids]
    found = {kernel_of(hard.case_scene(work.case, work.method)[0], hard.LIVE) for work in scenes}
    assert len({(*key[:4], key[4] - {"pins"}) for key in found}) <= 8


def test_projections_have_two_sizes_two_orderings_and_four_kernels() -> None:
    quick, whole = (
        [case for group in projections.Projections().groups(["cpu"], q, ("float32",)) for case in group]
        for q in (True, False)
    )
    assert {str(case.description) for case in quick} < {str(case.description) for case in whole}
    found = [case.scene for case in quick]
    assert len({scene.grid.rows for scene in found}) == 2 and {s.method.ordering for s in found} == set(
        projections.ORDERINGS
    )
    assert len({kernel_of(scene) for scene in found}) == 4


def test_throughput_leaves_the_lattice_out_unless_it_is_asked_for() -> None:
    one = throughput.Throughput()
    asked = [
        {throughput.kind_of(case.scene) for group in groups for case in group}
        for groups in (
            one.groups(["cpu"], quick, **one.picked({"kinds": kinds}, quick))
            for quick, kinds in ((True, None), (True, ["lattice"]), (False, None))
        )
    ]
    assert asked == [{"soft", "rigid", "heap", "grid"}, {"lattice"}, set(throughput.KINDS)]


def test_strips_that_hang_and_that_swing_share_a_kernel() -> None:
    for solver, iterations in bar.SOLVERS.values():
        method = method_of(solver, 4, iterations)
        assert kernel_of(strip(8, method, SAG)) == kernel_of(strip(8, method, FREQUENCY), SHARED)


def test_the_bar_has_every_solver_and_few_regions() -> None:
    quick, whole = set(bar.settings(True)), set(bar.settings())
    assert quick < whole and {name for name, *_ in quick} == set(bar.SOLVERS)
    assert {region for *_, region in quick} == set(bar.QUICK_REGIONS)
    found = {
        kernel_of(strip(8, method_of(*bar.SOLVERS[name][:1], 4, bar.SOLVERS[name][1], r))) for name, _, _, r in quick
    }
    assert len(found) == len(bar.SOLVERS) + len(bar.QUICK_REGIONS) - 1


def test_laws_of_bodies_share_a_kernel() -> None:
    """Two: the spin is a rigid body's, which keeps its momenta by a stage of its own; the other laws are of soft bodies."""
    assert len({kernel_of(law_scene(law, 4), SHARED[:1]) for law in bar.LAWS}) == 2
    assert len({kernel_of(law_scene(law, 4), SHARED[:1]) for law in bar.LAWS if law != SPIN}) == 1
    quick = [e.description for e in bar.experiments("cpu", True) if e.description.get("law") == DROP]
    assert quick and {description["precision"] for description in quick} == {"float64"}
