"""A sheet of position-based solvers on several ranks has the bits of one: a substep reads as far as its iterations lead."""

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import RankSimulation
from softlab.model.core.options import Options
from softlab.model.domains.simulation import cut
from softlab.model.scene.scene import load_scene
from softlab.model.xpbd.reach import period, substep_rows

KINDS = ("structural", "shear", "bending")
GRID = {"grid.rows": 21, "grid.columns": 4, "perturbation.amplitude": 0.05, "method.solver": "xpbd"}
CLOTH = {"cloth.rows": 32, "cloth.columns": 5, "method.dt": 0.01}

CASES = [  # scene, what is changed, ranks, steps between exchanges, kernel; halo, parts in which a step is done
    ("cloth-small-steps", CLOTH | {"method.ordering": "gauss-seidel", "method.substeps": 4}, 2, None, None, 8, 4),
    ("cloth-small-steps", CLOTH | {"method.ordering": "gauss-seidel", "method.substeps": 2}, 2, 1, "stages", 12, 1),
    ("cloth-small-steps", CLOTH | {"method.ordering": "jacobi", "method.substeps": 4}, 3, None, None, 4, 4),
    ("cloth-small-steps", CLOTH | {"method.substeps": 1, "method.iterations": 3}, 2, 1, None, 8, 1),
    ("cloth-small-steps", CLOTH | {"method.ordering": "averaged-jacobi", "method.substeps": 2}, 2, 2, None, 10, 1),
    ("cloth-wind", CLOTH | {"method.solver": "xpbd", "method.substeps": 2}, 2, None, None, 8, 2),
    ("cloth-sphere", CLOTH | {"method.solver": "pbd", "method.substeps": 2}, 2, None, None, 8, 2),
    ("lab-grid", GRID | {"springs.stiffness_ratio": 3.0, "method.substeps": 3}, 3, 1, None, 6, 1),
    ("lab-grid", GRID | {"springs.stiffness_ratio": 3.0, "method.ordering": "jacobi"}, 2, None, None, 2, 1),
]


def state(simulation, steps):
    """After some steps, in two calls."""
    simulation.advance(steps // 2)
    simulation.advance(steps - steps // 2)
    return simulation.state()


@pytest.mark.parametrize("name, changes, ranks, every, kernel, halo, divided", CASES)
def test_ranks_have_the_bits_of_one(name, changes, ranks, every, kernel, halo, divided):
    scene, steps = load_scene(name).replace(changes), 3
    found = cut(scene, ranks, every, "--ranks")
    assert (found.halo, found.divided) == (halo, divided)
    with open_simulation(scene, threads=1, math="exact", kernel=kernel) as one:
        wanted = state(one, steps)

    def program(ranks):
        with RankSimulation(scene, Options(math="exact", kernel=kernel), ranks, 1, every) as simulation:
            assert simulation.whole_steps == (1 if divided % 2 == 0 else 2 * (every or 1))
            return state(simulation, steps)

    assert np.abs(wanted.velocity).max() > 0
    for one in run_in_threads(ranks, program, patience=60):
        assert np.array_equal(one.position, wanted.position) and np.array_equal(one.velocity, wanted.velocity)
        assert (one.step, one.time) == (wanted.step, wanted.time)


def test_how_far_a_substep_reads():
    """Of all twelve families 6 rows the first time and 4 more each, from a multiple of 4 on (model/xpbd/reach.py); of Jacobi
    2 each, and the two whose number of constraints has a say; the wind's triangles take a row more."""
    twelve, all_at_once = frozenset((*KINDS, "gauss-seidel")), frozenset((*KINDS, "jacobi"))
    assert substep_rows(twelve, 1) == (4, 2) and period(twelve) == 4
    assert substep_rows(twelve, 3) == (12, 2)
    assert substep_rows(all_at_once, 3) == (6, 2) and period(all_at_once) == 1
    assert substep_rows(all_at_once | {"wind"}, 3) == (7, 2)
    assert substep_rows(frozenset({"structural", "gauss-seidel"}), 1)[0] <= 2
    assert substep_rows(frozenset({"jacobi"}), 5) == (0, 0), "no constraint, nothing to read"


def test_wind_moves_an_edge_through_the_colours_period():
    """The bound holds for any number of substeps, counted one by one."""
    from softlab.model.xpbd.reach import dependencies

    parts = frozenset((*KINDS, "gauss-seidel", "wind"))
    rows, more = substep_rows(parts, 2)
    first, end = 0, 16
    for number in range(1, 40):
        first, end = dependencies(parts, True, first, end, 2)
        first, end = first - 1, end + 1
        assert max(-first, end - 16) <= rows * number + more
