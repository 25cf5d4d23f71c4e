"""The scene of stiff and soft springs in turn (B1): its limit, why it diverges, and what it is told to do."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.experiment import case_scene
from softlab.bench.stress.laws import hanging
from softlab.model.base.errors import Diverged
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.stability.diagnosis import CAUSES, Diagnosis, diagnose, refusal
from softlab.model.core.stability.limit import frequency_lines, scene_frequency
from softlab.model.scene.scene import Scene, load_scene

NAMES = list(INTEGRATORS)


# ---------------------------------------------------------------------- B1: refused, diverged, settled


def b1(**changes: object) -> Scene:
    return load_scene("hard/b1").replace({path.replace("__", "."): value for path, value in changes.items()})


def test_the_published_limit():
    """NUMERICS: 3.2e-5 s for semi-implicit Euler, 2 / sqrt(4 k / m); the plan also tells what this chain itself holds to,
    4.5e-5 s, since no mass has two stiff links: w^2 = 2 (k + r k) / m."""
    scene = b1(damping__coefficient=0.0)
    assert stability_limit(scene) == pytest.approx(2 / sqrt(4 * 1e7 / 0.01), rel=1e-12)
    (line,) = frequency_lines(scene)
    assert "63245.6 1/s of any grid" in line and "semi-implicit-euler holds to dt 4.4721" in line
    assert scene_frequency(scene).estimate == pytest.approx(sqrt(2 * (1e7 + 10) / 0.01), rel=1e-6)


def test_the_door_names_ratio_step_size_and_the_way_out():
    error = refusal(b1())
    assert error is not None and error.limit == stability_limit(b1())
    text = str(error)
    assert text.startswith(
        "method.dt = 0.01: stiffness ratio 1e+06: dt is 316.2 times the stability limit of semi-implicit-"
    )
    assert "which the springs of 1e+07 N/m set; those of 10 N/m alone hold to 0.0308817 s" in text
    assert "use dt <= 3.1622e-05 s, or a stiffness ratio of at most 9.84" in text
    assert text.endswith("or pass allow_unstable=True to run it anyway")
    assert refusal(b1(method__dt=3e-5)) is None
    assert refusal(b1(springs__stiffness_ratio=9.84)) is None and refusal(b1(springs__stiffness_ratio=9.86)) is not None


def test_soft_springs_over_the_limit_are_not_blamed_on_the_stiff_ones():
    """At 0.1 s the soft links would not hold either; equal springs have no ratio; explicit Euler undamped has no limit."""
    for scene, name in (
        (b1(), "stiffness ratio"),
        (b1(method__dt=0.1), "explicit limit"),
        (b1(springs__stiffness_ratio=1.0, method__dt=0.1), "explicit limit"),
        (b1(method__integrator="explicit-euler", damping__coefficient=0.0), "no step size"),
        (b1(method__dt=1e-6), "violent forces"),
    ):
        assert diagnose(scene, stability_limit(scene)).name == name
    plain = refusal(b1(method__dt=0.1))
    assert plain is not None and "over the stability limit of semi-implicit-euler here" in str(plain)


def test_a_solver_brings_causes_of_its_own():
    """The first that applies is told, under its name; the lab's own follow."""
    seen = []

    def inverted(at):
        seen.append(at.position)
        return Diagnosis("element 3 is inverted", "use more substeps") if at.position is not None else None

    causes = {"inverted element": inverted} | CAUSES
    found = diagnose(b1(), stability_limit(b1()), position=np.zeros((21, 2)), causes=causes)
    assert (found.name, found.cause) == ("inverted element", "element 3 is inverted")
    assert diagnose(b1(), stability_limit(b1()), causes=causes).name == "stiffness ratio"
    assert len(seen) == 2
    assert diagnose(b1(), 1.0, causes={}).remedy == "use dt <= 0.005 s"


@pytest.mark.parametrize(
    ("name", "kernel", "precision"),
    [
        ("semi-implicit-euler", "stages", "float64"),
        ("velocity-verlet", "fused", "float64"),
        ("lab", "stages", "float32"),
    ],
)
def test_forced_it_ends_as_diverged_with_the_cause(opened, name, kernel, precision):
    """Never as NaN: the state that is left is finite, the message one line with the ratio and both numbers. (The other
    integrators: `softlab hard`.)"""
    scene = b1(method__integrator=name)
    with opened(scene, kernel=kernel, precision=precision, live=("damping", "gravity")) as simulation:
        simulation.check_interval = 64
        with pytest.raises(Diverged, match=r"stiffness ratio 1e\+06: dt is .* use dt <= ") as caught:
            simulation.advance(200)
        assert 1 <= caught.value.step <= 64 and caught.value.limit == stability_limit(scene)
        state = simulation.state()
        assert np.isfinite(state.position).all() and np.isfinite(state.velocity).all()


def test_the_chain_hangs_by_its_soft_links():
    """Ten soft links carry 20, 18, ..., 2 masses: 110 m g / k = 1.07910 m; the stiff ones a millionth of 100 of them."""
    scene = b1()
    stretch = -hanging(scene)[-1, 0, 1] - 20
    assert stretch == pytest.approx(110 * 0.0981 / 10 + 100 * 0.0981 / 1e7, rel=1e-12)
    position = hanging(scene)
    force = reference.spring_forces(scene, position)[1:, 0, 1] - 0.0981
    assert np.abs(force).max() < 1e7 * 2.0**-52 * 32  # N: an ulp of 21 m, twice, in a stiff link


@pytest.mark.parametrize("name", NAMES)
def test_cases_run_under_their_limit_or_are_refused(name):
    refused, hangs = [case for case in CASES if case.row == "B1" and name in case.methods]
    assert case_scene(refused, name)[0].method.dt == 0.01
    scene, note = case_scene(hangs, name)
    assert 0.85 * stability_limit(scene) < scene.method.dt < stability_limit(scene) and "over the limit" in note
