"""Arrays that are dear to make, kept in files: what cannot be read or written costs the time to make it again, no more."""

from __future__ import annotations

import os
import tempfile
import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np


def read_arrays(file: Path) -> dict[str, np.ndarray] | None:
    """The arrays of an .npz file by name; None where it is not there, or cut short."""
    try:
        with np.load(file) as held:
            return dict(held)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error):
        return None


def write_arrays(file: Path, **arrays: np.ndarray | float) -> None:
    """Under another name first, so that a killed process leaves no half of a file; in silence where it cannot be."""
    try:
        file.parent.mkdir(exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, suffix=".tmp")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as opened:
            np.savez(opened, **arrays)  # type: ignore[arg-type]
        os.replace(name, file)
    except OSError:
        Path(name).unlink(missing_ok=True)
