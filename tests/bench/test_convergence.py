"""Convergence of the orderings: one step of a sheet drawn out, what it leaves, and how figures and sentences read it."""

import math

import numpy as np
import pytest
from read_figures import LABELS, labels, shown
from synthetic_store import CPU_RECORD, Maker

from softlab.bench.experiments import convergence
from softlab.bench.experiments.accuracy.methods import XPBD, changes
from softlab.bench.experiments.accuracy.points import CLOTHS
from softlab.bench.experiments.convergence import (
    FRAME,
    RIGID,
    RIPPLE,
    STRETCH,
    Convergence,
    drawn_out,
    residual,
    sheet,
)
from softlab.bench.measure.timing import Sample
from softlab.bench.reference import xpbd
from softlab.bench.store.database import Store
from softlab.labbook.claims import convergence as convergence_claims
from softlab.model.scene.scene import load_scene
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.figures import convergence as figure
from softlab.plots.figures.convergence import converging

SECONDS = {
    "xpbd gauss-seidel": 2e-4,
    "xpbd jacobi": 1e-4,
    "xpbd averaged-jacobi": 1e-4,
}  # an iteration, of a made-up clock


def test_the_start_is_drawn_out():
    """Vertical springs are longer by STRETCH, horizontal ones as they were, diagonals by sqrt((1 + (1 + STRETCH)^2) / 2) - 1:
    root mean square over as many as there are, without the ripple; with it the sheet is as high to its few millimetres."""
    scene = sheet(24, XPBD[0], 1)
    state = drawn_out(scene)
    rows = state.position.reshape(24, 24, 3)
    assert rows[-1, 0, 1] - rows[0, 0, 1] == pytest.approx((1 + STRETCH) * -2.3, abs=4 * RIPPLE)
    plain = scene.replace({"perturbation.amplitude": 0.0})
    diagonal = math.sqrt((1 + (1 + STRETCH) ** 2) / 2) - 1
    one, two = 24 * 23, 23 * 23
    expected = math.sqrt((one * STRETCH**2 + 2 * two * diagonal**2) / (2 * one + 2 * two))
    assert residual(plain, drawn_out(plain).position) == pytest.approx(expected, rel=1e-6)
    assert scene.method.dt == FRAME and all(scene.cloth_springs[kind].inextensible for kind in RIGID)


def test_colours_of_twelve_neighbours():
    assert convergence.colours() == 12


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """16 x 16 masses, up to eight iterations, on the CPU with a made-up clock: the results and the summaries."""
    with pytest.MonkeyPatch.context() as patch:

        def interleaved(subjects, repeats, _):
            for turn in range(max(repeats)):
                for subject in subjects:
                    method = subject.simulation.scene.method
                    seconds = SECONDS[method.name] * method.iterations
                    yield subject, Sample(10 * seconds * (1 + 0.001 * turn), 10, None)

        patch.setattr("softlab.bench.measure.samples.interleaved", interleaved)
        patch.setattr("softlab.bench.measure.timing.warm_up", lambda subject: (0.0, 0.0))
        patch.setattr("softlab.bench.measure.timing.choose_steps", lambda subject, *_: 10)
        patch.setattr(convergence, "SIZES", (16,))
        patch.setattr(convergence, "ITERATIONS", (1, 2, 8))
        with Store(tmp_path_factory.mktemp("convergence") / "results.sqlite") as store:
            runs = [Convergence()(store, quick=True, backends=["cpu"], progress=False) for _ in range(2)]
            return load(store), runs


def test_nothing_is_measured_twice(measured):
    _, (first, second) = measured
    assert (first.measured, second.measured, second.stored) == (3, 0, 3)
    assert str(first).startswith("convergence: 3 measured")


def test_what_a_step_leaves_is_the_references(measured):
    """Gauss-Seidel and averaged Jacobi against NumPy, float32 against float64: 2e-4 of the residual (masses at 2.4 m are
    known to 1e-7, springs of 0.1 m so to 1e-6 of their length, against stretches of 1e-2)."""
    results, _ = measured
    found = converging(results.featured[0], "cpu")
    assert len(found) == 9
    for name, ordering in ((XPBD[0], "gauss-seidel"), (XPBD[2], "averaged-jacobi")):
        scene = sheet(16, name, 8)
        begin = drawn_out(scene)
        ways = xpbd.of_scene(scene.replace({f"{kind}.stiffness": 1.0 for kind in RIGID}))
        stiff = np.isclose(ways.compliance, 1.0)  # the structural and shear ones
        ways = xpbd.Constraints(
            ways.first, ways.second, ways.rest_length, np.where(stiff, 0.0, ways.compliance), ways.damping, ways.colour
        )
        made = xpbd.substep(ways, begin.position, begin.velocity, 0.0, begin.inverse_mass, FRAME, 8, ordering)
        expected = residual(scene, made.position) / residual(scene, begin.position)
        mine = next(e for e in found if (e.name, e.iterations) == (name, 8))
        assert mine.left == pytest.approx(expected, rel=2e-4)


def test_iterations_leave_less(measured):
    found = converging(measured[0].featured[0], "cpu")
    for name in XPBD:
        left = [e.left for e in found if e.name == name]
        assert left[0] > left[1] > left[2] > 0
    assert {round(e.ratio, 6) for e in found if e.name == XPBD[1]} == {0.5}


def test_figure_and_sentence(measured):
    results, _ = measured
    with settings():
        drawing = figure.draw(results)
    assert isinstance(drawing, Drawing)
    assert labels(drawing.figure) == LABELS["convergence"]
    curves = {text.get_text() for text in drawing.figure.legends[0].get_texts()}
    assert set(XPBD) <= curves
    by_time = [shown(drawing.figure.axes[1].xaxis, one.get_xdata()) for one in drawing.figure.axes[1].lines]
    mine = [1000 * entry.seconds for entry in converging(results.featured[0], "cpu") if entry.name == XPBD[0]]
    assert any(len(x) and x == pytest.approx(mine) for x in by_time)  # in ms, as the axis says


def test_orderings_are_compared_at_equal_error():
    """On S4, in wall time a simulated second: Gauss-Seidel is 0.05 spacings off for 0.2 s, Jacobi for 0.6 s; 0.5 off for 0.1
    and 0.15 s."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "c")
    for name, costs in ((XPBD[0], (0.2, 0.1)), (XPBD[1], (0.6, 0.15))):
        for iterations, error, cost in ((20, 0.05, costs[0]), (4, 0.5, costs[1])):
            maker.point_of(load_scene(CLOTHS["S4"]).replace(changes(name, iterations)), error, cost)
    claim = convergence_claims.orderings(load(store))
    assert claim.numbers == pytest.approx({"cpu 1": 1.5, "cpu 0.3": 3.0, "cpu 0.1": 3.0}) and claim.supported
    assert "Jacobi takes 1.5 to 3.0" in claim.sentence and "12 colours" in claim.sentence


def test_without_measurements(tmp_path):
    with Store(tmp_path / "results.sqlite") as store:
        results = load(store)
    assert (
        figure.draw(results)
        == "the orderings of position-based solvers were not timed with several numbers of iterations"
    )
    for claim in convergence_claims.CLAIMS.values():
        made = claim(results)
        assert not made.supported and made.sentence.endswith(".")
