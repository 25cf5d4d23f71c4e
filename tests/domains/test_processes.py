"""What is said where processes are not those that were asked for."""

from types import SimpleNamespace

import pytest

from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.domains import processes
from softlab.model.domains.launched import SIZES


@pytest.fixture
def seen(monkeypatch):
    """MPI sees two processes; no launcher has left anything in the environment."""
    for name in SIZES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(processes, "mpi", lambda: SimpleNamespace(COMM_WORLD=SimpleNamespace(Get_size=lambda: 2)))
    return monkeypatch


def test_as_many_as_were_asked_for_are_a_world(seen):
    assert processes.world_of(2, "--ranks").Get_size() == 2


def test_another_number_is_bad_input(seen):
    with pytest.raises(SceneError, match=r"^gpus.*MPI has 2 processes; start the run with mpiexec -n 3"):
        processes.world_of(3, "--gpus")


@pytest.mark.parametrize("name", SIZES)
def test_more_than_mpi_sees_were_started_by_another_mpis_launcher(seen, name):
    """mpi4py of one MPI, mpiexec of another: each process believes that it is alone, or in a smaller company."""
    seen.setenv(name, "4")
    with pytest.raises(BackendUnavailable, match="4 processes were started, and MPI sees 2") as found:
        processes.world_of(4, "--ranks")
    assert "MPI4PY_LIBMPI" in found.value.remedy and found.value.exit_status == 3
