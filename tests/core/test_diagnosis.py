"""The message of `Diverged`: step, particle, cause and remedy with its number."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.model.base.errors import Diverged
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS, damping_rate, frequency_bound
from softlab.model.core.stability.diagnosis import diagnose, refusal
from softlab.model.scene.scene import Scene, load_scene


def lab(**changes: object) -> Scene:
    return load_scene("lab-grid").replace({path.replace("__", "."): value for path, value in changes.items()})


def test_over_the_limit_by_what_factor():
    """0.1 s is 3.2 times 1/32 s; the message of a run says so, and that of the exception is one line."""
    scene = lab(method__dt=0.1)
    found = diagnose(scene, stability_limit(scene))
    assert found.cause == "dt is 3.2 times the stability limit of lab"
    assert found.remedy == "use dt <= 0.03125 s"
    text = str(Diverged(9, 4, 0.1, 0.03125, found.cause, found.remedy))
    assert text == "diverged at step 9, particle 4 (dt = 0.1 s): " + found.cause + "; use dt <= 0.03125 s"


def test_an_integrator_that_holds_farther_is_named():
    """taylor ends at 0.00075 s; of the same cost, velocity Verlet holds to 2 / w: the remedy that saves most."""
    scene = lab(method__dt=0.006, method__integrator="taylor")
    found = diagnose(scene, stability_limit(scene))
    reach = INTEGRATORS["velocity-verlet"].limit(frequency_bound(scene), damping_rate(scene))
    assert "8 times the stability limit of taylor" in found.cause
    assert found.remedy.startswith("use dt <= 0.00075 s, or velocity-verlet")
    assert f"holds to {reach:.6g} s" in found.remedy


def test_where_no_step_size_holds_another_integrator_does():
    scene = lab(method__integrator="explicit-euler", damping__coefficient=0.0)
    found = diagnose(scene, stability_limit(scene))
    assert "explicit-euler grows at every step size" in found.cause
    assert "velocity-verlet with dt <= 0.0223607 s" in found.remedy


@pytest.mark.parametrize(
    ("speed", "words", "remedy"), [(300.0, "3 spacings a step", 0.00167), (1.0, "too violent", 0.005)]
)
def test_under_the_limit_the_motion_is_looked_at(speed, words, remedy):
    """300 m/s at 0.01 s and 1 m: three spacings a step, of which half a one is allowed."""
    scene = lab(method__dt=0.01)
    found = diagnose(scene, stability_limit(scene), np.array([[0.0, -speed], [0.5, 0.0]], np.float32))
    assert "under the linear limit of 0.03125 s" in found.cause and words in found.cause
    assert f"dt <= {remedy:g} s" in found.remedy


def test_a_run_says_it(opened):
    """End to end, and under the limit, too: gravity of 1e12 m/s^2 throws a grid out of its world at any step size."""
    small = {"grid.rows": 4, "grid.columns": 4}
    for changes, words in (
        ({"method.dt": 0.1}, "3.2 times the stability limit of lab; use dt <= 0.03125 s"),
        ({"gravity.acceleration": 1e12}, "under the linear limit of 0.03125 s"),
    ):
        with opened(load_scene("lab-grid").replace(small | changes), kernel="stages") as simulation:
            simulation.check_interval = 256
            with pytest.raises(Diverged) as caught:
                simulation.advance(1000)
            assert words in str(caught.value) and caught.value.cause in str(caught.value)


@pytest.mark.parametrize(
    ("name", "path", "value", "factor"),
    [
        ("lab-grid", "grid.mass", 1e-300, 10), ("lab-grid", "springs.stiffness", 1e200, 0.1),
        ("cloth-hanging", "cloth.mass", 1e-300, 10), ("cloth-hanging", "structural.stiffness", 1e200, 0.1),
        ("cloth-mesh", "mesh.density", 1e-300, 10), ("lab-grid", "damping.coefficient", 1e200, 0.1),
    ],
)  # fmt: skip
def test_a_value_that_leaves_no_usable_step_is_named_with_one_that_holds(name, path, value, factor):
    """What is advised holds; a tenth of that mass, ten times that stiffness, does not."""
    scene = load_scene(name).replace({path: value})
    told = str(refusal(scene))
    assert f"{path} = {value:g} is too " in told
    advised = float(told.rpartition(f'scene.replace({{"{path}": ')[2].partition("}")[0])
    assert refusal(scene.replace({path: advised})) is None
    assert refusal(scene.replace({path: advised / factor})) is not None


def test_without_a_diagnosis_the_message_stays_whole():
    """As peers raise it, whose limits nobody knows."""
    assert "no stability limit is known" in str(Diverged(1, 2, 0.1, None))
    assert "no stability limit is known" in str(Diverged(0, 2, float("nan"), float("nan")))
    assert "use dt <= 0.02 s" in str(Diverged(1, 2, 0.1, 0.02))
