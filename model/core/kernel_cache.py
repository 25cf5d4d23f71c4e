"""Machine code kept on disk, for both backends: where it lies, what is told while a kernel compiles, how long that took.

numba's own caches key a function by its place in a source file and by its closure, which here holds other compiled
functions and so differs in every process. Kernels here have their content in their name (model/core/digest.py), so that one
folder of the user's cache serves every checkout, and a kernel is compiled anew only if something that it is made of has
changed. Mixed into numba's cache classes by cpu_backend/core/compile.py and gpu_backend/core/compile.py; nothing here needs
numba.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from model.core.disk_cache import user_cache
from model.core.errors import InputError
from model.core.files import replacing
from model.core.waiting import Watchers

MAX_BYTES = 1 << 30  # of kept machine code; beyond it the longest unused half goes
SECONDS = "seconds.json"  # of each kernel's last compilation, by label
_watchers = Watchers()
watched = _watchers.watched  # its watcher(label, seconds): a kernel that begins to compile, and what it took last time
_begun: dict[str, float] = {}
_told: set[str] = set()


class KernelCacheWarning(UserWarning):
    """Machine code cannot be kept: every run compiles anew."""


@cache
def folder() -> Path | None:
    """Where machine code is kept: below NUMBA_CACHE_DIR if that is set, else in the user's cache; None where neither can
    be written."""
    base = os.environ.get("NUMBA_CACHE_DIR")
    place = Path(base) / "softlab-kernels" if base else user_cache("kernels")
    if place is None:
        return None
    with suppress(OSError):
        place.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=place).close()
        return place
    return None


@cache
def _seconds() -> dict[str, float]:
    place = folder()
    with suppress(OSError, ValueError, AttributeError):
        known = json.loads((place / SECONDS).read_text()) if place else {}
        return {str(label): float(value) for label, value in known.items()}
    return {}


def _begin(label: str) -> None:
    _begun[label] = time.perf_counter()
    _watchers.tell(label, _seconds().get(label))


def _end(label: str) -> None:
    begun = _begun.pop(label, None)
    if begun is not None:
        _seconds()[label] = round(time.perf_counter() - begun, 3)


def keep(dispatcher: Any, kernel_cache: type, label: str) -> None:
    """Give a numba dispatcher a cache of type `kernel_cache`, where one can be written. `label`: what a watcher is told."""
    try:
        dispatcher._cache = kernel_cache(dispatcher.py_func)
        dispatcher._cache.label = label
    except (RuntimeError, OSError):
        _unwritable("no folder for it can be written; NUMBA_CACHE_DIR names another")


def _unwritable(reason: object) -> None:
    """Told once a process, as a warning: a cache that cannot be written costs time and no more."""
    if "unwritable" not in _told:
        _told.add("unwritable")
        text = f"machine code cannot be kept ({reason}): every run compiles anew"
        warnings.warn(text, KernelCacheWarning, stacklevel=2)


@cache
def _make_room() -> None:
    """Once a process: of more than MAX_BYTES, what was not used for longest goes, until half is free."""
    place = folder()
    with suppress(OSError):
        files = list(place.glob("*.nb?")) if place else []
        held = sum(file.stat().st_size for file in files)
        if held <= MAX_BYTES:
            return
        used: dict[str, float] = {}  # when a kernel was last used: its index is touched then, its code is not
        for file in files:
            kernel = file.name.split(".")[0]
            used[kernel] = max(used.get(kernel, 0.0), file.stat().st_mtime)
        for file in sorted(files, key=lambda file: used[file.name.split(".")[0]]):
            held -= file.stat().st_size
            file.unlink(missing_ok=True)
            if held < MAX_BYTES // 2:
                break


class Place:
    """Stands in for numba's locators of caches: one folder for all kernels."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Place | None:
        """The place, or None where no folder can be written."""
        return cls() if folder() else None

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder of all kernels."""
        return str(folder())

    def get_source_stamp(self) -> str:
        """Nothing: what a kernel is made of is in its name."""
        return ""

    def get_disambiguator(self) -> str:
        """Nothing, for the same reason."""
        return ""


class NamedByContent:
    """Mixin of numba's cache implementations: a file's name is the kernel's, which holds its content."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """The kernel's name, and the Python it is for."""
        return f"{fullname.partition('.')[2]}.py{sys.version_info[0]}{sys.version_info[1]}{abiflags}"


@cache
def _versions() -> tuple[str, ...]:
    """Of the compilers: what one version made another need not be able to run."""
    found = []
    for package in ("numba", "llvmlite", "numba-cuda"):
        with suppress(PackageNotFoundError):
            found.append(f"{package} {version(package)}")
    return tuple(found)


class Kept:
    """Mixin of numba's caches of functions: tells the watchers, and does without what cannot be read or written."""

    _py_func: Any
    _cache_file: Any
    label: str

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), _versions()

    @property
    def has_any(self) -> bool:
        """Whether machine code of this function is kept, for arguments of some type."""
        return os.path.exists(self._cache_file._index_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for these types, or None: it is to be compiled, as watchers are told."""
        try:
            found = super().load_overload(sig, target_context)  # type: ignore[misc]
        except Exception:  # a damaged file, or one that names modules of another version, can fail anywhere
            found = None
            with suppress(OSError):
                os.unlink(self._cache_file._index_path)
        if found is None:
            _begin(self.label)
        else:
            with suppress(OSError):
                os.utime(self._cache_file._index_path)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code for these types, if it can be written."""
        _end(self.label)
        try:
            _make_room()
            super().save_overload(sig, data)  # type: ignore[misc]
            _save_seconds()
        except OSError as error:
            _unwritable(error.strerror or error)
        except InputError as error:
            _unwritable(error)


def _save_seconds() -> None:
    """Under another name first; other processes' numbers that came in between may be lost, which harms nobody."""
    place = folder()
    assert place is not None  # something was written there just now
    with replacing(place / SECONDS) as part:
        part.write_text(json.dumps(_seconds(), indent=0, sort_keys=True))
