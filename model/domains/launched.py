"""Detection of an MPI launcher from the environment: the number of processes and this one's rank."""

from __future__ import annotations

import os

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")  # number of processes, by launcher
PLACES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_RANK")
STATUS_FILE = "SOFTLAB_STATUS_FILE"  # names the file where rank 0 leaves its exit status for the lab that started it


def _told(names: tuple[str, ...], default: int) -> int:
    found = [os.environ[name] for name in names if os.environ.get(name, "").isdigit()]
    return int(found[0]) if found else default


def launched_ranks() -> int:
    """Return the number of processes; 1 where nothing was launched."""
    return _told(SIZES, 1)


def launched_rank() -> int:
    """Return the rank of this process."""
    return _told(PLACES, 0)
