"""The small experiments behind single sentences: measured on a small grid, held against theory, drawn and told."""

import math

import numpy as np
import pytest

from softlab.bench.experiments.findings import experiment as findings
from softlab.bench.experiments.findings.experiment import (
    AWAY,
    DAMPERS,
    DAMPING,
    DISSIPATION,
    FLOOR,
    RATE,
    Findings,
    amplitude_rate,
)
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.findings import CLAIMS
from softlab.model.core.integrators import INTEGRATORS, amplification_matrix
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import observed_order
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.findings import float32 as findings_float32
from softlab.plots.findings.points import exact_pairs, rows

OMEGA = math.sqrt(10 / 0.01)  # 1/s, of A3


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Everything on 8 x 8 with few variants, run twice: (store, first, second)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            findings, "load_scene", lambda name: load_scene(name).replace({"grid.rows": 8, "grid.columns": 8})
        )
        patch.setattr(findings, "FLOOR_METHODS", ("rk4",))
        patch.setattr(findings, "FLOOR_STEPS", (0.02, 0.01, 0.005, 0.0003))
        patch.setattr(findings, "PRECISIONS", ("float32",))
        patch.setattr(findings, "AWAY_METHODS", ("lab",))
        patch.setattr(findings, "EXACT_SIZES", (8, 16))
        patch.setattr(findings, "EXACT_METHOD", "lab")
        with Store(tmp_path_factory.mktemp("findings") / "results.sqlite") as store:
            runs = [Findings()(store, quick=True, backends=["cpu"], progress=False) for _ in range(2)]
            yield (store, *runs)


@pytest.fixture(scope="module")
def results(measured):
    return load(measured[0])


def test_nothing_is_measured_twice(measured):
    _, first, second = measured
    assert first.measured > 40
    assert first.stored == 0
    assert (second.measured, second.stored, second.run) == (0, first.measured, "")


def test_dissipation_is_that_of_the_eigenvalues(measured):
    """A3: -ln |eigenvalue| / dt of every integrator and step size, to 1e-6 of it (RK4 1 - z^6/144 a step); symplectic
    steps, the hand-out's among them, keep the amplitude to rounding."""
    found = [m for m in measures(measured[0], RATE) if m.description["finding"] == DISSIPATION]
    assert len(found) == len(INTEGRATORS) * len(findings.RATE_STEPS)
    for measure in found:
        method = measure.description["scene"]["method"]
        name, dt = method["integrator"], method["dt"]
        modulus = np.abs(np.linalg.eigvals(amplification_matrix(name, dt, OMEGA, 0.0))).max()
        rate = -math.log(modulus) / dt
        assert measure.value == pytest.approx(rate, rel=1e-5, abs=1e-11)
        if name in ("lab", "semi-implicit-euler", "velocity-verlet"):
            assert abs(measure.value) < 1e-11
        if (name, dt) == ("rk4", 0.01):
            assert math.exp(-measure.value * dt) == pytest.approx(0.9999931423, abs=1e-10)


def test_amplitude_rate_by_hand():
    """x = e^(-0.3 t) cos(7 t), every 0.01 s."""
    t = 0.01 * np.arange(60)
    assert amplitude_rate(np.exp(-0.3 * t) * np.cos(7 * t), 0.01) == pytest.approx(0.3, rel=1e-9)


def test_an_explicit_damper_costs_an_order(results):
    """C: velocity Verlet with explicit damping is first order, with implicit damping second (20 ms, 0.9 of its limit, is
    too coarse for an order)."""
    found = [row for row in rows(results.sources[0], DAMPING) if row.dt <= 0.01]
    orders = [observed_order([(r.dt, r.value) for r in found if r.scheme == scheme]) for scheme in DAMPERS]
    assert orders == pytest.approx([2, 1], abs=0.1)


def test_float32_has_a_floor(results):
    """RK4 in float32: fourth order no more once rounding decides; the smallest steps are worse than larger ones."""
    values = {row.dt: row.value for row in rows(results.sources[0], FLOOR)}
    assert values[0.02] > 5 * values[0.01]
    assert values[0.0003] > values[0.005]


def test_far_from_the_origin(results):
    """B14: the error grows with the offset; at the origin it is that of float32."""
    values = [row.value for row in rows(results.sources[0], AWAY)]
    assert values[0] < 1e-4 < values[-1]


def test_exact_is_timed_beside_fast(results):
    (fast, exact), *_ = exact_pairs(results.sources[0], "cpu", "float32")
    assert (fast.math, exact.math, fast.particles) == ("fast", "exact", 64)
    assert fast.count >= 3


@pytest.mark.parametrize("name", list(CLAIMS))
def test_every_claim_is_a_sentence(results, name):
    """With the measurements and without any: a whole sentence, and nothing supported that was not measured."""
    for those in (results, Results(())):
        claim = CLAIMS[name](those)
        assert claim.sentence.endswith(".")
        assert "nan" not in claim.sentence.lower()
        if name != "cloth-limit" and not those.sources:
            assert not claim.supported
            assert "not measured" in claim.sentence


def test_what_the_claims_say(results):
    damping, dissipation = CLAIMS["verlet-damping"](results), CLAIMS["dissipation"](results)
    assert damping.supported
    assert "an order is lost" in damping.sentence
    assert dissipation.supported
    assert "lab, semi-implicit-euler and velocity-verlet keep it to rounding" in dissipation.sentence
    cloth = CLAIMS["cloth-limit"](results)
    assert cloth.numbers["taylor"] == pytest.approx(5.208e-6, rel=1e-3)  # docs/method/cases.md, fact 3
    assert cloth.numbers["better"] == pytest.approx(2.04e-3, rel=1e-3)
    assert cloth.numbers["ratio"] == pytest.approx(391, abs=1)


@pytest.mark.parametrize("figure", [findings_float32])
def test_every_figure_is_drawn_or_says_why_not(results, figure):
    with settings():
        drawing = figure.draw(results)
        assert isinstance(drawing, Drawing)
        drawing.figure.canvas.draw()
        assert drawing.caption
    assert isinstance(figure.draw(Results(())), str)
