"""Arrays that are dear to make, kept in files: what cannot be read or written costs the time to make it again, no more."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from model.core.errors import InputError
from model.core.files import replacing

Kept = TypeVar("Kept")


def user_cache(name: str) -> Path | None:
    """A folder of the user's cache, made where it is missing; None where that cannot be written."""
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        folder = (Path(base) if base else Path.home() / ".cache") / "softlab" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder if os.access(folder, os.W_OK) else None
    except (OSError, RuntimeError):
        return None


@cache
def cache_folder(name: str) -> Path:
    """A folder of the user's cache, or a fresh private one, gone with the process, where that cannot be written.

    Never a shared folder under a name that another user could guess and fill.
    """
    folder = user_cache(name)
    if folder is not None:
        return folder
    private = tempfile.mkdtemp(prefix=f"softlab-{name}-")
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    return Path(private)


def read_arrays(file: Path) -> dict[str, np.ndarray] | None:
    """The arrays of an .npz file by name; None where it is not there, cut short or damaged."""
    try:
        with np.load(file) as held:
            return dict(held)
    except Exception:  # a damaged archive can trip its parser anywhere
        return None


def write_arrays(file: Path, **arrays: np.ndarray | float) -> None:
    """Under another name first, so that a killed process leaves no half of a file; in silence where it cannot be."""
    with suppress(OSError, InputError):
        file.parent.mkdir(exist_ok=True)
        with replacing(file) as temporary, open(temporary, "wb") as opened:
            np.savez(opened, **arrays)  # type: ignore[arg-type]


def kept(
    file: Path,
    key: str,
    unpacked: Callable[[dict[str, np.ndarray]], Kept | None],
    make: Callable[[], Kept],
    packed: Callable[[Kept], Mapping[str, np.ndarray | float]],
) -> Kept:
    """What the arrays of `file` are if they lie there under `key` and are whole, else made and put there."""
    held = read_arrays(file)
    found = unpacked(held) if held and str(held.get("key")) == key else None
    if found is None:
        found = make()
        write_arrays(file, key=np.array(key), **packed(found))
    return found
