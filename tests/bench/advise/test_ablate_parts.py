"""What of a scene can be left out, the verdict on it in words, the reference of a random force."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_ablate import curtain

from softlab.bench.experiments.accuracy.references import stepped_force_converged
from softlab.bench.experiments.advise import ablation
from softlab.bench.experiments.advise.ablation import COARSER, FINER, FULL, INTEGRATOR, PART, Ablation, ablations
from softlab.bench.experiments.advise.ablation_results import GAINS, NEEDED, NOT_NEEDED, UNTOLD, Ablated, AblationRow
from softlab.bench.experiments.growth import MAX_GROWTH
from softlab.bench.reference import cache
from softlab.bench.reference.philox import random_directions
from softlab.model.base.errors import SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

# ---------------------------------------------------------------------- what can be left out


def names(scene: Scene, kind: str) -> list[str]:
    return [one.name for one in ablations(scene) if one.kind == kind]


def test_the_parts_that_do_something_can_be_dropped():
    """Forces and constraints of the scene, by its own names; not the masses, the start, the method, nor what is off."""
    assert names(curtain(), PART) == ["without springs", "without damping", "without gravity"]
    off = {"gravity.enabled": False, "damping.coefficient": 0.0, "external.magnitude": 0.0}
    assert names(curtain(off), PART) == ["without springs"]
    named = Scene({"net": {"kind": "grid", "rows": 2, "columns": 2}, "pull": {"kind": "gravity"}, "springs": {}})
    assert names(named, PART) == ["without pull", "without springs"]
    for one in ablations(named):
        if one.kind == PART:
            assert one.of(named).as_dict().keys() == named.as_dict().keys() - {one.spares}


def test_a_new_part_needs_nothing_here(monkeypatch):
    """Whatever other kinds a scene may get, all of them that a plan has a stage for are offered."""
    planned = []

    class Plan(list):
        pass

    def plan(scene):
        planned.append(scene)
        return Plan(sorted(scene.parts))

    monkeypatch.setattr(ablation, "scene_plan", plan)
    scene = curtain({"external.magnitude": 0.0})
    assert "without external" in names(scene, PART)
    assert len(planned) == 2 * len(names(scene, PART))


def test_what_makes_a_cloth_can_be_dropped():
    wanted = ["structural", "shear", "bending", "damping", "gravity", "wind"]
    assert names(load_scene("cloth-wind"), PART) == [f"without {name}" for name in wanted]
    assert {"without sphere", "without floor"} <= set(names(load_scene("cloth-sphere"), PART))


def test_cheaper_integrators_need_fewer_forces():
    assert names(curtain(), INTEGRATOR) == []
    cheaper = names(curtain({"method.integrator": "rk4"}), INTEGRATOR)
    assert cheaper == [name for name, one in INTEGRATORS.items() if one.forces < 4]
    assert len(cheaper) == 5


def test_arithmetic_and_step_sizes():
    scene = curtain()
    found = {one.name: one for one in ablations(scene)}
    assert (FULL.precision, FULL.math) == ("float64", "exact")
    assert (found["float32"].precision, found["float32"].math) == ("float32", "exact")
    assert (found["fast math"].precision, found["fast math"].math) == ("float64", "fast")
    assert found["dt 0.02 s"].of(scene).method.dt == 2 * scene.method.dt
    assert found["dt 0.005 s"].of(scene).method.dt == scene.method.dt / 2
    assert names(curtain({"external.magnitude": 0.1}), COARSER) == []
    assert FULL.of(scene).canonical() == scene.canonical()


def test_a_part_that_another_stands_on_is_not_optional(monkeypatch):
    def refuse(self, scene):
        raise SceneError("springs", None, "needed by another part")

    monkeypatch.setattr(Ablation, "of", refuse)
    assert names(curtain(), PART) == []


# ---------------------------------------------------------------------- the rule


def row(name="full scene", kind="full", error=1e-3, change=0.0, growth=1.0, estimate=1e-9, seconds=1.0) -> AblationRow:
    return AblationRow(name, kind, name, "", error, change, estimate, growth, 0.1, 0.2, seconds, None)


def table(full: AblationRow, *rows: AblationRow) -> Ablated:
    return Ablated("A scene", 0.01, "velocity-verlet", "cpu", 1.5, full, rows)


@pytest.mark.parametrize(
    ("full", "less", "verdict"),
    [
        (row(), row(kind=PART, error=1.9e-3, change=0.9e-3), NOT_NEEDED),
        (row(), row(kind=PART, error=2e-3, change=1.1e-3), NEEDED),
        (row(error=1e-9, estimate=1e-8), row(kind=PART, change=9e-8), NOT_NEEDED),  # under what the reference resolves
        (row(error=1e-9, estimate=1e-8), row(kind=PART, change=11e-8), NEEDED),
        (row(error=1e-16, estimate=0.0), row(kind=COARSER, change=1e-15), NOT_NEEDED),  # rounding
        (row(error=1e-16, estimate=0.0), row(kind=FINER, error=1e-17, change=1e-16), NOT_NEEDED),
        (row(error=math.inf, growth=2 * MAX_GROWTH), row(kind=PART, change=1e-9), UNTOLD),
        (row(error=math.inf, growth=math.nan), row(kind=PART, change=1e-9), UNTOLD),
        (row(error=math.inf, growth=2 * MAX_GROWTH), row(kind=PART, change=math.inf, error=math.inf), NEEDED),
        (row(), row(kind=FINER, error=2.5e-4, change=7.5e-4), GAINS),
        (row(), row(kind=FINER, error=1e-3, change=1e-5), NOT_NEEDED),  # an error that no longer falls
    ],
)
def test_the_verdict(full, less, verdict):
    assert table(full, less).verdict(less) == verdict


def test_the_sentence_is_made_from_the_data():
    rows = [
        replace(row("without wind", PART, change=5e-4, seconds=0.5), spares="wind"),
        replace(row("without gravity", PART, change=2.0), spares="gravity"),
        replace(row("without springs", PART, change=3.0), spares="springs"),
        replace(row("float32", "arithmetic", change=3e-6, seconds=0.98), spares="float64"),
        replace(row("euler", INTEGRATOR, change=1.0), spares="rk4"),
        replace(row("dt 0.02 s", COARSER, change=math.inf, error=math.inf, seconds=None), spares="dt 0.01 s"),
        replace(row("dt 0.005 s", FINER, error=2.5e-4, seconds=2.0), spares="dt 0.01 s"),
    ]
    assert table(row(), *rows).sentence() == (
        "A scene at dt 0.01 s with velocity-verlet, on the CPU, error 1.0e-03 spacings at 1.5 s: it needs springs "
        "and gravity, not wind (without it changes 5.0e-04, 2 times as fast); rk4 is needed (euler changes 1.0e+00); "
        "float32 is enough (changes 3.0e-06, saves nothing); dt 0.02 s is too long (diverges); dt 0.005 s would make the "
        "error 4 times smaller for 2 times the time."
    )
    doubtful = table(replace(row(), suspect="load"), *rows).sentence()  # no saving is told from times that may be wrong
    assert "times as fast" not in doubtful
    assert "times the time" not in doubtful
    assert "not wind (without it changes 5.0e-04)" in doubtful
    chaotic = table(row(growth=1e6, error=math.inf), *rows).sentence()
    assert "unknown what it needs at 1.5 s" in chaotic
    assert chaotic.endswith("it diverges dt 0.02 s.")


# ---------------------------------------------------------------------- a random force


def test_the_reference_of_a_random_force_is_the_closed_form():
    """Free masses under a force that is constant over each step: v += a dt, x += v dt + a dt^2 / 2, which RK4 solves
    exactly; 40 steps of rounding at 1 m are under 1e-13 m."""
    scene = Scene(
        {"grid": {"rows": 2, "columns": 3}, "external": {"magnitude": 0.2, "seed": 7}, "method": {"dt": 0.02}}
    )
    found = stepped_force_converged(scene, 40, None)
    x, v = np.zeros((6, 2)), np.zeros((6, 2))
    for step in range(40):
        a = 0.2 / 0.01 * random_directions(7, step, 6)
        x, v = x + v * 0.02 + a * 0.02**2 / 2, v + a * 0.02
    rest = np.array([(j, -i) for i in range(2) for j in range(3)], float)
    assert np.abs(found.position - rest - x).max() < 1e-13
    assert np.abs(found.velocity - v).max() < 1e-13
    assert np.abs(x).max() > 0.1


def test_without_a_random_force_the_reference_is_the_usual_one(tmp_path):
    scene = curtain()
    made = stepped_force_converged(scene, 30, tmp_path)
    usual = cache.cached_reference(scene, 0.3, None)
    assert made.estimate < cache.TOLERANCE
    assert np.abs(made.position - usual.position).max() < 2 * cache.TOLERANCE
    again = stepped_force_converged(scene, 30, tmp_path)
    assert np.array_equal(again.position, made.position)
    assert len(list(tmp_path.iterdir())) == 1
