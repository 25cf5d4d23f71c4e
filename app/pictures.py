"""Picture files: written under a temporary name and renamed, so that none is ever half there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from model.errors import InputError


def check_target(path: Path | str, suffixes: tuple[str, ...], what: str = "a picture") -> Path:
    """`path` as a Path, if `what` may be written there: known suffix, existing folder, not a folder itself.

    Raises InputError; to be called before the work whose result it is.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: the name of {what} must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{path} is a folder; name a file in it")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} cannot be written to")
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it when the block succeeds and deleted when it does not.

    Raises InputError where the folder cannot be written to, or is full.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        os.chmod(name, 0o666 & ~_umask())  # mkstemp makes files for the owner alone
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    temporary = Path(name)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_png(path: Path | str, image: np.ndarray) -> Path:
    """Write `image` (height, width, 3 or 4) uint8, top row first, as a PNG. Raises InputError."""
    from PIL import Image

    path = check_target(path, (".png",))
    with replacing(path) as temporary:
        Image.fromarray(np.ascontiguousarray(image[:, :, :3])).save(temporary, format="PNG")
    return path
