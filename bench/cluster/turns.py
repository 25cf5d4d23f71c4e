"""Turns: while a worker times, it has its machine or its GPU reserved among the lab's workers of this user.

A turn is a lock of the operating system on a small SQLite file in the user's cache, so that it ends with its process,
however that ends, and works on every system. CPU threads are timed with the whole host locked; a GPU alone with the GPU
locked and the host shared, so that several GPUs of a host are timed at once, but never beside CPU threads.
"""

from __future__ import annotations

import hashlib
import platform
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from softlab.model.base.disk_cache import user_cache
from softlab.model.base.errors import InputError

CHECK_SECONDS = 0.5  # interval in which a wait checks for Ctrl-C


def host_name() -> str:
    """Return 6 hexadecimal digits that identify this host without revealing its name."""
    return hashlib.sha256(platform.node().encode()).hexdigest()[:6]


def turns_folder() -> Path:
    """Return the folder of this user's locks. Raises InputError if it cannot be created."""
    folder = user_cache("turns")
    if folder is None:
        raise InputError(
            "no lock file can be created, which reserves the machine for one worker: ~/.cache cannot be "
            "written; name another "
            "folder: export XDG_CACHE_HOME=FOLDER"
        )
    return folder


def try_lock(file: Path, shared: bool = False, seconds: float = 0.0) -> sqlite3.Connection | None:
    """Return a lock on a file, valid until the connection is closed or the process ends.

    None if another process still has it after `seconds`. `shared`: others may have it too, if all of them share it.
    Raises InputError if nothing can be locked.
    """
    connection = None
    try:
        connection = sqlite3.connect(file, timeout=seconds, isolation_level=None)
        if shared:
            connection.execute("BEGIN")
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()  # this takes the lock, and keeps it
        else:
            connection.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        if connection is not None:
            connection.close()
        if "locked" in str(error):
            return None
        raise InputError(f"{file} cannot be locked ({error}); delete it, or free its folder for writing") from None
    return connection


@contextmanager
def locked(file: Path, shared: bool = False, waiting: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Hold the lock inside this context; `waiting` is called repeatedly until it is acquired."""
    while (connection := try_lock(file, shared, CHECK_SECONDS)) is None:
        waiting()
    try:
        yield
    finally:
        connection.close()


class Turn:
    """Turns of a worker on its machine.

    `backends`: what is timed, empty if nothing is; `device`: identifier of the GPU. A nested `begin` has no effect.
    """

    def __init__(self, backends: Sequence[str], device: str | None = None, waiting: Callable[[], None] = lambda: None):
        self.device, self.waiting = device, waiting
        self.whole_host = "cpu" in backends
        self.timed = bool(backends)
        self.locks: ExitStack | None = None

    def begin(self) -> None:
        """Wait for the turn."""
        if self.locks is not None or not self.timed:
            return
        with ExitStack() as stack:
            folder, host = turns_folder(), host_name()
            stack.enter_context(locked(folder / f"host-{host}.lock", not self.whole_host, self.waiting))
            if not self.whole_host and self.device:
                stack.enter_context(locked(folder / f"gpu-{self.device}.lock", False, self.waiting))
            self.locks = stack.pop_all()

    def end(self) -> None:
        """Release the turn."""
        if self.locks is not None:
            self.locks.close()
            self.locks = None
