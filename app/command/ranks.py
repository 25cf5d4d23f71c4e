"""Runs of several processes of MPI: how they are started, and who of them speaks."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from app.command.run import Request
from app.command.run_length import step_count
from app.shared import check_asked, check_cut, check_shareable, check_shared
from model.core.errors import BackendUnavailable, SceneError
from model.domains.launched import STATUS_FILE, launched_rank, launched_ranks
from model.domains.processes import abort, mpi_installed, mpiexec
from model.scene.scene import Scene


def among_ranks(scene: Scene, request: Request) -> tuple[Request, int]:
    """(the request of this process, how many processes are to be started for it: 0, it runs by itself). What cannot be shared
    is refused before anything is started. Raises SceneError, BackendUnavailable."""
    if max(request.gpus, request.ranks) > 1:  # first: another option in its place would do no better
        check_shareable(scene, *((request.gpus, "--gpus") if request.gpus > 1 else (request.ranks, "--ranks")))
    check_asked(request.backend, request.gpus, request.ranks, request.exchange_every, request.link)
    launched = launched_ranks()
    by_nccl = request.link == "nccl"
    option, wanted = ("--gpus", request.gpus) if by_nccl else ("--ranks", request.ranks)
    if launched == 1 and (by_nccl or wanted <= 1):
        return request, 0  # which says what is wrong with a number under 1
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
    """What starts processes of MPI. Raises BackendUnavailable where there is none, or no mpi4py."""
    launcher = mpiexec()
    mpi_installed()
    return launcher


def start_ranks(count: int, arguments: Sequence[str]) -> int:
    """Run this command line on `count` processes of MPI, and wait; the exit status of rank 0. Raises BackendUnavailable."""
    launcher = check_launcher()
    with TemporaryDirectory() as folder:
        status = Path(folder) / "status"
        environment = {**os.environ, STATUS_FILE: str(status)}
        done = subprocess.run([launcher, "-n", str(count), sys.executable, *arguments], env=environment)
        if status.exists():
            return int(status.read_text())
    return done.returncode or 1


def rank_status(status: int) -> int:
    """The exit status of this process: its own, or where `start_ranks` waits for rank 0's none, so that the launcher has
    nothing to add."""
    file = os.environ.get(STATUS_FILE)
    if file is not None and launched_rank() == 0:
        Path(file).write_text(str(status))
    if status == BackendUnavailable.exit_status and "mpi4py.MPI" in sys.modules and launched_ranks() > 1:
        abort(status)  # the end of a process would wait for one that is lost
    return status if file is None else 0
