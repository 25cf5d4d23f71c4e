"""A grid on several CPU ranks: pokes, divergences, lost ranks, what cannot be shared (bits: test_shares.py)."""

import pytest

from softlab.cpu_backend.domains.in_threads import Meeting, ThreadRanks, run_in_threads
from softlab.cpu_backend.domains.ranks import RankSimulation, shared_threads
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.options import Options
from softlab.model.core.simulation import State
from softlab.model.domains.simulation import cut
from softlab.model.scene.scene import load_scene

SCENES = {
    "lab": {},
    "verlet": {"method.integrator": "velocity-verlet"},
    "rk4": {"method.integrator": "rk4"},
    "random": {"external.magnitude": 0.3, "method.integrator": "velocity-verlet"},
    "uneven": {"springs.stiffness_ratio": 3.0, "method.dt": 0.002},
    "edges": {"grid.pinned": "edges", "perturbation.amplitude": 0.1, "method.integrator": "semi-implicit-euler"},
}


def scene_of(name, rows=16, columns=5):
    settings = {"grid.rows": rows, "grid.columns": columns, "method.dt": 0.005, **SCENES[name]}
    return load_scene("lab-grid").replace(settings)


def test_a_lost_rank_is_an_error_and_no_hang():
    """Rank 1 never comes: rank 0's first wait for it ends, and says so."""
    scene, meeting = scene_of("lab"), Meeting(2, patience=0.2)
    with (
        pytest.raises(BackendUnavailable, match="does not answer"),
        RankSimulation(scene, Options(math="exact"), ThreadRanks(meeting, 0), 1) as simulation,
    ):
        simulation.advance(1)


CLOTHS = [  # scene, integrator, rows of halo
    ("cloth-hanging", "velocity-verlet", 4),  # springs against bending reach two rows; a step and its end
    ("cloth-wind", "velocity-verlet", 4),  # kicks that do not meet: forces twice in a step
    ("cloth-sphere", "semi-implicit-euler", 2),
    ("cloth-wind", "rk4", 8),
]


def cloth_of(name, integrator):
    settings = {"cloth.rows": 17, "cloth.columns": 5, "method.integrator": integrator, "method.dt": 1e-4}
    return load_scene(name).replace(settings)


@pytest.mark.parametrize("name, integrator, halo", CLOTHS)
def test_how_far_a_step_of_a_cloth_reads(name, integrator, halo):
    assert cut(cloth_of(name, integrator), 2, 1, "--ranks").halo == halo


def test_threads_of_ranks_share_the_cores(monkeypatch):
    monkeypatch.setattr("softlab.cpu_backend.domains.ranks.core_count", lambda: 8)
    assert [shared_threads(word, 4) for word in ("1x", "2x", "4x", 3, "5")] == [2, 4, 8, 3, "5"]
    assert shared_threads("1x", 16) == 1


def test_the_state_of_a_rank_is_that_of_all():
    def program(ranks):
        with RankSimulation(scene_of("lab"), Options(math="exact"), ranks, 1) as simulation:
            return simulation.state(), simulation.rank, simulation.slowest(float(ranks.rank))

    found = run_in_threads(3, program, patience=60)
    assert all(isinstance(state, State) and len(state.position) == 80 for state, _, _ in found)
    assert [(rank, slowest) for _, rank, slowest in found] == [(0, 2.0), (1, 2.0), (2, 2.0)]
