"""Runs of several MPI processes: how they are started, and which of them prints."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from softlab.app.command.run_length import step_count
from softlab.app.command.run_options import Request
from softlab.app.shared import check_asked, check_cut, check_shareable, check_shared
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.domains.launched import STATUS_FILE, launched_rank, launched_ranks
from softlab.model.domains.processes import abort, mpi_installed, mpiexec
from softlab.model.scene.scene import Scene


def among_ranks(scene: Scene, request: Request) -> tuple[Request, int]:
    """Return (the request of this process, the number of processes to start for it, 0 if it runs alone).

    A scene that cannot be divided is refused before anything is started. Raises SceneError, BackendUnavailable.
    """
    if max(request.gpus, request.ranks) > 1:  # first, since another option in its place would fail too
        check_shareable(scene, *((request.gpus, "--gpus") if request.gpus > 1 else (request.ranks, "--ranks")))
    check_asked(request.backend, request.gpus, request.ranks, request.exchange_every, request.link)
    launched = launched_ranks()
    by_nccl = request.link == "nccl"
    option, wanted = ("--gpus", request.gpus) if by_nccl else ("--ranks", request.ranks)
    if launched == 1 and (by_nccl or wanted <= 1):
        return request, 0  # the request itself refuses a number under 1
    if wanted not in (1, launched) and launched > 1:
        raise SceneError(
            option, wanted, f"{launched} processes were started; leave it out, or start mpiexec -n {wanted}"
        )
    many = max(wanted, launched)
    check_shared(many, request.render, request.export)
    if launched == 1:
        check_launcher()
    check_cut(scene, many, request.exchange_every, request.link, option)
    step_count(scene, request.steps, request.time, [])
    shared = replace(request, gpus=many) if by_nccl else replace(request, ranks=many)
    return shared, many if launched == 1 else 0


def check_launcher() -> str:
    """Return the launcher of MPI processes. Raises BackendUnavailable if there is none, or no mpi4py."""
    launcher = mpiexec()
    mpi_installed()
    return launcher


def start_ranks(count: int, arguments: Sequence[str]) -> int:
    """Run the command line with these arguments on `count` MPI processes, and wait. Returns the exit status of rank 0.
    Raises BackendUnavailable."""
    launcher = check_launcher()
    with TemporaryDirectory() as folder:
        status = Path(folder) / "status"
        environment = {**os.environ, STATUS_FILE: str(status)}
        done = subprocess.run(
            [launcher, "-n", str(count), sys.executable, "-m", "softlab", *arguments], env=environment
        )
        if status.exists():
            return int(status.read_text())
    return done.returncode or 1


def rank_status(status: int) -> int:
    """Return the exit status of this process. If `start_ranks` waits for rank 0 it is 0, so that the launcher prints no
    error message of its own."""
    file = os.environ.get(STATUS_FILE)
    if file is not None and launched_rank() == 0:
        Path(file).write_text(str(status))
    if status == BackendUnavailable.exit_status and "mpi4py.MPI" in sys.modules and launched_ranks() > 1:
        abort(status)  # the end of a process would wait for a lost one
    return status if file is None else 0
