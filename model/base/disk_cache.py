"""Arrays that are expensive to compute, cached in files. A failure to read or write costs only the time to compute them
again."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO, TypeVar

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.files import replacing

Stored = TypeVar("Stored")


def user_cache(name: str) -> Path | None:
    """Return a folder of the user's cache, created if missing; None where it cannot be written."""
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        folder = (Path(base) if base else Path.home() / ".cache") / "softlab" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder if os.access(folder, os.W_OK) else None
    except (OSError, RuntimeError):
        return None


@cache
def cache_folder(name: str) -> Path:
    """Return a folder of the user's cache, or a new private one for this process where that cannot be written.

    It is never a shared folder under a name that another user could guess and fill.
    """
    folder = user_cache(name)
    if folder is not None:
        return folder
    private = tempfile.mkdtemp(prefix=f"softlab-{name}-")
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    return Path(private)


def read_arrays(file: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of an .npz file by name; None where it is missing, truncated or damaged."""
    try:
        with np.load(file) as archive:
            return dict(archive)
    except Exception:  # a damaged archive can fail anywhere in its parser
        return None


def save_arrays(opened: IO[bytes], arrays: Mapping[str, np.ndarray | np.generic | float]) -> None:
    """Write the arrays by name, as an .npz file."""
    save: Callable[..., None] = np.savez  # its stub takes every array for a flag, too
    save(opened, **arrays)


def write_arrays(file: Path, arrays: Mapping[str, np.ndarray | float]) -> None:
    """Write the arrays to an .npz file, under another name first, so that a killed process leaves no partial file.
    Failures are ignored."""
    with suppress(OSError, InputError):
        file.parent.mkdir(exist_ok=True)
        with replacing(file) as temporary, open(temporary, "wb") as opened:
            save_arrays(opened, arrays)


def load_or_make(
    file: Path,
    key: str,
    unpacked: Callable[[dict[str, np.ndarray]], Stored | None],
    make: Callable[[], Stored],
    packed: Callable[[Stored], Mapping[str, np.ndarray | float]],
) -> Stored:
    """Return the object in `file` if its arrays are complete and have the `key`; otherwise make it and write it
    there."""
    arrays = read_arrays(file)
    loaded = unpacked(arrays) if arrays and str(arrays.get("key")) == key else None
    if loaded is None:
        loaded = make()
        write_arrays(file, {"key": np.array(key), **packed(loaded)})
    return loaded
