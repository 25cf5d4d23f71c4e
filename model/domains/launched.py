"""Whether this process is one of several that a launcher of MPI started together, told by its environment alone."""

from __future__ import annotations

import os

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")  # how launchers tell a process how many there are
PLACES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_RANK")
STATUS_FILE = "SOFTLAB_STATUS_FILE"  # names the file where rank 0 leaves its exit status for the lab that started it


def _told(names: tuple[str, ...], default: int) -> int:
    found = [os.environ[name] for name in names if os.environ.get(name, "").isdigit()]
    return int(found[0]) if found else default


def launched_ranks() -> int:
    """How many there are; 1 where nothing was launched."""
    return _told(SIZES, 1)


def launched_rank() -> int:
    """Which of them this is."""
    return _told(PLACES, 0)
