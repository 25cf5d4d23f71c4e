"""MPI processes for any backend: start, messages between them, and time limits."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.domains.exchange import PATIENCE
from softlab.model.domains.launched import launched_ranks

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm, Request

INSTALL = "pip install -e \".[mpi]\" in the lab's folder, or the system's MPI and mpi4py"
POLLS = 1000  # tests of a message before a waiting process yields its core
NAP = 5e-5  # s


def mpi() -> ModuleType:
    """Return mpi4py's MPI. Raises BackendUnavailable."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:  # RuntimeError where there is mpi4py without an MPI library
        raise BackendUnavailable(f"MPI is not installed ({error})", INSTALL) from None
    return MPI


def world_of(count: int, option: str) -> Intracomm:
    """Return the communicator of all processes, `count` of them.

    Raises SceneError, naming the `option`, for another number, BackendUnavailable where the launcher started more than
    MPI sees.
    """
    world = mpi().COMM_WORLD
    size, started = world.Get_size(), launched_ranks()
    if size < started:
        raise BackendUnavailable(
            f"{started} processes were started, and MPI sees {size}: mpi4py speaks to the library of another MPI than the "
            "launcher's",
            "start them with that MPI's own mpiexec, or name the launcher's library in MPI4PY_LIBMPI",
        )
    if size != count:
        raise SceneError(option, count, f"MPI has {size} processes; start the run with mpiexec -n {count}")
    return world


def mpi_installed() -> None:
    """Raise BackendUnavailable without mpi4py. Does not start MPI in this process, which will start others."""
    if find_spec("mpi4py") is None:
        raise BackendUnavailable("mpi4py is not installed", INSTALL)


def mpiexec() -> str:
    """Return the launcher of mpi4py's MPI: beside this Python, or on the path. Raises BackendUnavailable."""
    mpi_beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(mpi_beside) if mpi_beside.exists() else shutil.which("mpiexec")
    if not launcher:
        raise BackendUnavailable("mpiexec, which starts ranks, was not found", INSTALL)
    return launcher


def abort(status: int) -> None:
    """End all processes after one of them stopped responding."""
    mpi().COMM_WORLD.Abort(status)


def lost(who: str, patience: float) -> BackendUnavailable:
    """Return the error for a process that does not respond."""
    return BackendUnavailable(f"{who} does not answer for {patience:g} s", "see what ended it, and start the run again")


def await_request(request: Request, who: str) -> None:
    """Return when a request is done. Raises BackendUnavailable after PATIENCE."""
    polls, end = 0, None
    while not request.Test():
        polls += 1
        if polls % POLLS == 0:
            now = time.monotonic()
            end = end or now + PATIENCE
            if now > end:
                raise lost(who, PATIENCE)
            time.sleep(NAP)


def gather_rows(world: Intracomm, owned: np.ndarray) -> np.ndarray:
    """Return the rows (masses, axes) of all processes in order, from the rows that each process owns."""
    axes = owned.shape[1]
    counts = np.zeros(world.Get_size(), np.int64)
    await_request(world.Iallgather(np.array([len(owned)], np.int64), counts), "another process")
    whole = np.empty((int(counts.sum()), axes), owned.dtype)
    kind = mpi().FLOAT if owned.dtype == np.float32 else mpi().DOUBLE
    mass = kind.Create_contiguous(axes).Commit()  # MPI counts are 32-bit: of masses, not of numbers
    try:
        request = world.Iallgatherv([owned, len(owned), mass], [whole, counts, None, mass])
        await_request(request, "another process")
    finally:
        mass.Free()
    return whole


def largest_of(world: Intracomm, numbers: np.ndarray) -> np.ndarray:
    """Return the elementwise maximum over the processes, (n,) float64."""
    sent = np.ascontiguousarray(numbers, np.float64)
    largest = np.zeros_like(sent)
    await_request(world.Iallreduce(sent, largest, mpi().MAX), "another process")
    return largest


def swapped(world: Intracomm, messages: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Send `messages`, bytes for each process, and return the bytes received from each process."""
    sent, came = np.array([len(message) for message in messages], np.int64), np.zeros(len(messages), np.int64)
    await_request(world.Ialltoall(sent, came), "another process")
    received, this_rank = [np.empty(size, np.uint8) for size in came], world.Get_rank()
    received[this_rank] = messages[this_rank]
    others = [rank for rank in range(len(messages)) if rank != this_rank]
    pending = [(rank, world.Irecv(received[rank], rank)) for rank in others if came[rank]]
    pending += [(rank, world.Isend(messages[rank], rank)) for rank in others if sent[rank]]
    for rank, request in pending:
        await_request(request, f"rank {rank}")
    return received
