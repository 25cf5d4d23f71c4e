"""Detection of an MPI launcher from the environment: the number of processes and this one's rank."""

from __future__ import annotations

import os

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")  # number of processes, by launcher
PLACES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_RANK")
STATUS_FILE = "SOFTLAB_STATUS_FILE"  # names the file where rank 0 leaves its exit status for the lab that started it


def _from_environment(names: tuple[str, ...], default: int) -> int:
    values = [os.environ[name] for name in names if os.environ.get(name, "").isdigit()]
    return int(values[0]) if values else default


def launched_ranks() -> int:
    """Return the number of processes; 1 where nothing was launched."""
    return _from_environment(SIZES, 1)


def launched_rank() -> int:
    """Return the rank of this process."""
    return _from_environment(PLACES, 0)
