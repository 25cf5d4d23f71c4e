"""Files that a user names: read only if they are regular files of a sensible size, written completely or not at all."""

from __future__ import annotations

import hashlib
import os
import stat
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from softlab.model.base.errors import InputError, shortened
from softlab.model.base.memory import available_bytes, readable

LONGEST_TEXT = 2**24  # bytes of a scene: a hundred thousand pinned masses listed one by one take a tenth of it
OLD_SECONDS = 3600.0  # older temporary files without writes were left by a process that has ended
SAMPLE = 64  # bytes at the head of a file that identify its kind
POINTER = b"version https://git-lfs.github.com/spec/"
NAME_SHOWN = 40  # characters of a file's name in its temporary one, which must not exceed the file system's limit


def why(error: Exception) -> str:
    """Return the operating system's reason for an error."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def is_there(path: Path | str) -> bool:
    """Return True if the path exists; any name is allowed."""
    try:
        os.stat(path)
    except (OSError, ValueError):
        return False
    return True


def _named(path: Path) -> str:
    """Return the path for a message; '' has become the current folder."""
    return "the empty name '' (this folder)" if path == Path() else str(path)


def check_source(path: Path | str, what: str) -> Path:
    """Return `path` if it is a regular file: neither a folder nor a pipe or device, where reading may never end.

    `what`: description of the expected file, such as "a scene is a .toml file". Raises InputError.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {what}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {why(error)}; {what}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"{_named(Path(path))} is a directory; {what}")
    if not stat.S_ISREG(mode):
        raise InputError(f"{path} is a pipe or a device, not a file; {what}")
    return Path(path)


def read_text(path: Path | str, what: str) -> str:
    """Return the text of a UTF-8 file of at most LONGEST_TEXT bytes; `what`: see `check_source`. Raises InputError."""
    source = check_source(path, what)
    try:
        with source.open("rb") as opened:  # some system files have no size until they are read
            content = opened.read(LONGEST_TEXT + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {why(error)}; {what}") from None
    if len(content) > LONGEST_TEXT:
        raise InputError(f"{path} is longer than {LONGEST_TEXT // 2**20} MiB; {what}")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file in UTF-8; {what}") from None


def check_target(path: Path | str, suffixes: tuple[str, ...], what: str = "a picture") -> Path:
    """Return `path` as a Path if `what` may be written there: known suffix, existing folder, not a folder itself.

    Raises InputError. Call it before the work.
    """
    path = Path(path)
    name = path.name.lower()
    if not name.endswith(suffixes) or name in suffixes:
        raise InputError(f"{_named(path)}: the name of {what} must end in {' or '.join(suffixes)}")
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"{path} is a folder; name a file in it")
        if not stat.S_ISREG(mode):
            raise InputError(f"{path} is a pipe or a device, not a file; give another name")
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be written: {why(error)}") from None
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    try:
        with TemporaryFile(dir=path.parent):  # tried, since permissions are not reliable in some system folders
            pass
    except OSError as error:
        raise InputError(f"{path}: the folder {path.parent} cannot be written to: {why(error)}; name another") from None
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a hidden name beside `path`; rename it to `path` when the block succeeds and delete it when it fails.

    Files that a killed process left under such a name are deleted, too. Raises InputError where the folder cannot be
    written to or is full.
    """
    clear_left(path)
    temporary = path.with_name(f"{_hidden(path)}{os.getpid()}{path.suffix[:8]}")
    try:
        temporary.unlink(missing_ok=True)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # not through another user's link
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {why(error)}; check permissions and space") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def clear_left(path: Path) -> None:
    """Delete the hidden files that ended processes left for `path`."""
    with suppress(OSError):
        start = _hidden(path)
        for name in os.listdir(path.parent):
            if name.startswith(start):
                writer = name.removeprefix(start).split(".")[0].split("-")[0]
                left = path.with_name(name)
                if writer.isdecimal() and not _still_writes(int(writer), left):
                    with suppress(OSError):
                        left.unlink()


def _hidden(path: Path) -> str:
    """Return the prefix of a file's hidden names: the name's own digest distinguishes it from others with the same
    beginning."""
    digest = hashlib.sha256(os.fsencode(path.name)).hexdigest()[:8]
    return f".{path.stem[:NAME_SHOWN]}-{digest}.part-"


def _still_writes(process: int, left: Path) -> bool:
    """Return True if the process may still write that file."""
    if process == os.getpid():
        return True
    if time.time() - left.stat().st_mtime > OLD_SECONDS:
        return False
    if os.name == "nt":  # on Windows a signal would end the process
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # another user's process, or an impossible number
        return True
    return True


def check_pointer(path: Path | str, head: bytes) -> None:
    """Raise InputError for a file that begins as a Git LFS pointer does. `head`: its first SAMPLE bytes or more."""
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(POINTER):
        raise InputError(f"{path} is a Git LFS pointer, not the mesh: fetch it with `git lfs pull`")


def read_archive(path: Path | str, what: str) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz file by name; `what`: see `check_source`.

    Raises InputError: no such file, no archive, truncated, or larger than the free memory.
    """
    source = check_source(path, what)
    try:
        with source.open("rb") as opened:
            check_pointer(path, opened.read(SAMPLE))
        with zipfile.ZipFile(source) as archive:
            needed = sum(member.file_size for member in archive.infolist())
        free = available_bytes()
        if needed > free:
            raise InputError(f"{path} holds {readable(needed)}, and {readable(free)} of main memory is free; {what}")
        with np.load(source, allow_pickle=False) as loaded:
            return {name: np.asarray(loaded[name]) for name in loaded.files}
    except InputError:
        raise
    except Exception as error:  # any failure of the parser is the file's fault
        reason = shortened(why(error).splitlines()[0], 120)
        raise InputError(f"{path} cannot be read as a .npz file ({reason}); {what}") from None
