"""What iterations of a position-based solver leave: doubled until nothing changes, residuals, both errors of a run."""

import math

import numpy as np
import pytest
from test_accuracy_xpbd import GAUSS_SEIDEL, JACOBI, small, solved

from softlab.bench.experiments import growth as growth_module
from softlab.bench.experiments.accuracy import cases as accuracy_cases
from softlab.bench.experiments.accuracy import experiment as accuracy
from softlab.bench.experiments.accuracy import solver_error
from softlab.bench.experiments.accuracy.cases import make_case
from softlab.bench.experiments.accuracy.experiment import run_accuracy
from softlab.bench.experiments.accuracy.judgement import BALANCE, CONSTRAINT, SOLVER
from softlab.bench.experiments.accuracy.references import motion_of, references_for
from softlab.bench.experiments.accuracy.solver_error import (
    CHANGE_FRACTION,
    FLOOR,
    Iterated,
    next_residuals,
    solver_numbers,
)
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene
from softlab.plots.core.accuracy_points import points
from softlab.plots.core.read import load

EXACT = {"precision": "float64", "math": "exact"}


# ---------------------------------------------------------------------- the solver's error


class Pretended(Iterated):
    """Runs whose end is 1 m + 2^-iterations on every axis: the error of n iterations is 2^-n."""

    def __init__(self):
        super().__init__(None)
        self.asked: list[int] = []

    def end(self, scene: Scene, steps: int) -> np.ndarray:
        self.asked.append(scene.method.iterations)
        return np.full((scene.grid.particle_count, 2), 1 + 2.0**-scene.method.iterations)


def test_iterations_are_doubled_until_they_change_nothing():
    """From n on, until the last doubling is under SHARE of 2^-n: of n 1, the change from 16 to 32 is 2^-16, that from 8 to 16
    still 2^-8. Where n is good to rounding, one doubling shows it."""
    runs = Pretended()
    free = np.ones(36, bool)
    after, change, iterations = runs.converged(solved(small(), JACOBI, 1, 0.01), 10, free)
    assert iterations == 32 and set(runs.asked) == {1, 2, 4, 8, 16, 32}
    assert change == pytest.approx(math.sqrt(2) * 2.0**-16, rel=1e-4)
    assert change <= CHANGE_FRACTION * math.sqrt(2) / 2
    assert after[0, 0] == 1 + 2.0**-32
    runs = Pretended()
    _, change, iterations = runs.converged(solved(small(), JACOBI, 64, 0.01), 10, free)
    assert (change <= FLOOR, iterations) == (True, 128)


@pytest.mark.parametrize("name", [GAUSS_SEIDEL, JACOBI])
def test_iterations_leave_less_and_less(name, tmp_path):
    """S2 at 6 x 6, exact math: the solver's error and the residual of the constraints fall with the iterations. The balance
    stays where directions turn between iterates, under a quarter of what it balances, m g h^2. Ends are kept in the folder
    and read from it."""
    scene = small("S2")
    found = {}
    for iterations in (1, 4, 20):
        case = make_case("S2", solved(scene, name, iterations, 0.01), "cpu", **EXACT)
        with case.open() as simulation:
            simulation.advance(20)
            numbers = solver_numbers(case.scene, simulation.state(), 20, Iterated(tmp_path))
        found[iterations] = [numbers[key][0] for key in (SOLVER, CONSTRAINT, BALANCE)]
    assert found[1][0] > 3 * found[4][0] > 9 * found[20][0]
    assert found[1][1] > 3 * found[4][1] > 9 * found[20][1]
    assert found[20][2] < 0.25 * scene.grid.mass * 9.81 * 0.01**2
    kept = Iterated(tmp_path)
    assert list(tmp_path.glob("iterated-*.npz"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "softlab.bench.experiments.accuracy.solver_error.open_simulation", lambda *a, **k: pytest.fail("run again")
        )
        kept.end(solved(scene, name, 4, 0.01), 20)


def test_residuals_of_one_constraint_vanish():
    """One spring is solved by one iteration, exactly: both residuals are rounding, of 1 m and 0.01 kg."""
    scene = Scene(
        {
            "grid": {"rows": 2, "columns": 1, "pinned": "top"},
            "springs": {"stiffness": 10.0},
            "gravity": {},
            "method": {"solver": "xpbd", "dt": 0.01},
        }
    )
    case = make_case("", scene, "cpu", **EXACT)
    with case.open() as simulation:
        simulation.advance(7)
        constraint, balance = next_residuals(scene, simulation.state())
    assert constraint < 1e-14 and balance < 1e-16


def test_jobs_before_a_measurement_leave_all_that_it_is_compared_with(tmp_path, monkeypatch):
    """After them neither a reference nor a run with more iterations is computed, and the references are the same."""
    monkeypatch.setattr(accuracy, "end_of", lambda label: 0.05)
    monkeypatch.setattr(accuracy_cases, "end_of", lambda label: 0.05)
    case = make_case("S1", solved(small(), JACOBI, 1, 0.01), "cpu", "float64")
    compared = case.label, motion_of(case.scene), 0.05
    right, half, growth = references_for(*compared, None)
    jobs = accuracy._reference_jobs([case, case], tmp_path)
    assert len({job.kind for job in jobs}) == 2 and accuracy._reference_jobs([case], None) == []
    series = [
        (GAUSS_SEIDEL, 1),
        (GAUSS_SEIDEL, 4),
        (JACOBI, 1),
        (JACOBI, 4),
        (JACOBI, 20),
    ]  # a job for one that doubles
    several = [make_case("S1", solved(small(), *method, 0.01), "cpu", "float64") for method in series]
    assert len({job.kind for job in accuracy._reference_jobs(several, tmp_path)}) == 4
    for job in jobs:
        job.run()
    for module, name in ((cache, "converged"), (growth_module, "measure_growth"), (solver_error, "_end")):
        monkeypatch.setattr(module, name, lambda *_, **__: pytest.fail("computed again"))
    stored, stored_half, stored_growth = references_for(*compared, tmp_path)
    assert np.array_equal(stored.position, right.position) and np.array_equal(stored_half.position, half.position)
    assert np.array_equal(stored_growth.factors, growth.factors)
    free = build(case.scene).inverse_mass > 0
    assert Iterated(tmp_path).converged(case.scene, case.steps, free)[2] > 1


# ---------------------------------------------------------------------- into the store


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    """S1 in float64 with rk4 and Gauss-Seidel at three numbers of iterations."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accuracy_cases, "STEP_SIZES", (0.01,))
        patch.setattr(accuracy_cases, "XPBD_STEP_SIZES", (0.01,))
        patch.setattr(accuracy_cases, "ITERATIONS", (1, 4, 8))
        how = {"integrators": ["rk4", GAUSS_SEIDEL], "precisions": ["float64"], "backends": ["cpu"], "scenes": ["S1"]}
        with Store(tmp_path_factory.mktemp("accuracy") / "results.sqlite") as store:
            runs = [run_accuracy(store, quick=True, progress=False, **how) for _ in range(2)]
            return *runs, points(load(store).featured[0]), measures(store)


def test_two_errors_of_every_run(small_run):
    """Model and solver error: with one iteration at 10 ms the second is nearly all of the first, with eight nothing of it,
    and four leave the model's error as it is."""
    first, second, drawn, stored = small_run
    assert (first.measured, second.measured, second.stored) == (4, 0, 4)
    at = {(p.dt, p.iterations): p for p in first.points}
    free = math.sqrt(1024 / 992)  # RMS over the free masses instead of all
    assert at[0.01, 4].error == pytest.approx(4.69e-3 * free, rel=3e-3)
    assert at[0.01, 1].solver == pytest.approx(at[0.01, 1].error, rel=0.1)
    assert at[0.01, 8].solver < 1e-3 * at[0.01, 8].error
    assert at[0.01, 8].error == pytest.approx(at[0.01, 4].error, rel=0.02)
    assert at[0.01, None].solver is None
    residuals = {name: [m.value for m in stored if m.name == name] for name in (CONSTRAINT, BALANCE)}
    assert all(len(values) == 3 for values in residuals.values())
    assert min(residuals[CONSTRAINT]) > 0 and min(residuals[BALANCE]) >= 0
    assert "from its iterations" in str(at[0.01, 4])
    assert {(p.integrator, p.iterations, p.solver) for p in drawn} == {
        (p.integrator, p.iterations, p.solver) for p in first.points
    }
    assert {m.name for m in stored} >= {SOLVER, CONSTRAINT, BALANCE}
